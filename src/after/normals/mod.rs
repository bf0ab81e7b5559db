//! Normals of the morphed surface. Sums of normal deltas are exact for a single target, but approximate for several;
//! this step recomputes normals from positions.

mod fans;
#[allow(unsafe_code)]
mod step;

use crate::asset::{Corner, Faces};
use crate::error::Result;
use glam::DVec3;
pub use step::GpuNormals;
pub(super) use step::Surface;

/// Computes the normals of a pose in double precision: area-weighted as on import, of unit length, three numbers per
/// vertex in the user's order; 0 if the triangles of a vertex have no area, or cancel out. `pose` as from
/// [`evaluate`](crate::reference::evaluate).
///
/// # Errors
/// Faces and welds that [`upload_normals`](crate::MorphEngine::upload_normals) rejects.
pub fn normals(pose: &[f64], faces: &Faces, welds: &[u32]) -> Result<Vec<f64>> {
    let pose = pose.as_chunks::<6>().0;
    let place = |corner: &Corner| DVec3::from_slice(&pose[corner.position as usize]);
    let of = fans::first_of(faces, welds, pose.len())?;
    let mut sums = vec![DVec3::ZERO; pose.len()];
    for face in faces.iter() {
        let from = place(&face[0]);
        let fan = face[1..].windows(2).map(|two| (place(&two[0]) - from).cross(place(&two[1]) - from));
        let area: DVec3 = fan.sum();
        face.iter().for_each(|corner| sums[of(corner.position) as usize] += area);
    }
    Ok((0..pose.len() as u32).flat_map(|v| sums[of(v) as usize].normalize_or_zero().to_array()).collect())
}
