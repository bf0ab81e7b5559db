//! The grid of weights and poses on which integer sums are exact.

use super::{DeltaFormat, PoseFormat};
use crate::asset::streams::TRIPLES;
use crate::error::{Error, Result};

/// Fewer bits than this are no grid to animate on; steps finer than 2^-16 make no visible difference.
const WEIGHT_BITS: std::ops::RangeInclusive<u32> = 7..=16;

/// Products of 32 bits have room for what rounding adds: half a unit, of so many bits at most.
const HALF_BITS: u32 = 16;

/// The grid on which weights and poses of integers lie: no sum overflows, whatever the weights up to the largest.
///
/// A pose is Σ round(weight · delta / unit), a term for each target, in integers that do not depend on the order or the
/// history. Rounding weights moves a component by at most ½·[`weight_step`](Self::weight_step)·Σ|delta|, on top of the
/// error of packing ([`BlockIndex::error`](super::blocks::BlockIndex::error), for each target at weight 1); rounding
/// terms by what [`position_error`](Self::position_error) says.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseGrid {
    /// Weights are whole multiples of 2^-bits.
    pub weight_bits: u32,
    /// The largest weight, either sign.
    pub weight_max: f32,
    /// Input units of a pose's integers, of each triple of the group: of positions and of normals. Powers of two.
    pub units: [f32; TRIPLES],
    /// Lowest bits that rounding drops of the product of a weight and a delta, both as integers. In dense formats, of
    /// the target with the finest step: see [`terms`](Self::terms).
    pub(crate) dropped: [u32; TRIPLES],
}

/// What a target adds to a triple of a pose, of integers d: q(new) − q(old) with q(w) = (w · d + half) >> dropped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Term {
    /// The weight that the pose is to hold, in steps of the grid, 2^15 at most.
    pub new: i32,
    /// The weight that it holds.
    pub old: i32,
    /// At most 31.
    pub dropped: u32,
}

/// What poses of integers add up in a mesh: how large sums of its deltas may become.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sums {
    pub format: DeltaFormat,
    /// What deltas are whole multiples of, by triple: powers of two.
    pub steps: [f32; TRIPLES],
    /// Dense formats, whose targets have steps of their own: the power of two from `steps`, which are the finest of
    /// them, to the coarsest. In blocks a step is the mesh's, and integers are shifted.
    pub coarsest: Option<[u32; TRIPLES]>,
    /// The largest Σ|delta| of any vertex component in steps, by triple.
    pub largest: [f64; TRIPLES],
    /// The largest of the mesh: of any of its groups.
    pub largest_of_mesh: f64,
    /// Most targets that move a vertex. At least: it may count those that touch its block.
    pub targets: usize,
    /// The largest weight of poses of 32 bits, where none is named.
    pub weight_max: f32,
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
    #[doc(hidden)]
    pub fn steps(&self, weight: f32) -> i32 {
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

    /// What a target whose deltas have 16 bits, in these steps, adds to a pose that holds one weight of it and is to
    /// hold another.
    pub(crate) fn terms(&self, held: f32, weight: f32, steps: [f32; TRIPLES]) -> [Term; TRIPLES] {
        let [old, new] = [held, weight].map(|weight| self.steps(weight));
        std::array::from_fn(|triple| {
            let product = f64::from(steps[triple]) * f64::from(self.weight_step());
            // Powers of two: the quotient is exact. Steps coarser than the unit are those of a target that does not
            // move the triple. From 31 bits on no product reaches half a unit, and both terms are -1.
            let dropped = (f64::from(self.units[triple]) / product).log2().clamp(0.0, 31.0) as u32;
            Term { new, old, dropped }
        })
    }

    fn rounding(&self, triple: usize, targets: usize) -> f32 {
        if self.dropped[triple] == 0 { 0.0 } else { 0.75f32.sqrt() * self.units[triple] * targets as f32 }
    }
}

/// Deltas that are no integers, or poses that are none.
pub(super) fn refused(deltas: DeltaFormat, pose: PoseFormat) -> Error {
    let text = format!("{} poses of {} deltas as sums of integers", pose.name(), deltas.name());
    Error::invalid(text, "pack as 'fast', 'small' or, dense, 'snorm16', and use fixed32 or fixed16 poses")
}

