//! The grid of weights and deltas on which integer sums are exact.

use super::{DeltaFormat, PoseFormat};
use crate::asset::streams::TRIPLES;
use crate::error::{Error, Result};

/// Fewer bits are too coarse to animate; steps finer than 2^-16 make no visible difference.
const WEIGHT_BITS: std::ops::RangeInclusive<u32> = 7..=16;

/// How far rounding three components moves a vertex, in units: √3/2, rounded up.
const HALF_A_DIAGONAL: f32 = 0.866_025_5;

/// Bits reserved in 32-bit products for the half unit that rounding adds.
const HALF_BITS: u32 = 16;

/// The grid of weights and fixed-point poses. No sum overflows for weights up to `weight_max`.
///
/// A pose is Σ round(weight · delta / unit) over the targets, in integers, so it depends neither on their order nor on
/// earlier poses; in [`Rebuilt16`](PoseFormat::Rebuilt16) round(Σ weight · delta / unit). Rounding weights moves a
/// component by at most ½·[`weight_step`](Self::weight_step)·Σ|delta|, on top of the packing error
/// ([`BlockIndex::error`](super::blocks::BlockIndex::error), for each target at weight 1); rounding to units, by
/// [`position_error`](Self::position_error).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseGrid {
    /// Weights are multiples of 2^-bits.
    pub weight_bits: u32,
    /// Largest absolute weight.
    pub weight_max: f32,
    /// Input units per integer of a pose, by triple of the group (positions, normals). Powers of two.
    pub units: [f32; TRIPLES],
    /// Sums are rounded to units, and not the term of each target ([`Rebuilt16`](PoseFormat::Rebuilt16)).
    pub rounds_sums: bool,
    /// Low bits that rounding drops from the product of integer weight and integer delta, or from their sum. Dense
    /// formats: for the target with the finest step; see [`terms`](Self::terms).
    pub(crate) dropped: [u32; TRIPLES],
}

/// A target's contribution to a triple of a fixed-point pose, for integer deltas d: q(new) − q(old), where q(w) = (w ·
/// d + half) >> dropped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Term {
    /// The new weight in steps of the grid; at most 2^15.
    pub new: i32,
    /// The applied weight.
    pub old: i32,
    /// At most 31.
    pub dropped: u32,
}

/// Bounds on the integer sums of a mesh's deltas.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sums {
    pub format: DeltaFormat,
    /// Delta steps by triple; powers of two.
    pub steps: [f32; TRIPLES],
    /// Dense formats, whose steps differ by target: log2 of coarsest step / finest step (`steps`), by triple. `None` in
    /// block formats: one step for the mesh, and shifted integers.
    pub coarsest: Option<[u32; TRIPLES]>,
    /// By triple: the largest Σ|delta| of any component of a vertex, in steps.
    pub largest: [f64; TRIPLES],
    /// The maximum of `largest` over all groups of the mesh.
    pub largest_of_mesh: f64,
    /// Upper bound on the targets that move a vertex; block formats count those that touch its block.
    pub targets: usize,
    /// Default largest weight of 32-bit poses.
    pub weight_max: f32,
}

impl PoseGrid {
    /// The step of weights.
    pub fn weight_step(&self) -> f32 {
        1.0 / (1u32 << self.weight_bits) as f32
    }

    /// Rounds `weight` to the nearest multiple of the step, as fixed-point poses do.
    pub fn round(&self, weight: f32) -> f32 {
        self.steps(weight) as f32 * self.weight_step()
    }

    /// `weight` in steps. The scale is a power of two, so only `round` rounds.
    #[doc(hidden)]
    pub fn steps(&self, weight: f32) -> i32 {
        (weight * (1u32 << self.weight_bits) as f32).round() as i32
    }

    /// Bound on the position error of a vertex that `targets` targets move, from rounding each of their terms by half a
    /// unit, or their sum. In input units; 0 if nothing is rounded.
    pub fn position_error(&self, targets: usize) -> f32 {
        self.rounding(0, targets)
    }

    /// The same bound for its normal before normalisation, as the length of the difference.
    pub fn normal_error(&self, targets: usize) -> f32 {
        self.rounding(1, targets)
    }

    /// Terms of a target with 16-bit deltas in these `steps`, from applied weight `held` to `weight`.
    pub(crate) fn terms(&self, held: f32, weight: f32, steps: [f32; TRIPLES]) -> [Term; TRIPLES] {
        let [old, new] = [held, weight].map(|weight| self.steps(weight));
        std::array::from_fn(|triple| {
            let product = f64::from(steps[triple]) * f64::from(self.weight_step());
            // The quotient of powers of two is exact. A step coarser than the unit belongs to a target that does not
            // move the triple. From 31 bits on, no product reaches half a unit: both terms are -1.
            let dropped = (f64::from(self.units[triple]) / product).log2().clamp(0.0, 31.0) as u32;
            Term { new, old, dropped }
        })
    }

