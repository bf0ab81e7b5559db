//! Normals of the morphed surface. Sums of normal deltas are exact for a single target, but approximate for several;
//! this step recomputes normals from positions.

mod fans;
#[allow(unsafe_code)]
mod step;

use crate::error::Result;
use glam::DVec3;
pub(super) use step::Surface;
pub use step::{GpuNormals, NormalsTarget};

/// The surface of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalsDesc<'a> {
    /// The vertices of all faces, face by face, in the user's order: an index buffer.
    pub corners: &'a [u32],
    /// Corners of each face, 3 or more; empty: 3 each. A polygon's area counts at all its corners, as on import; cut
    /// into triangles ([`Faces::triangles`](crate::mesh::Faces::triangles)), it would depend on the cut.
    pub sizes: &'a [u32],
    /// For each vertex the first one at the same position, or empty: [`Mesh::welds`](crate::Mesh::welds).
    /// Welded vertices share triangles and get bit-equal normals, so that seams are invisible.
    pub welds: &'a [u32],
}

impl<'a> NormalsDesc<'a> {
    /// The triangles of an index buffer, without welds.
    pub fn new(corners: &'a [u32]) -> Self {
        Self { corners, sizes: &[], welds: &[] }
    }

    fn faces(&self) -> impl Iterator<Item = &'a [u32]> + use<'a> {
        let triangles = if self.sizes.is_empty() { self.corners.len() / 3 } else { 0 };
        let sizes = self.sizes;
        let mut rest = self.corners;
        let sizes = std::iter::repeat_n(3, triangles).chain(sizes.iter().copied());
        sizes.map(move |size| rest.split_off(..size as usize).unwrap_or_default())
    }
}

/// Computes the normals of a pose in double precision: area-weighted as on import, of unit length, three numbers per
/// vertex in the user's order; 0 if the triangles of a vertex have no area, or cancel out. `pose` as from
/// [`evaluate`](crate::reference::evaluate).
///
/// # Errors
/// A surface that [`upload_normals`](crate::MorphEngine::upload_normals) rejects.
pub fn normals(pose: &[f64], desc: &NormalsDesc<'_>) -> Result<Vec<f64>> {
    let pose = pose.as_chunks::<6>().0;
    let place = |v: u32| DVec3::from_slice(&pose[v as usize]);
    let of = fans::first_of(desc, pose.len())?;
    let mut sums = vec![DVec3::ZERO; pose.len()];
    for face in desc.faces() {
        let from = place(face[0]);
        let fan = face[1..].windows(2).map(|two| (place(two[0]) - from).cross(place(two[1]) - from));
        let area: DVec3 = fan.sum();
        face.iter().for_each(|corner| sums[of(*corner) as usize] += area);
    }
    Ok((0..pose.len() as u32).flat_map(|v| sums[of(v) as usize].normalize_or_zero().to_array()).collect())
}
