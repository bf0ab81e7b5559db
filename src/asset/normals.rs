//! Area-weighted vertex normals of a whole surface, and of the part that a target moves.
//!
//! A normal belongs to a position: a seam in the texture coordinates splits nothing. The normal of a vertex is
//! the sum of the area vectors of its faces, in the order of the face list, normalised. Every normal is gathered on its
//! own, in double precision, so that computing a few of them gives the same bits as computing all.

use super::{Corner, Faces};
use glam::{DVec3, Vec3};

/// Faces over positions, their normals, and the faces that meet at each vertex.
#[derive(Clone, Debug)]
pub struct Surface<'a> {
    positions: &'a [Vec3],
    faces: Vec<&'a [Corner]>,
    /// Faces of all vertices, ascending for each vertex; a face that names a vertex twice is listed twice.
    vertex_faces: Vec<u32>,
    /// Start of each vertex in `vertex_faces`, and the end of the last.
    vertex_starts: Vec<u32>,
    areas: Vec<DVec3>,
    /// One per position, unit length; [`Vec3::Z`] for a vertex without one (no face, or faces without area).
    pub normals: Vec<Vec3>,
}

impl<'a> Surface<'a> {
    /// Computes the normals of `faces` over `positions`. Faces must have three corners or more, each within
    /// `positions`.
    pub fn new(faces: &'a Faces, positions: &'a [Vec3]) -> Self {
        let mut vertex_starts = vec![0u32; positions.len() + 1];
        for corner in &faces.corners {
            vertex_starts[corner.position as usize + 1] += 1;
        }
        for v in 0..positions.len() {
            vertex_starts[v + 1] += vertex_starts[v];
        }
        let mut next = vertex_starts.clone();
        let mut vertex_faces = vec![0; faces.corners.len()];
        let faces: Vec<&[Corner]> = faces.iter().collect();
        for (face, corners) in (0..).zip(&faces) {
            for corner in *corners {
                let next = &mut next[corner.position as usize];
                vertex_faces[*next as usize] = face;
                *next += 1;
            }
        }
        let areas = faces.iter().map(|face| area_vector(face, positions)).collect();
        let mut surface = Self { positions, faces, vertex_faces, vertex_starts, areas, normals: vec![] };
        let normal = |v| surface.normal(v, &surface.areas).unwrap_or(Vec3::Z);
        surface.normals = (0..positions.len() as u32).map(normal).collect();
        surface
    }

    /// The faces that meet at `vertex`, ascending.
    fn faces_of(&self, vertex: u32) -> &[u32] {
        let v = vertex as usize;
        &self.vertex_faces[self.vertex_starts[v] as usize..self.vertex_starts[v + 1] as usize]
    }

    /// The normal of one vertex, from the area vectors of all faces; `None` if it has no face, or its faces have no
    /// area or cancel out.
    fn normal(&self, vertex: u32, areas: &[DVec3]) -> Option<Vec3> {
        let sum: DVec3 = self.faces_of(vertex).iter().map(|&f| areas[f as usize]).sum();
        let length = sum.length();
        (length > 0.0 && length.is_finite()).then(|| (sum / length).as_vec3())
    }
}

/// Brings the stated normals to unit length. Returns them, the factor that each was multiplied by (its deltas need it,
/// too), and the number of normals too short to give a direction (unreferenced, zero in the file, opposite sides
/// averaged out). Those are computed, and their factor is 0.
pub fn unit_normals(stated: &[Vec3], faces: &Faces, positions: &[Vec3]) -> (Vec<Vec3>, Vec<f32>, usize) {
    let lengths: Vec<f64> = stated.iter().map(|normal| normal.as_dvec3().length()).collect();
    let lost = lengths.iter().filter(|length| **length < 1e-6).count();
    let mut units = if lost > 0 { Surface::new(faces, positions).normals } else { vec![Vec3::ZERO; lengths.len()] };
    let mut scales = vec![0.0; lengths.len()];
    for (v, &length) in lengths.iter().enumerate().filter(|(_, length)| **length >= 1e-6) {
        units[v] = (stated[v].as_dvec3() / length).as_vec3();
        scales[v] = (1.0 / length) as f32;
    }
    (units, scales, lost)
}

/// Twice the area of a face along its normal (for a polygon, the sum over its triangle fan).
pub fn area_vector(face: &[Corner], positions: &[Vec3]) -> DVec3 {
    let at = |corner: &Corner| positions[corner.position as usize].as_dvec3();
    let origin = at(&face[0]);
    face[1..].windows(2).map(|w| (at(&w[0]) - origin).cross(at(&w[1]) - origin)).sum()
}

/// Deforms a surface for one target after another; computes only the normals that a target can change.
#[derive(Clone, Debug)]
pub struct Deformer<'a> {
    surface: &'a Surface<'a>,
    /// Positions of the surface; deformed and restored by every call.
    positions: Vec<Vec3>,
    areas: Vec<DVec3>,
    /// Faces and vertices that the current call has visited; all false between calls. Kept, since clearing them would
    /// take each call time for the whole mesh.
    seen_faces: Vec<bool>,
    seen_vertices: Vec<bool>,
}