impl Sums {
    /// See [`PackedLayout::grid`](super::PackedLayout::grid).
    pub(super) fn grid(&self, pose: PoseFormat, weight_max: Option<f32>) -> Result<PoseGrid> {
        let (bits, name) = (pose.row().bits, pose.name());
        if !self.format.has_integers() || bits == 0 {
            return Err(refused(self.format, pose));
        }
        let narrow = bits < i32::BITS;
        let weight_max = weight_max.unwrap_or(if narrow { 1.0 } else { self.weight_max });
        let dense = self.coarsest.is_some();
        let rounds = narrow || dense;
        // Weights and what products have room for, where there has to be room for what rounding adds, too. Dense deltas
        // have 16 bits: a product with 2^15 leaves a bit for it. Weights have the same grid in all groups of the mesh.
        let (most_steps, most) = match (dense, narrow) {
            (true, _) => (32768.0, f64::INFINITY),
            (false, true) => (f64::from(i16::MAX), f64::from(i32::MAX) - f64::from(1u32 << HALF_BITS)),
            (false, false) => (f64::INFINITY, f64::from(i32::MAX)),
        };
        let steps = |bits: u32| (f64::from(weight_max) * f64::from(1u32 << bits)).ceil();
        if !(weight_max > 0.0 && steps(*WEIGHT_BITS.start()) <= most_steps) {
            let text = format!("weights up to {weight_max} for {name} poses");
            let wider = if dense { "deltas in blocks" } else { "fixed32 poses" };
            return Err(Error::invalid(text, format!("use a weight_max above 0 and up to 255, or {wider}")));
        }
        let fits = |bits: &u32| steps(*bits) <= most_steps && self.largest_of_mesh * steps(*bits) <= most;
        let weight_bits = WEIGHT_BITS.rev().find(fits).ok_or_else(|| self.overflow(weight_max, most))?;
        // Each target that moves a component may round it by half a unit. Units are no finer than a product.
        let most = f64::from(u32::MAX >> (u32::BITS - bits + 1));
        let dropped = |triple: usize| {
            let sum = self.largest[triple] * steps(weight_bits);
            let fits = |dropped: &u32| sum / f64::from(*dropped).exp2() + self.targets as f64 / 2.0 <= most;
            // In blocks more are needed only where more than 32,767 targets move a vertex.
            let (least, all) = self.coarsest.map_or((0, HALF_BITS + 1), |coarsest| (coarsest[triple], u8::MAX.into()));
            if rounds { (least..=least + all).find(fits) } else { Some(0) }
        };
        let [Some(first), Some(second)] = [dropped(0), dropped(1)] else {
            let text = format!("{name} poses of a mesh of which {} targets move a vertex", self.targets);
            return Err(Error::invalid(text, "use fixed32 poses"));
        };
        let dropped = [first, second];
        let weight_step = f64::from(1u32 << weight_bits).recip();
        let unit = |triple: usize| f64::from(self.steps[triple]) * weight_step * f64::from(dropped[triple]).exp2();
        Ok(PoseGrid { weight_bits, weight_max, units: [0, 1].map(|triple| unit(triple) as f32), dropped })
    }

    /// Sums of weights up to `weight_max` exceed `most`.
    fn overflow(&self, weight_max: f32, most: f64) -> Error {
        let room = most / f64::from(weight_max) / f64::from(1u32 << WEIGHT_BITS.start());
        let factor = (self.largest_of_mesh / room).log2().ceil().exp2();
        let error = |step: f32| f64::from(step) * 0.75f64.sqrt();
        Error::invalid(
            format!(
                "integer sums of this mesh could overflow: a vertex adds up to {} steps, {room:.0} fit weights up to \
                 {weight_max}",
                self.largest_of_mesh
            ),
            format!(
                "pack with errors {factor} times as large (now {:.1e} in length and {:.2}° at most), or use a smaller \
                 largest weight",
                error(self.steps[0]),
                error(self.steps[1]).to_degrees()
            ),
        )
    }
}
