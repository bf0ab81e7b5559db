//! Wrinkle masks: how much each target compresses or stretches the skin, computed from the edges of faces.
//!
//! Galanakis ("Texture-based Blendshapes in DX9") keeps a mask with the deltas of each target, sums the masks by weight
//! like deltas, and blends in a wrinkle normal map where the sum is large. Here there are two masks and two maps: skin
//! compressed vertically gets horizontal lines, as with raised brows; skin compressed horizontally gets vertical ones.
//!
//! Masks are a stream of the mesh ([`Semantic::Mask`]): [`add`] makes it, packing includes it, and updates sum it on
//! the device, writing only changes. A mesh without the stream has no cost.

use deltamorph::mesh::{StreamData, StreamDeltas};
use deltamorph::{KeptMesh, PackedMesh, PoseFormat, Semantic};
use glam::Vec3;
use std::collections::BTreeSet;

/// Adds the stream [`Semantic::Mask`] to `mesh`, if it has none. A mask is the fraction by which the edges at a vertex
/// get shorter at weight 1, negative if they get longer: one for vertical edges (y of the mesh, along the surface), one
/// for horizontal edges. An edge in between counts for each by the fourth power of its cosine.
pub fn add(mesh: &mut KeptMesh) {
    if mesh.streams.iter().any(|stream| stream.semantic == Semantic::Mask) {
        return;
    }
    let count = mesh.vertex_count();
    let edges = edges_at(mesh);
    let masks: Vec<StreamDeltas> = mesh
        .targets
        .iter()
        .map(|target| {
            let mut moved = vec![Vec3::ZERO; count];
            target.vertices.iter().zip(&target.positions).for_each(|(&v, &delta)| moved[v as usize] = delta);
            // Vertices that do not move may have edges to vertices that do.
            let near: BTreeSet<u32> =
                target.vertices.iter().flat_map(|&v| edges[v as usize].iter().copied().chain([v])).collect();
            let mask = |v: u32| (v, compressed(mesh, &moved, v as usize, &edges[v as usize]));
            let masks = near.into_iter().map(mask).filter(|(_, mask)| *mask != [0.0; 2]);
            let (vertices, deltas): (Vec<u32>, Vec<[f32; 2]>) = masks.unzip();
            StreamDeltas { vertices, deltas: deltas.into_flattened() }
        })
        .collect();
    let streams = mesh.streams.len();
    for (target, masks) in mesh.targets.iter_mut().zip(masks) {
        // Streams after a target's last one do not change, so missing ones are added empty.
        target.streams.resize(streams, StreamDeltas::default());
        target.streams.push(masks);
    }
    mesh.streams.push(StreamData { semantic: Semantic::Mask, values: vec![0.0; 2 * count] });
}

/// Location of the masks in the stored poses of a packed mesh, for poses that the host provides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaskPlace {
    /// The [group](PackedMesh::groups) that has the masks.
    pub group: usize,
    pub(crate) first: usize,
}

impl MaskPlace {
    /// Finds the masks of a mesh; `None` if it has none.
    pub fn of(packed: &PackedMesh) -> Option<Self> {
        let places = packed
            .groups()
            .iter()
            .enumerate()
            .flat_map(|(group, packed)| packed.layout().streams.iter().map(move |place| (group, *place)));
        let mut masks = places.filter(|(_, place)| place.semantic == Semantic::Mask);
        masks.next().map(|(group, place)| Self { group, first: place.first })
    }

    /// Returns the offset in bytes of the masks in a vertex of the group's pose.
    pub fn offset(&self, pose: PoseFormat) -> u64 {
        (self.first * pose.stride() / GROUP_COMPONENTS) as u64
    }
}

/// Numbers per vertex in a group.
const GROUP_COMPONENTS: usize = deltamorph::POSE_FLOATS;

