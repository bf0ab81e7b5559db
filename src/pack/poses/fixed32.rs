//! Fixed32: 32-bit integers in units. GLSL: `glsl/poses/fixed32.glsl`.

use super::PoseStorage;

pub(crate) struct Fixed32;

impl PoseStorage for Fixed32 {
    type Number = i32;
    type Sum = i32;

    #[inline(always)]
    fn plus(number: i32, sum: i32) -> i32 {
        number.wrapping_add(sum)
    }
}
