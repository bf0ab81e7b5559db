//! fixed16: six integers of 16 bits, the displacement from the base pose in steps. GLSL: `glsl/poses/fixed16.glsl`.

use super::PoseStorage;
use crate::pack::POSE_FLOATS;

/// See [`PoseFormat::Fixed16`](super::PoseFormat::Fixed16).
pub(super) struct Fixed16;

impl PoseStorage for Fixed16 {
    fn integers(&self, vertex: &[u8]) -> Option<[i32; POSE_FLOATS]> {
        Some(bytemuck::pod_read_unaligned::<[i16; POSE_FLOATS]>(vertex).map(i32::from))
    }

    fn offset(&self, component: usize) -> usize {
        size_of::<i16>() * component
    }
}