impl<'a> Deformer<'a> {
    /// For deformations of `surface`.
    pub fn new(surface: &'a Surface<'a>) -> Self {
        Self {
            surface,
            positions: surface.positions.to_vec(),
            areas: surface.areas.clone(),
            seen_faces: vec![false; surface.areas.len()],
            seen_vertices: vec![false; surface.positions.len()],
        }
    }

    /// Returns the changes of the normals when vertices are `moved`, for every vertex that shares a face with one of
    /// them, ascending. All other normals stay, bit for bit. The change is zero if the deformed surface has no normal
    /// (a face folded to nothing).
    pub fn normal_deltas(&mut self, moved: &[(u32, Vec3)]) -> Vec<(u32, Vec3)> {
        let Self { surface, positions, areas, seen_faces, seen_vertices } = self;
        moved.iter().for_each(|&(v, delta)| positions[v as usize] += delta);
        // Each face once: a polygon that moves at all its corners would otherwise be walked once for each.
        let unseen = |seen: &mut [bool], i: u32| !std::mem::replace(&mut seen[i as usize], true);
        let mut faces = vec![];
        let mut touched = vec![];
        for &face in moved.iter().flat_map(|&(v, _)| surface.faces_of(v)).filter(|f| unseen(seen_faces, **f)) {
            let corners = surface.faces[face as usize];
            areas[face as usize] = area_vector(corners, positions);
            faces.push(face as usize);
            touched.extend(corners.iter().map(|c| c.position).filter(|v| unseen(seen_vertices, *v)));
        }
        touched.sort_unstable();
        let delta = |v: u32| surface.normal(v, areas).map_or(Vec3::ZERO, |n| n - surface.normals[v as usize]);
        let deltas = touched.iter().map(|&v| (v, delta(v))).collect();
        for face in faces {
            areas[face] = surface.areas[face];
            seen_faces[face] = false;
        }
        touched.into_iter().for_each(|v| seen_vertices[v as usize] = false);
        moved.iter().for_each(|&(v, _)| positions[v as usize] = surface.positions[v as usize]);
        deltas
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn faces(sizes: Vec<u32>, corners: impl IntoIterator<Item = u32>) -> Faces {
        let corners = corners.into_iter().map(|position| Corner { position, texcoord: None });
        Faces { sizes, corners: corners.collect() }
    }

    #[test]
    fn large_faces_weigh_more_and_a_lone_vertex_falls_back() {
        // Two triangles share the edge 0-1: one of area 8 facing +Z, one of area 2 facing -Y.
        let positions = [Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 4.0, Vec3::Z, Vec3::ONE];
        let normals = Surface::new(&faces(vec![3, 3], [0, 1, 2, 0, 1, 3]), &positions).normals;
        assert!((normals[0] - Vec3::new(0.0, -4.0, 16.0).normalize()).length() < 1e-6, "{normals:?}");
        assert_eq!((normals[2], normals[3], normals[4]), (Vec3::Z, Vec3::NEG_Y, Vec3::Z));
    }

    /// The rule of [`Mesh::pack`](crate::Mesh::pack), for hosts that compare their own normals.
    #[test]
    fn a_polygon_counts_with_its_whole_area_at_each_corner() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 1.0), Vec3::Y];
        let whole = Vec3::new(-1.0, -1.0, 2.0).normalize();
        let normals = Surface::new(&faces(vec![4], 0..4), &positions).normals;
        assert!(normals.iter().all(|normal| (*normal - whole).length() < 1e-6), "{normals:?}");
        let fan = Surface::new(&faces(vec![3, 3], [0, 1, 2, 0, 2, 3]), &positions).normals;
        assert!(fan[1].angle_between(whole) > 0.5, "of triangles it is another: {fan:?}");
    }

    proptest! {
        #[test]
        fn recomputing_the_neighbourhood_equals_recomputing_all(
            moves in prop::collection::btree_map(0u32..49, prop::array::uniform3(-2.0f32..2.0), 0..12),
        ) {
            // A grid of 6 × 6 quads.
            let quads = (0..36).map(|q| q / 6 * 7 + q % 6).flat_map(|v| [v, v + 1, v + 8, v + 7]);
            let faces = faces(vec![4; 36], quads);
            let base: Vec<Vec3> =
                (0..49).map(|i| Vec3::new((i % 7) as f32, (i / 7) as f32, ((i * 37) % 11) as f32 * 0.1)).collect();
            let moved: Vec<_> = moves.into_iter().map(|(v, d)| (v, Vec3::from_array(d))).collect();
            let mut deformed = base.clone();
            moved.iter().for_each(|&(v, d)| deformed[v as usize] += d);
            let (surface, expected) = (Surface::new(&faces, &base), Surface::new(&faces, &deformed).normals);
            let expected: Vec<Vec3> = expected.iter().zip(&surface.normals).map(|(to, from)| *to - *from).collect();
            let mut deformer = Deformer::new(&surface);
            for _ in 0..2 {
                let mut found = vec![Vec3::ZERO; base.len()];
                deformer.normal_deltas(&moved).into_iter().for_each(|(v, d)| found[v as usize] = d);
                prop_assert_eq!(&found, &expected);
            }
        }
    }
}
