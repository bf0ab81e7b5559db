//! The oracle: full evaluation from base in float64, and how far a pose is from it.

pub use crate::math::angle_degrees;
use crate::mesh::MorphMesh;
use crate::pack::{POSE_FLOATS, PackedMesh};
use glam::DVec3;

/// Below this length a morphed normal has no direction worth the name; consumers fall back to the base normal.
pub const SHORTEST_NORMAL: f64 = 1e-3;

/// `base + Σ weight · delta` over all targets, on the deltas that the kernels see (kept after import, packed).
/// Six values per vertex, in the user's order and without padding: position, then the unnormalised normal.
/// Targets without a weight have the weight 0.
pub fn evaluate(mesh: &PackedMesh, weights: &[f32]) -> Vec<f64> {
    let mut pose: Vec<f64> = mesh.layout().to_user_order(mesh.base()).into_iter().map(f64::from).collect();
    for (target, &weight) in weights.iter().take(mesh.layout().targets.len()).enumerate().filter(|(_, w)| **w != 0.0) {
        mesh.for_each_delta(target, |vertex, delta| {
            for (out, delta) in pose[vertex * POSE_FLOATS..][..POSE_FLOATS].iter_mut().zip(delta) {
                *out += f64::from(weight) * delta;
            }
        });
    }
    pose
}

/// As [`evaluate`], on the deltas of `mesh` itself: with a mesh made at tolerance zero, what the files say.
pub fn evaluate_unpacked(mesh: &MorphMesh, weights: &[f32]) -> Vec<f64> {
    let mut pose: Vec<f64> = mesh
        .positions
        .iter()
        .zip(&mesh.normals)
        .flat_map(|(p, n)| [p.x, p.y, p.z, n.x, n.y, n.z].map(f64::from))
        .collect();
    for (target, &weight) in mesh.targets.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
        for ((&vertex, p), n) in target.vertices.iter().zip(&target.positions).zip(&target.normals) {
            let out = &mut pose[vertex as usize * POSE_FLOATS..][..POSE_FLOATS];
            for (out, delta) in out.iter_mut().zip(p.to_array().into_iter().chain(n.to_array())) {
                *out += f64::from(weight) * f64::from(delta);
            }
        }
    }
    pose
}

/// The largest errors of a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseError {
    /// Largest distance of a vertex from where it should be, in input units. NaN when the pose holds one.
    pub position: f64,
    /// Largest angle between normals, after normalisation, in degrees.
    pub normal_degrees: f64,
}

impl PoseError {
    /// The larger of both, each.
    pub fn max(self, other: Self) -> Self {
        // f64::max would drop a NaN.
        let worse = |a: f64, b: f64| if a.is_nan() || a > b { a } else { b };
        Self {
            position: worse(self.position, other.position),
            normal_degrees: worse(self.normal_degrees, other.normal_degrees),
        }
    }

    /// Whether both are within the bounds given.
    pub fn within(&self, position: f64, normal_degrees: f64) -> bool {
        self.position <= position && self.normal_degrees <= normal_degrees
    }
}

/// Compare a pose (six floats a vertex, in the user's order, padding at the end ignored) with the reference. Where the pose
/// has fewer vertices the errors are NaN, which is within no bound.
pub fn compare(pose: &[f32], reference: &[f64]) -> PoseError {
    if pose.len() < reference.len() {
        return PoseError { position: f64::NAN, normal_degrees: f64::NAN };
    }
    let mut error = PoseError::default();
    for (got, want) in pose.chunks_exact(POSE_FLOATS).zip(reference.chunks_exact(POSE_FLOATS)) {
        let got: [f64; POSE_FLOATS] = std::array::from_fn(|i| f64::from(got[i]));
        let position = DVec3::from_slice(&got[..3]).distance(DVec3::from_slice(&want[..3]));
        let (a, b) = (DVec3::from_slice(&got[3..]), DVec3::from_slice(&want[3..]));
        let angle = if b.length() < SHORTEST_NORMAL {
            a.distance(b) // no direction to compare: a short vector must come out as the same short vector
        } else {
            angle_degrees(a, b)
        };
        error = PoseError { position, normal_degrees: angle }.max(error);
    }
    error
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_lengths_and_angles() {
        let reference = [1.0, 2.0, 3.0, 0.0, 0.0, 2.0];
        let error = compare(&[1.0, 2.5, 3.0, 0.0, 1.0, 1.0, 9.0], &reference);
        assert_eq!(error.position, 0.5);
        assert!((error.normal_degrees - 45.0).abs() < 1e-12);
        assert!(error.within(0.5, 45.1) && !error.within(0.4, 90.0) && !error.within(1.0, 44.0));
    }

    #[test]
    fn nan_is_the_worst_error() {
        let reference = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let error = compare(&[f32::NAN, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 5.0, 0.0, 0.0, 1.0], &reference);
        assert!(error.position.is_nan() && !error.within(f64::INFINITY, 1.0));
    }

    #[test]
    fn a_pose_that_is_too_short_is_within_no_bound() {
        let error = compare(&[0.0; 6], &[0.0; 12]);
        assert!(error.position.is_nan() && !error.within(f64::INFINITY, f64::INFINITY));
    }
}
