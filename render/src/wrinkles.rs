//! Wrinkle masks: how far each target compresses or stretches the skin, from the edges of faces.
//!
//! Galanakis ("Texture-based Blendshapes in DX9") keeps a mask beside the deltas of each target, sums masks with the weights,
//! as deltas are, and blends a normal map of wrinkles in where the sum is large. Here there are two masks and two maps: skin
//! that is compressed upwards gets lines across it, as a brow that is raised does, and the other way round.

use crate::model::places_of;
use deltamorph::{MorphMesh, PackedLayout, Result};
use glam::Vec3;
use std::collections::BTreeSet;

/// What targets compress, summed with their weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Wrinkles {
    /// For each target where a vertex is in pose buffers, and by how much it is compressed there at weight 1.
    masks: Vec<Vec<(u32, [f32; 2])>>,
    /// Vertices of a pose, padding included.
    vertices: usize,
}

impl Wrinkles {
    /// Of a mesh that was packed as `layout`. A mask is the share by which the edges at a vertex get shorter, less than 0 where
    /// they get longer: of edges that go upwards (y of the mesh, along the surface), and of those across. An edge between the
    /// two directions counts for each by the fourth power of its cosine.
    ///
    /// # Errors
    /// A layout of another mesh.
    pub fn new(mesh: &MorphMesh, layout: &PackedLayout) -> Result<Self> {
        let (count, places) = (mesh.vertex_count(), places_of(mesh, layout)?);
        let edges = edges_at(mesh);
        let masks = mesh.targets.iter().map(|target| {
            let mut moved = vec![Vec3::ZERO; count];
            target.vertices.iter().zip(&target.positions).for_each(|(&v, &delta)| moved[v as usize] = delta);
            // A vertex that stays has edges to such as do not.
            let near: BTreeSet<u32> =
                target.vertices.iter().flat_map(|&v| edges[v as usize].iter().copied().chain([v])).collect();
            let mask = |v: u32| (places[v as usize], compressed(mesh, &moved, v as usize, &edges[v as usize]));
            near.into_iter().map(mask).filter(|(_, mask)| *mask != [0.0; 2]).collect()
        });
        Ok(Self { masks: masks.collect(), vertices: layout.padded_vertices() })
    }

    /// The masks of a pose, in the order of pose buffers: upwards and across. Weights beyond the targets are left out.
    pub fn of_pose(&self, weights: &[f32]) -> Vec<[f32; 2]> {
        let mut sums = vec![[0.0; 2]; self.vertices];
        for (mask, &weight) in self.masks.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            for (place, [up, across]) in mask {
                let sum = &mut sums[*place as usize];
                *sum = [sum[0] + weight * up, sum[1] + weight * across];
            }
        }
        sums
    }
}

/// For each vertex those that an edge of a face leads to.
fn edges_at(mesh: &MorphMesh) -> Vec<Vec<u32>> {
    let mut at = vec![BTreeSet::new(); mesh.vertex_count()];
    for face in mesh.faces.iter() {
        let corners: Vec<u32> = face.iter().map(|corner| corner.position).collect();
        for (&a, &b) in corners.iter().zip(corners.iter().cycle().skip(1)).filter(|(a, b)| a != b) {
            at[a as usize].insert(b);
            at[b as usize].insert(a);
        }
    }
    at.into_iter().map(|others| others.into_iter().collect()).collect()
}

