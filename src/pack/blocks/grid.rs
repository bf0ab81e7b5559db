//! The grid of weights and poses on which integer sums are exact.

use super::BlockIndex;
use crate::asset::streams::TRIPLES;
use crate::error::{Error, Result};
use crate::pack::PoseFormat;

/// Fewer bits than this are no grid to animate on; steps finer than 2^-16 make no visible difference.
const WEIGHT_BITS: std::ops::RangeInclusive<u32> = 7..=16;

/// The grid on which weights and poses of integers lie: no sum overflows, whatever the weights up to the largest.
///
/// A pose is Σ round(weight · delta / unit), a term for each target, in integers that do not depend on the order or the
/// history. Rounding weights moves a component by at most ½·[`weight_step`](Self::weight_step)·Σ|delta|, on top of the error
/// of packing ([`BlockIndex::error`], for each target at weight 1); rounding terms by what
/// [`position_error`](Self::position_error) says.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseGrid {
    /// Weights are whole multiples of 2^-bits.
    pub weight_bits: u32,
    /// The largest weight, either sign.
    pub weight_max: f32,
    /// Input units of a pose's integers, of each triple of the group: of positions and of normals. Powers of two.
    pub units: [f32; TRIPLES],
    /// Lowest bits that rounding drops of the product of a weight and a delta, both as integers.
    pub(crate) dropped: [u32; TRIPLES],
}

impl PoseGrid {
    /// The step of weights.
    pub fn weight_step(&self) -> f32 {
        1.0 / (1u32 << self.weight_bits) as f32
    }

    /// The multiple of the step that is nearest to `weight`: what poses take for it.
    pub fn round(&self, weight: f32) -> f32 {
        self.steps(weight) as f32 * self.weight_step()
    }

    /// `weight` in steps. Both factors of the product fit 24 bits, and a power of two changes none: one rounding.
    pub(crate) fn steps(&self, weight: f32) -> i32 {
        (weight * (1u32 << self.weight_bits) as f32).round() as i32
    }

    /// How far rounding may move a vertex that so many targets with weights move: half a unit in each component for
    /// each of them. In input units; 0 where nothing is rounded.
    pub fn position_error(&self, targets: usize) -> f32 {
        self.rounding(0, targets)
    }

    /// The same of its normal, which is not normalised: the length of the difference.
    pub fn normal_error(&self, targets: usize) -> f32 {
        self.rounding(1, targets)
    }

    fn rounding(&self, triple: usize, targets: usize) -> f32 {
        if self.dropped[triple] == 0 { 0.0 } else { 0.75f32.sqrt() * self.units[triple] * targets as f32 }
    }
}

impl BlockIndex {
    /// The grid for poses of integers and weights up to `weight_max`, either sign; `None`: up to 1 in 16 bits, up to what
    /// the mesh was packed with ([`BlockDesc::weight_max`](super::BlockDesc::weight_max)) in 32.
    ///
    /// # Errors
    /// `block-float32` has no integers, float32 poses neither; a largest weight that is not above 0, or so large, or
    /// deltas so large against their step, that sums could overflow: the message names a position error that would do.
    pub fn grid(&self, pose: PoseFormat, weight_max: Option<f32>) -> Result<PoseGrid> {
        let (bits, name) = (pose.row().bits, pose.name());
        if !self.parts.format.has_integers() || bits == 0 {
            let text = format!("{name} poses of {} deltas as sums of integers", self.parts.format.name());
            return Err(Error::invalid(text, "pack as 'fast' or 'small', and use fixed32 or fixed16 poses"));
        }
        let narrow = bits < i32::BITS;
        let weight_max = weight_max.unwrap_or(if narrow { 1.0 } else { self.parts.weight_max });
        // Weights of narrow poses are as narrow; there is room for what rounding adds to a product.
        let most_steps = if narrow { f64::from(i16::MAX) } else { f64::INFINITY };
        let most = f64::from(i32::MAX) - if narrow { 65536.0 } else { 0.0 };
        let steps = |bits: u32| (f64::from(weight_max) * f64::from(1u32 << bits)).ceil();
        if !(weight_max > 0.0 && steps(*WEIGHT_BITS.start()) <= most_steps) {
            let text = format!("weights up to {weight_max} for {name} poses");
            return Err(Error::invalid(text, "use a weight_max above 0 and up to 255, or fixed32 poses"));
        }
        let fits = |bits: &u32| steps(*bits) <= most_steps && self.largest_sum * steps(*bits) <= most;
        let weight_bits = WEIGHT_BITS.rev().find(fits).ok_or_else(|| self.overflow(weight_max, most))?;
        // Each target that moves a component may round it by half a unit.
        let entries = self.most_entries();
        let dropped = self.largest_sums.map(|sum| {
            let largest = |dropped: u32| sum * steps(weight_bits) / f64::from(1u32 << dropped) + entries as f64 / 2.0;
            if narrow { (0..i32::BITS).find(|dropped| largest(*dropped) <= f64::from(i16::MAX)) } else { Some(0) }
        });
        let [Some(first), Some(second)] = dropped else {
            let text = format!("{name} poses of a mesh of which {entries} targets move a vertex");
            return Err(Error::invalid(text, "use fixed32 poses"));
        };
        let weight_step = 1.0 / (1u32 << weight_bits) as f32;
        let unit = |step: f32, dropped: u32| step * weight_step * (1u32 << dropped) as f32;
        let [position, normal] = self.parts.steps;
        let units = [unit(position, first), unit(normal, second)];
        Ok(PoseGrid { weight_bits, weight_max, units, dropped: [first, second] })
    }

    /// Sums of weights up to `weight_max` exceed `most`.
    fn overflow(&self, weight_max: f32, most: f64) -> Error {
        let room = most / f64::from(weight_max) / f64::from(1u32 << WEIGHT_BITS.start());
        let factor = (self.largest_sum / room).log2().ceil().exp2();
        let error = |step: f32| f64::from(step) * 0.75f64.sqrt();
        Error::invalid(
            format!(
                "integer sums of this mesh could overflow: a vertex adds up to {} steps, {room:.0} fit weights up to \
                 {weight_max}",
                self.largest_sum
            ),
            format!(
                "pack with errors {factor} times as large (now {:.1e} in length and {:.2}° at most), or use a smaller \
                 largest weight",
                error(self.parts.steps[0]),
                error(self.parts.steps[1]).to_degrees()
            ),
        )
    }
}
