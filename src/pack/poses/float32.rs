//! Float32: the six components of a vertex. GLSL: `glsl/poses/float32.glsl`.

use super::PoseStorage;

pub(crate) struct Float32;

impl PoseStorage for Float32 {
    type Number = f32;
    type Sum = f32;

    #[inline(always)]
    fn plus(number: f32, sum: f32) -> f32 {
        number + sum
    }
}
