//! Reference evaluation from the base pose in float64, and the error of a pose against it.

#[doc(hidden)]
pub use crate::after::{normals, skin};
use crate::asset::KeptMesh;
use crate::asset::streams::{StreamPlace, group_streams};
#[doc(hidden)]
pub use crate::math::angle_degrees;
use crate::pack::{POSE_FLOATS, PackedGroup, PackedMesh, PoseError, Source};
use glam::DVec3;

/// A morphed normal shorter than this has no usable direction; consumers fall back to the base normal.
#[doc(hidden)]
pub const SHORTEST_NORMAL: f64 = 1e-3;

/// Evaluates the first group ([`evaluate_group`]): position, then the unnormalised normal.
pub fn evaluate(mesh: &PackedMesh, weights: &[f32]) -> Vec<f64> {
    evaluate_group(mesh.surface(), weights)
}

/// Returns `base + Σ weight · delta` over all targets of a [group](PackedMesh::groups), from the packed deltas that the
/// kernels read. Six values per vertex, in the user's order and without padding; positions are relative to the mesh's
/// origin, as in poses. Targets beyond the end of `weights` have the weight 0.
#[doc(hidden)]
pub fn evaluate_group(group: &PackedGroup, weights: &[f32]) -> Vec<f64> {
    let layout = group.layout();
    let mut pose: Vec<f64> = layout.to_user_order(group.base()).into_iter().map(f64::from).collect();
    for (target, &weight) in weights.iter().take(layout.targets.len()).enumerate().filter(|(_, w)| **w != 0.0) {
        group.for_each_delta(target, |vertex, delta| add(&mut pose, vertex, weight, delta));
    }
    pose
}

/// Evaluates position and normal ([`evaluate_unpacked_group`]).
#[doc(hidden)]
pub fn evaluate_unpacked(mesh: &KeptMesh, weights: &[f32]) -> Vec<f64> {
    evaluate_unpacked_group(mesh, &group_streams([])[0], weights)
}

/// Like [`evaluate_group`], but from the deltas of `mesh` before packing; a mesh made at tolerance zero has the deltas
/// of its files.
#[doc(hidden)]
pub fn evaluate_unpacked_group(mesh: &KeptMesh, streams: &[StreamPlace], weights: &[f32]) -> Vec<f64> {
    let source = Source::new(mesh, streams);
    let mut pose: Vec<f64> = (0..mesh.vertex_count()).flat_map(|v| source.base(v).map(f64::from)).collect();
    for (target, &weight) in mesh.targets.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
        for (vertex, delta) in source.deltas(target) {
            add(&mut pose, vertex as usize, weight, delta.map(f64::from));
        }
    }
    pose
}

fn add(pose: &mut [f64], vertex: usize, weight: f32, delta: [f64; POSE_FLOATS]) {
    for (out, delta) in pose[vertex * POSE_FLOATS..][..POSE_FLOATS].iter_mut().zip(delta) {
        *out += f64::from(weight) * delta;
    }
}

/// Compares position and normal ([`compare_group`]).
pub fn compare(pose: &[f32], reference: &[f64]) -> PoseError {
    compare_group(&group_streams([])[0], pose, reference)
}

/// Compares a pose of the group with these streams (six floats a vertex, in the user's order; padding at the end is
/// ignored) with the reference. If the pose has too few vertices, the errors are NaN, which no bound accepts.
#[doc(hidden)]
pub fn compare_group(streams: &[StreamPlace], pose: &[f32], reference: &[f64]) -> PoseError {
    if pose.len() < reference.len() {
        return PoseError::NAN;
    }
    let angle = |got: DVec3, want: DVec3| match want.length() < SHORTEST_NORMAL {
        true => got.distance(want), // no direction to compare: a short vector must come out as the same short vector
        false => angle_degrees(got, want),
    };
    let mut worst = PoseError::default();
    for (got, want) in pose.as_chunks::<POSE_FLOATS>().0.iter().zip(reference.as_chunks().0) {
        worst.add_vertex(streams, &got.map(f64::from), want, angle);
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_lengths_and_angles_and_nan_is_within_no_bound() {
        let reference = [1.0, 2.0, 3.0, 0.0, 0.0, 2.0];
        let error = compare(&[1.0, 2.5, 3.0, 0.0, 1.0, 1.0, 9.0], &reference);
        assert_eq!(error.position, 0.5);
        assert!((error.normal_degrees - 45.0).abs() < 1e-12);
        assert!(error.within(0.5, 45.1) && !error.within(0.4, 90.0) && !error.within(1.0, 44.0));

        let reference = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let nan = [f32::NAN, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 5.0, 0.0, 0.0, 1.0];
        for pose in [&nan[..], &[0.0; 6]] {
            let error = compare(pose, &reference);
            assert!(error.position.is_nan() && !error.within(f64::INFINITY, f64::INFINITY));
        }
    }
}
