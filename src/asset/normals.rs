//! Area-weighted vertex normals, of a whole surface and of the part that a target moves.
//!
//! A normal belongs to a position: a seam in the texture coordinates splits nothing. The normal of a vertex is
//! the sum of the area vectors of its faces, in the order of the face list, normalised. The area vector of a face
//! is computed once, however many corners ask for it. Every normal is gathered on its own from its faces, in double
//! precision, so that computing a few of them gives the same bits as computing all.

use super::Faces;
use glam::{DVec3, Vec3};

/// Which faces meet at a vertex.
#[derive(Clone, Debug, Default)]
pub struct Adjacency {
    /// Corners (position indices) of all faces.
    corners: Vec<u32>,
    /// Where each face starts in `corners`; one more at the end.
    face_starts: Vec<u32>,
    /// Faces of all vertices, ascending for each vertex.
    vertex_faces: Vec<u32>,
    /// Where each vertex starts in `vertex_faces`; one more at the end.
    vertex_starts: Vec<u32>,
}

impl Adjacency {
    /// Of `faces` over `vertices` positions. Every position index must be below `vertices`.
    pub fn new(faces: &Faces, vertices: usize) -> Self {
        let corners: Vec<u32> = faces.corners.iter().map(|c| c.position).collect();
        let mut face_starts = Vec::with_capacity(faces.sizes.len() + 1);
        face_starts.push(0);
        let mut end = 0;
        face_starts.extend(faces.sizes.iter().map(|&n| {
            end += n;
            end
        }));

        let mut vertex_starts = vec![0u32; vertices + 1];
        for &v in &corners {
            vertex_starts[v as usize + 1] += 1;
        }
        for v in 0..vertices {
            vertex_starts[v + 1] += vertex_starts[v];
        }
        let mut next = vertex_starts.clone();
        let mut vertex_faces = vec![0; corners.len()];
        for (face, range) in face_starts.windows(2).enumerate() {
            for &v in &corners[range[0] as usize..range[1] as usize] {
                vertex_faces[next[v as usize] as usize] = face as u32;
                next[v as usize] += 1;
            }
        }
        Self { corners, face_starts, vertex_faces, vertex_starts }
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertex_starts.len().saturating_sub(1)
    }

    /// The faces that meet at `vertex`, ascending; a face that names the vertex twice is there twice.
    pub fn faces_of(&self, vertex: u32) -> &[u32] {
        let v = vertex as usize;
        &self.vertex_faces[self.vertex_starts[v] as usize..self.vertex_starts[v + 1] as usize]
    }

    /// The position indices of a face.
    pub fn corners_of(&self, face: u32) -> &[u32] {
        let f = face as usize;
        &self.corners[self.face_starts[f] as usize..self.face_starts[f + 1] as usize]
    }

    /// Twice the area of a face along its normal (of a polygon: the sum over its triangle fan).
    pub fn area_vector(&self, face: u32, positions: &[Vec3]) -> DVec3 {
        let corners = self.corners_of(face);
        let at = |i: u32| positions[i as usize].as_dvec3();
        let origin = at(corners[0]);
        let mut sum = DVec3::ZERO;
        let mut before = at(corners[1]) - origin;
        for &c in &corners[2..] {
            let edge = at(c) - origin;
            sum += before.cross(edge);
            before = edge;
        }
        sum
    }

    /// The area vectors of all faces.
    fn area_vectors(&self, positions: &[Vec3]) -> Vec<DVec3> {
        (0..self.face_starts.len().saturating_sub(1)).map(|f| self.area_vector(f as u32, positions)).collect()
    }

    /// The normal of one vertex, from the area vectors of all faces; `None` where it has no face, or its faces have
    /// no area or cancel out.
    fn normal(&self, vertex: u32, areas: &[DVec3]) -> Option<Vec3> {
        let sum: DVec3 = self.faces_of(vertex).iter().map(|&f| areas[f as usize]).sum();
        let length = sum.length();
        (length > 0.0 && length.is_finite()).then(|| (sum / length).as_vec3())
    }
}

/// The normals of a surface, one per position, unit length; [`Vec3::Z`] where a vertex has none (no face, or
/// faces without area).
pub fn vertex_normals(adjacency: &Adjacency, positions: &[Vec3]) -> Vec<Vec3> {
    let areas = adjacency.area_vectors(positions);
    (0..adjacency.vertex_count()).map(|v| adjacency.normal(v as u32, &areas).unwrap_or(Vec3::Z)).collect()
}

/// Normals of deformed copies of one surface: only those that a deformation can change are computed.
#[derive(Clone, Debug)]
pub struct Deformer<'a> {
    adjacency: &'a Adjacency,
    base: &'a [Vec3],
    /// The base again: deformed and restored by every call.
    positions: Vec<Vec3>,
    /// The area vectors of the base: those of the deformed surface during a call.
    areas: Vec<DVec3>,
}

