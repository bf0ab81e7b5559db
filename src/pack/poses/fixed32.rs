//! fixed32: six integers of 32 bits, the displacement from the base pose in steps. GLSL: `glsl/poses/fixed32.glsl`.

use super::PoseStorage;
use crate::pack::POSE_FLOATS;

/// See [`PoseFormat::Fixed32`](super::PoseFormat::Fixed32).
pub(super) struct Fixed32;

impl PoseStorage for Fixed32 {
    fn integers(&self, vertex: &[u8]) -> Option<[i32; POSE_FLOATS]> {
        Some(bytemuck::pod_read_unaligned(vertex))
    }

    fn offset(&self, component: usize) -> usize {
        size_of::<i32>() * component
    }
}
