//! Fixed16: 16-bit integers in units. GLSL: `glsl/poses/fixed16.glsl`.

use super::PoseStorage;
use super::sums::Rounded;

pub(crate) struct Fixed16;

impl PoseStorage for Fixed16 {
    type Number = i16;
    type Sum = Rounded;

    #[inline(always)]
    fn plus(number: i16, Rounded(sum): Rounded) -> i16 {
        number.wrapping_add(sum as i16)
    }
}