impl<'a> Deformer<'a> {
    /// For deformations of `base`, which has a position for every vertex of `adjacency`.
    pub fn new(adjacency: &'a Adjacency, base: &'a [Vec3]) -> Self {
        Self { adjacency, base, positions: base.to_vec(), areas: adjacency.area_vectors(base) }
    }

    /// The normals of `base + moved` at every vertex that shares a face with a moved one, ascending by vertex.
    /// Elsewhere the normals are those of the base, bit for bit. `None` where the deformed surface has no
    /// normal (a face folded to nothing): take the base normal, so that the delta is zero.
    pub fn normals(&mut self, moved: &[(u32, Vec3)]) -> Vec<(u32, Option<Vec3>)> {
        for &(v, delta) in moved {
            self.positions[v as usize] = self.base[v as usize] + delta;
        }
        // Every face once: a polygon that moves at all its corners would otherwise be walked once for each.
        let (mut seen_faces, mut seen_vertices) = (vec![false; self.areas.len()], vec![false; self.base.len()]);
        let mut unseen = |face: &u32| !std::mem::replace(&mut seen_faces[*face as usize], true);
        let mut restore = Vec::new();
        let mut touched = Vec::new();
        for &face in moved.iter().flat_map(|&(v, _)| self.adjacency.faces_of(v)).filter(|face| unseen(face)) {
            let area = self.adjacency.area_vector(face, &self.positions);
            restore.push((face, std::mem::replace(&mut self.areas[face as usize], area)));
            let mut unseen = |v: &u32| !std::mem::replace(&mut seen_vertices[*v as usize], true);
            touched.extend(self.adjacency.corners_of(face).iter().copied().filter(|v| unseen(v)));
        }
        touched.sort_unstable();
        let normals = touched.iter().map(|&v| (v, self.adjacency.normal(v, &self.areas))).collect();
        restore.into_iter().for_each(|(face, area)| self.areas[face as usize] = area);
        moved.iter().for_each(|&(v, _)| self.positions[v as usize] = self.base[v as usize]);
        normals
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::Corner;
    use proptest::prelude::*;

    /// An n × n grid of quads.
    fn grid(n: u32) -> (Faces, Vec<Vec3>) {
        let mut faces = Faces::default();
        for (x, y) in (0..n).flat_map(|y| (0..n).map(move |x| (x, y))) {
            let v = y * (n + 1) + x;
            faces.sizes.push(4);
            faces.corners.extend([v, v + 1, v + n + 2, v + n + 1].map(|position| Corner { position, texcoord: None }));
        }
        let positions = (0..(n + 1) * (n + 1)).map(|i| Vec3::new((i % (n + 1)) as f32, (i / (n + 1)) as f32, 0.0));
        (faces, positions.collect())
    }

    #[test]
    fn a_flat_grid_faces_up_and_a_lone_vertex_falls_back() {
        let (faces, mut positions) = grid(3);
        positions.push(Vec3::splat(9.0));
        let adjacency = Adjacency::new(&faces, positions.len());
        assert_eq!(vertex_normals(&adjacency, &positions), vec![Vec3::Z; positions.len()]);
    }

    #[test]
    fn large_faces_weigh_more() {
        // Two triangles share the edge 0-1: one of area 8 facing +Z, one of area 2 facing -Y.
        let positions = [Vec3::ZERO, Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.0, 4.0, 0.0), Vec3::new(0.0, 0.0, 1.0)];
        let faces = Faces {
            sizes: vec![3, 3],
            corners: [0, 1, 2, 0, 1, 3].map(|position| Corner { position, texcoord: None }).to_vec(),
        };
        let n = vertex_normals(&Adjacency::new(&faces, 4), &positions)[0];
        assert!((n - Vec3::new(0.0, -4.0, 16.0).normalize()).length() < 1e-6, "{n}");
    }

    proptest! {
        #[test]
        fn recomputing_the_neighbourhood_equals_recomputing_all(
            moves in prop::collection::btree_map(0u32..49, prop::array::uniform3(-2.0f32..2.0), 0..12),
        ) {
            let (faces, mut base) = grid(6);
            for (i, p) in base.iter_mut().enumerate() {
                p.z = ((i * 37) % 11) as f32 * 0.1;
            }
            let adjacency = Adjacency::new(&faces, base.len());
            let moved: Vec<_> = moves.into_iter().map(|(v, d)| (v, Vec3::from_array(d))).collect();
            let mut deformed = base.clone();
            for &(v, d) in &moved {
                deformed[v as usize] += d;
            }
            let expected = vertex_normals(&adjacency, &deformed);
            let mut deformer = Deformer::new(&adjacency, &base);
            for _ in 0..2 {
                let mut found = vertex_normals(&adjacency, &base);
                for (v, n) in deformer.normals(&moved) {
                    found[v as usize] = n.unwrap_or(Vec3::Z);
                }
                prop_assert_eq!(&found, &expected);
            }
        }
    }
}
