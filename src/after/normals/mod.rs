//! Normals of the morphed surface, where morphed normals are not good enough: sums of normal deltas are right for each
//! target by itself, and approximate for several at once.

mod fans;
#[allow(unsafe_code)]
mod step;

use crate::error::Result;
use crate::setters::setters;
use glam::DVec3;
pub(crate) use step::Recomputed;
pub use step::{GpuNormals, NormalsTarget};

/// The surface of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct NormalsDesc<'a> {
    /// The vertices of all faces, one face after the other, in the user's order of vertices: an index buffer.
    pub corners: &'a [u32],
    /// Corners of each face, 3 or more; nothing at all: three each. The area of a polygon counts at all its corners, as
    /// on import: cut into triangles ([`Faces::triangles`](crate::Faces::triangles)) it would count by how it was cut.
    pub sizes: &'a [u32],
    /// For each vertex the first one at its place, or nothing at all: [`MorphMesh::welds`](crate::MorphMesh::welds).
    /// Welded vertices have the triangles of all, and the same normal, bit for bit: no seam shows.
    pub welds: &'a [u32],
}

setters!(NormalsDesc<'a> { sizes: &'a [u32], welds: &'a [u32] });

impl<'a> NormalsDesc<'a> {
    /// The triangles of an index buffer; no vertices are welded.
    pub fn new(corners: &'a [u32]) -> Self {
        Self { corners, sizes: &[], welds: &[] }
    }

    /// The corners of each face.
    fn faces(&self) -> impl Iterator<Item = &'a [u32]> + use<'a> {
        let (triangles, sizes) = (if self.sizes.is_empty() { self.corners.len() / 3 } else { 0 }, self.sizes);
        let mut rest = self.corners;
        let sizes = std::iter::repeat_n(3, triangles).chain(sizes.iter().copied());
        sizes.map(move |size| rest.split_off(..size as usize).unwrap_or_default())
    }
}

/// Normals of a pose in double precision: area-weighted, as on import, with unit length, three numbers for each vertex
/// in the user's order; 0 where the triangles of a vertex have no area, or cancel out. `pose` as
/// [`evaluate`](crate::reference::evaluate) gives it.
///
/// # Errors
/// A surface that [`upload_normals`](crate::MorphEngine::upload_normals) refuses.
pub fn normals(pose: &[f64], desc: &NormalsDesc<'_>) -> Result<Vec<f64>> {
    let pose = pose.as_chunks::<6>().0;
    let (place, of) = (|v: u32| DVec3::from_slice(&pose[v as usize]), fans::first_of(desc, pose.len())?);
    let mut sums = vec![DVec3::ZERO; pose.len()];
    for face in desc.faces() {
        let from = place(face[0]);
        let fan = face[1..].windows(2).map(|two| (place(two[0]) - from).cross(place(two[1]) - from));
        let area: DVec3 = fan.sum();
        face.iter().for_each(|corner| sums[of(*corner) as usize] += area);
    }
    Ok((0..pose.len() as u32).flat_map(|v| sums[of(v) as usize].normalize_or_zero().to_array()).collect())
}
