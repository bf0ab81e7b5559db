//! Rebuilt16: fixed16's numbers, as sums that are rounded once. GLSL: `glsl/poses/fixed16.glsl`.

use super::PoseStorage;
use super::sums::rounded;

pub(crate) struct Rebuilt16;

impl PoseStorage for Rebuilt16 {
    type Number = i16;
    type Sum = i32;

    #[inline(always)]
    fn plus(number: i16, sum: i32) -> i16 {
        number.wrapping_add(sum as i16)
    }

    const ROUNDS_SUMS: bool = true;

    #[inline(always)]
    fn plus_base(sum: i32, word: u32) -> i32 {
        sum.wrapping_add(word as i32)
    }

    #[inline(always)]
    fn rounded(sum: i32) -> i32 {
        rounded(sum)
    }
}