    fn rounding(&self, triple: usize, targets: usize) -> f32 {
        let roundings = if self.rounds_sums { targets.min(1) } else { targets };
        if self.dropped[triple] == 0 { 0.0 } else { HALF_A_DIAGONAL * self.units[triple] * roundings as f32 }
    }
}

/// The error for formats of which one is float32, or for sums of dense deltas that would be rounded once.
pub(super) fn refused(deltas: DeltaFormat, pose: PoseFormat) -> Error {
    let text = format!("{} poses of {} deltas as integer sums", pose.name(), deltas.name());
    let remedy = match pose.row().rounds_sums {
        true => "pack in blocks, as 'fast' or 'small'",
        false => "pack as 'fast', 'small' or, dense, 'snorm16', and use fixed32 or fixed16 poses",
    };
    Error::invalid(text, remedy)
}

impl Sums {
    pub(super) fn grid(&self, pose: PoseFormat, weight_max: Option<f32>) -> Result<PoseGrid> {
        let bits = pose.row().bits;
        let name = pose.name();
        let rounds_sums = pose.row().rounds_sums;
        if bits == 0 || !pose.takes(self.format) {
            return Err(refused(self.format, pose));
        }
        let narrow = bits < i32::BITS;
        let weight_max = weight_max.unwrap_or(if narrow { 1.0 } else { self.weight_max });
        let dense = self.coarsest.is_some();
        let rounds = narrow || dense;
        // Limits on weights and products. With rounding, products leave room for the half unit: dense deltas have 16
        // bits, so a product with 2^15 has one spare bit. All groups of a mesh use one grid of weights.
        let half = if narrow { f64::from(1u32 << HALF_BITS) } else { 0.0 };
        let (most_steps, most) = match (dense, pose.rounds_products()) {
            (true, _) => (32768.0, f64::INFINITY),
            (false, true) => (f64::from(i16::MAX), f64::from(i32::MAX) - half),
            (false, false) => (f64::INFINITY, f64::from(i32::MAX) - half),
        };
        let steps = |bits: u32| (f64::from(weight_max) * f64::from(1u32 << bits)).ceil();
        if !(weight_max > 0.0 && steps(*WEIGHT_BITS.start()) <= most_steps) {
            let text = format!("weights up to {weight_max} for {name} poses");
            let wider = if dense { "deltas in blocks" } else { "fixed32 poses" };
            return Err(Error::invalid(text, format!("use a weight_max above 0 and up to 255, or {wider}")));
        }
        let fits = |bits: &u32| steps(*bits) <= most_steps && self.largest_of_mesh * steps(*bits) <= most;
        let weight_bits = WEIGHT_BITS.rev().find(fits).ok_or_else(|| self.overflow(weight_max, most))?;
        // Each target that moves a component may round it by half a unit. A unit is at least as coarse as a product.
        let roundings = if rounds_sums { 1 } else { self.targets };
        let most = f64::from(u32::MAX >> (u32::BITS - bits + 1));
        let dropped = |triple: usize| {
            let sum = self.largest[triple] * steps(weight_bits);
            let fits = |dropped: &u32| sum / f64::from(*dropped).exp2() + roundings as f64 / 2.0 <= most;
            // In blocks, more bits are needed only if more than 32,767 targets move a vertex.
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
        let units = [0, 1].map(|triple| unit(triple) as f32);
        Ok(PoseGrid { weight_bits, weight_max, units, rounds_sums, dropped })
    }

    /// The error for sums, at weights up to `weight_max`, above `most`.
    fn overflow(&self, weight_max: f32, most: f64) -> Error {
        let room = most / f64::from(weight_max) / f64::from(1u32 << WEIGHT_BITS.start());
        let factor = (self.largest_of_mesh / room).log2().ceil().exp2();
        let error = |step: f32| f64::from(step) * 0.75f64.sqrt();
        let [length, angle] = self.steps.map(error);
        let now = format!("now {length:.1e} in length and {:.2}° at most", angle.to_degrees());
        let fit =
            format!("a vertex adds up to {} steps, {room:.0} fit weights up to {weight_max}", self.largest_of_mesh);
        let remedy = format!("pack with errors {factor} times as large ({now}), or use a smaller largest weight");
        Error::invalid(format!("integer sums of this mesh could overflow: {fit}"), remedy)
    }
}