/// Returns, for each vertex, the vertices at the other end of its edges.
fn edges_at(mesh: &KeptMesh) -> Vec<Vec<u32>> {
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

/// Returns how much the edges at a vertex get shorter: vertically and horizontally.
fn compressed(mesh: &KeptMesh, moved: &[Vec3], vertex: usize, others: &[u32]) -> [f32; 2] {
    let normal = mesh.normals[vertex];
    let up = normal.cross(Vec3::Y).cross(normal).normalize_or_zero();
    let axes = [up, up.cross(normal)];
    let mut sums = [0.0; 2];
    let mut shares = [0.0; 2];
    for &other in others {
        let rest = mesh.positions[other as usize] - mesh.positions[vertex];
        let length = rest.length();
        let now = (rest + moved[other as usize] - moved[vertex]).length();
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
    use deltamorph::mesh::{Corner, Faces, KeptTarget};
    use deltamorph::reference::{evaluate_group, evaluate_unpacked_group};
    use deltamorph::{DeltaFormat, PackDesc, Tolerance};

    const SIDE: u32 = 9;

    /// Makes a square grid that faces forwards, with a target for each function of positions in `to`.
    fn grid(to: &[&dyn Fn(Vec3) -> Vec3]) -> KeptMesh {
        let positions: Vec<Vec3> =
            (0..SIDE * SIDE).map(|i| Vec3::new((i % SIDE) as f32, (i / SIDE) as f32, 0.0)).collect();
        let corner = |position| Corner { position, texcoord: None };
        let mut faces = Faces::default();
        for i in (0..SIDE * (SIDE - 1)).filter(|i| i % SIDE != SIDE - 1) {
            faces.sizes.push(4);
            faces.corners.extend([i, i + 1, i + SIDE + 1, i + SIDE].map(corner));
        }
        let target = |(number, to): (usize, &&dyn Fn(Vec3) -> Vec3)| KeptTarget {
            name: format!("target {number}"),
            vertices: (0..SIDE * SIDE).collect(),
            positions: positions.iter().map(|p| to(*p) - *p).collect(),
            normals: vec![Vec3::ZERO; positions.len()],
            streams: vec![],
        };
        let mut mesh = KeptMesh {
            normals: vec![Vec3::Z; positions.len()],
            diagonal: 8.0 * 2f32.sqrt(),
            targets: to.iter().enumerate().map(target).collect(),
            tolerance: Tolerance::ZERO,
            positions,
            faces,
            ..KeptMesh::default()
        };
        add(&mut mesh);
        mesh
    }

    /// Computes the sums in float64, of the added deltas and of the packed ones.
    fn masks(to: &[&dyn Fn(Vec3) -> Vec3], weights: &[f32]) -> Vec<[f32; 2]> {
        let mesh = grid(to);
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Float32)).expect("a mesh");
        let place = MaskPlace::of(&packed).expect("masks");
        assert_eq!((place.group, place.first, packed.groups().len()), (1, 0, 2));
        let pose = evaluate_group(&packed.groups()[place.group], weights);
        assert_eq!(pose, evaluate_unpacked_group(&mesh, &packed.groups()[1].layout().streams, weights));
        pose.chunks_exact(6).map(|numbers| [numbers[0] as f32, numbers[1] as f32]).collect()
    }

    #[test]
    fn masks_are_the_share_that_edges_lose_in_each_direction() {
        let flatter = |p: Vec3| p * Vec3::new(1.0, 0.7, 1.0);
        let wider = |p: Vec3| p * Vec3::new(1.25, 1.0, 1.0);
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

    #[test]
    fn masks_that_are_there_stay_and_other_streams_keep_their_deltas() {
        let mut mesh = grid(&[&|p| p * 0.5]);
        let once = mesh.clone();
        add(&mut mesh);
        assert_eq!((&mesh.streams, &mesh.targets), (&once.streams, &once.targets), "added once");
        let values = vec![0.0; 2 * mesh.vertex_count()];
        mesh.streams = vec![StreamData { semantic: Semantic::TexCoord(0), values }];
        mesh.targets[0].streams.clear();
        add(&mut mesh);
        let [texcoords, masks] = &mesh.targets[0].streams[..] else { panic!("two streams") };
        assert!(texcoords.vertices.is_empty() && *masks == once.targets[0].streams[0]);
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).expect("a mesh");
        let place = MaskPlace::of(&packed).expect("masks");
        // After two texture coordinates, one mask in each triple.
        assert_eq!((place.offset(PoseFormat::Fixed16), place.offset(PoseFormat::Float32)), (4, 8));
    }
}
