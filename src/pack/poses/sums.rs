//! The CPU's sums for poses: float32, or wrapping integers.

use crate::asset::streams::TRIPLES;
use crate::pack::grid::{DROPPED, HALF};
use bytemuck::{Pod, Zeroable};

/// A sum of factor · delta over the entries of a component.
pub(crate) trait Sum: Pod + Default + Send {
    /// The delta operand.
    type Delta: Copy + Default;
    /// The coefficient operand.
    type Factor: Copy + Default;

    /// A component of a delta, in steps.
    fn delta(steps: i32) -> Self::Delta;

    /// Decodes a coefficient of the work list (`bits`), for a triple with this `step`; `shift` applies to products.
    fn factor(bits: u32, step: f32, shift: u32) -> Self::Factor;

    /// Whether the pose holds none of the entry, if that saves work.
    #[inline(always)]
    fn is_new(_: &[Self::Factor; TRIPLES]) -> bool {
        false
    }

    /// Adds a product. `NEW`: no weight is applied.
    fn add<const NEW: bool>(self, factor: Self::Factor, delta: Self::Delta) -> Self;
}

impl Sum for f32 {
    type Delta = f32;
    type Factor = f32;

    #[inline(always)]
    fn delta(steps: i32) -> f32 {
        steps as f32
    }

    #[inline(always)]
    fn factor(bits: u32, step: f32, shift: u32) -> f32 {
        // Step and shift are powers of two: exact.
        f32::from_bits(bits) * (step * (1u32 << shift) as f32)
    }

    #[inline(always)]
    fn add<const NEW: bool>(self, factor: f32, delta: f32) -> Self {
        self + factor * delta
    }
}

impl Sum for i32 {
    type Delta = i32;
    type Factor = i32;

    #[inline(always)]
    fn delta(steps: i32) -> i32 {
        steps
    }

    #[inline(always)]
    fn factor(bits: u32, _: f32, shift: u32) -> i32 {
        (bits as i32).wrapping_shl(shift)
    }

    #[inline(always)]
    fn add<const NEW: bool>(self, factor: i32, delta: i32) -> Self {
        self.wrapping_add(factor.wrapping_mul(delta))
    }
}

/// A sum of rounded products, each a function of a weight.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(transparent)]
pub(crate) struct Rounded(pub i32);

impl Sum for Rounded {
    type Delta = i32;
    /// The new and the applied weight.
    type Factor = [i32; 2];

    #[inline(always)]
    fn delta(steps: i32) -> i32 {
        steps
    }

    #[inline(always)]
    fn factor(bits: u32, _: f32, shift: u32) -> Self::Factor {
        [i32::from(bits as i16), bits as i32 >> 16].map(|weight| weight.wrapping_shl(shift))
    }

    #[inline(always)]
    fn is_new(factors: &[Self::Factor; TRIPLES]) -> bool {
        factors.iter().all(|[_, old]| *old == 0)
    }

    #[inline(always)]
    fn add<const NEW: bool>(self, [new, old]: Self::Factor, delta: i32) -> Self {
        let sum = self.0.wrapping_add(rounded(new.wrapping_mul(delta)));
        Self(if NEW { sum } else { sum.wrapping_sub(rounded(old.wrapping_mul(delta))) })
    }
}

/// Rounds to units what is in 2^-[`DROPPED`] of them.
#[inline(always)]
pub(super) fn rounded(fine: i32) -> i32 {
    fine.wrapping_add(HALF) >> DROPPED
}
