//! float32: the six numbers of a vertex, one after the other. GLSL: `glsl/poses/float32.glsl`.

use super::PoseStorage;
use crate::pack::POSE_FLOATS;

/// See [`PoseFormat::Float32`](super::PoseFormat::Float32).
pub(super) struct Float32;

impl PoseStorage for Float32 {
    fn integers(&self, _: &[u8]) -> Option<[i32; POSE_FLOATS]> {
        None
    }

    fn offset(&self, component: usize) -> usize {
        size_of::<f32>() * component
    }
}