/// By how much the edges at a vertex get shorter: upwards and across.
fn compressed(mesh: &MorphMesh, moved: &[Vec3], vertex: usize, others: &[u32]) -> [f32; 2] {
    let normal = mesh.normals[vertex];
    let up = normal.cross(Vec3::Y).cross(normal).normalize_or_zero();
    let axes = [up, up.cross(normal)];
    let (mut sums, mut shares) = ([0.0; 2], [0.0; 2]);
    for &other in others {
        let rest = mesh.positions[other as usize] - mesh.positions[vertex];
        let (length, now) = (rest.length(), (rest + moved[other as usize] - moved[vertex]).length());
        if length > 0.0 {
            for (axis, (sum, share)) in axes.iter().zip(sums.iter_mut().zip(&mut shares)) {
                let cosine = axis.dot(rest) / length;
                *sum += cosine.powi(4) * (1.0 - now / length);
                *share += cosine.powi(4);
            }
        }
    }
    [0, 1].map(|axis| if shares[axis] > 0.0 { sums[axis] / shares[axis] } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::{Corner, DeltaFormat, Faces, MorphTarget, PackDesc, PackedMesh, Tolerance};

    const SIDE: u32 = 9;

    /// A square grid that faces forwards; a target makes each position of it what `to` says.
    fn grid(to: &[&dyn Fn(Vec3) -> Vec3]) -> (MorphMesh, PackedMesh) {
        let positions: Vec<Vec3> =
            (0..SIDE * SIDE).map(|i| Vec3::new((i % SIDE) as f32, (i / SIDE) as f32, 0.0)).collect();
        let corner = |position| Corner { position, texcoord: None };
        let mut faces = Faces::default();
        for i in (0..SIDE * (SIDE - 1)).filter(|i| i % SIDE != SIDE - 1) {
            faces.sizes.push(4);
            faces.corners.extend([i, i + 1, i + SIDE + 1, i + SIDE].map(corner));
        }
        let target = |(number, to): (usize, &&dyn Fn(Vec3) -> Vec3)| MorphTarget {
            name: format!("target {number}"),
            vertices: (0..SIDE * SIDE).collect(),
            positions: positions.iter().map(|p| to(*p) - *p).collect(),
            normals: vec![Vec3::ZERO; positions.len()],
            streams: vec![],
        };
        let mesh = MorphMesh {
            normals: vec![Vec3::Z; positions.len()],
            diagonal: 8.0 * 2f32.sqrt(),
            targets: to.iter().enumerate().map(target).collect(),
            tolerance: Tolerance::ZERO,
            positions,
            faces,
            ..MorphMesh::default()
        };
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).expect("a mesh");
        (mesh, packed)
    }

    fn masks(to: &[&dyn Fn(Vec3) -> Vec3], weights: &[f32]) -> Vec<[f32; 2]> {
        let (mesh, packed) = grid(to);
        let folds = Wrinkles::new(&mesh, packed.layout()).expect("masks").of_pose(weights);
        let mut places: Vec<u32> = (0..SIDE * SIDE).collect();
        packed.layout().remap_indices(&mut places).expect("vertices of the mesh");
        places.into_iter().map(|place| folds[place as usize]).collect()
    }

    #[test]
    fn masks_are_the_share_that_edges_lose_in_each_direction() {
        let (flatter, wider) = (|p: Vec3| p * Vec3::new(1.0, 0.7, 1.0), |p: Vec3| p * Vec3::new(1.25, 1.0, 1.0));
        let turned = |p: Vec3| Vec3::new(-p.y, p.x, 0.0);
        let near = |masks: Vec<[f32; 2]>, want: [f32; 2]| {
            for mask in masks {
                assert!((mask[0] - want[0]).abs() < 1e-5 && (mask[1] - want[1]).abs() < 1e-5, "{mask:?}, not {want:?}");
            }
        };
        near(masks(&[&flatter], &[1.0]), [0.3, 0.0]);
        near(masks(&[&wider], &[1.0]), [0.0, -0.25]);
        near(masks(&[&flatter, &wider], &[0.5, -2.0]), [0.15, 0.5]);
        near(masks(&[&turned], &[1.0]), [0.0, 0.0]);
        near(masks(&[&flatter], &[0.0]), [0.0, 0.0]);
    }

    #[test]
    fn vertices_beside_those_that_move_have_masks_too_and_others_none() {
        let row = (SIDE / 2) as f32;
        let raised = |p: Vec3| if p.y == row { p + Vec3::Y * 0.5 } else { p };
        for (v, [up, across]) in masks(&[&raised], &[1.0]).into_iter().enumerate() {
            let want = match v as u32 / SIDE {
                3 => -0.25, // the edge above is longer by a half, the one below as long
                5 => 0.25,
                _ => 0.0,
            };
            assert!((up - want).abs() < 1e-6 && across == 0.0, "{v}: {up}");
        }
    }
}
