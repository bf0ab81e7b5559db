//! The grid of weights, deltas and base poses on which integer sums are exact.

use super::{DeltaFormat, POSE_FLOATS, PoseFormat};
use crate::asset::streams::{Measure, StreamPlace, TRIPLE, TRIPLES};
use crate::error::{Error, Result, ensure, refuse};
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

/// Fewer bits are too coarse to animate; steps finer than 2^-16 make no visible difference.
const WEIGHT_BITS: RangeInclusive<u32> = 7..=16;

/// Low bits that rounding drops in blocks. Their number is the same for all meshes: kernels round with constants.
pub(crate) const DROPPED: u32 = 16;
/// Half of the lowest bit that is left.
pub(crate) const HALF: i32 = 1 << (DROPPED - 1);

/// The grid of weights and fixed-point poses. No sum overflows for weights up to `weight_max`.
///
/// A pose is an integer for each component: value = offset + integer × unit, in input units. The integer is round((base
/// − offset) / unit) + Σ round(weight · delta / unit) over the targets, so it depends neither on their order nor on
/// earlier poses; in [`Rebuilt16`](PoseFormat::Rebuilt16) round((base − offset + Σ weight · delta) / unit). Rounding
/// weights moves a component by at most ½·[`weight_step`](Self::weight_step)·Σ|delta|, on top of the packing error
/// ([`PackedLayout::error`](crate::PackedLayout::error), for each target at weight 1); rounding to units and
/// decoding, by [`position_error`](Self::position_error).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PoseGrid {
    /// Weights are multiples of 2^-bits.
    pub weight_bits: u32,
    /// Largest absolute weight.
    pub weight_max: f32,
    /// Input units per integer of a pose, by component of the group (positions, normals). Powers of two; the same for
    /// the three components of a triple.
    pub units: [f32; POSE_FLOATS],
    /// The value of integer 0, by component, in input units: the middle of what poses reach; 0 for directions.
    pub offsets: [f32; POSE_FLOATS],
    /// Sums are rounded to units, and not the term of each target ([`Rebuilt16`](PoseFormat::Rebuilt16)).
    #[doc(hidden)]
    pub rounds_sums: bool,
    /// Terms are rounded to units.
    pub(crate) rounds_terms: bool,
    /// Blocks whose products or sums are rounded: left shift of the product of integer weight and integer delta to
    /// 2^-[`DROPPED`] of the unit. By triple; 0 if nothing is rounded.
    pub(crate) raised: [u32; TRIPLES],
    /// How far decoding moves a vertex at most, in input units. By triple.
    pub(crate) decoding: [f64; TRIPLES],
}

/// What the poses of neighbouring vertices reach, by component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reached {
    /// Bounds of the base pose, in input units.
    pub low: [f32; POSE_FLOATS],
    pub high: [f32; POSE_FLOATS],
    /// The largest Σ|delta| of a vertex, in steps.
    pub sums: [f64; POSE_FLOATS],
}

impl Default for Reached {
    fn default() -> Self {
        Self { low: [f32::INFINITY; POSE_FLOATS], high: [f32::NEG_INFINITY; POSE_FLOATS], sums: [0.0; POSE_FLOATS] }
    }
}

/// Bounds on the integer sums of a group.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sums {
    pub format: DeltaFormat,
    /// Delta steps by triple; powers of two.
    pub steps: [f32; TRIPLES],
    /// The components of each stream of directions.
    pub directions: Vec<Range<usize>>,
    /// By block of vertices.
    pub reached: Vec<Reached>,
    /// The largest numbers of the group.
    pub largest: Largest,
    /// Upper bound on the targets that move a vertex: those that touch its block.
    pub targets: usize,
    /// Default largest weight of 32-bit poses.
    pub weight_max: f32,
}

/// The largest numbers of any component, in steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Largest {
    /// Σ|delta| of a vertex.
    pub sum: f64,
    /// Half the size of the base pose, and room for an offset that is rounded to single precision.
    pub base: f64,
}

impl Largest {
    pub fn max(self, other: Self) -> Self {
        Self { sum: self.sum.max(other.sum), base: self.base.max(other.base) }
    }
}

impl PoseGrid {
    /// The step of weights.
    #[doc(hidden)]
    pub fn weight_step(&self) -> f32 {
        1.0 / (1u32 << self.weight_bits) as f32
    }

    /// Rounds `weight` to the nearest multiple of the step, as fixed-point poses do.
    #[doc(hidden)]
    pub fn round(&self, weight: f32) -> f32 {
        self.steps(weight) as f32 * self.weight_step()
    }

    /// `weight` in steps. The scale is a power of two, so only `round` rounds.
    #[doc(hidden)]
    pub fn steps(&self, weight: f32) -> i32 {
        (weight * (1u32 << self.weight_bits) as f32).round() as i32
    }

    /// Bound on the position error of a vertex that `targets` targets move, from rounding each of their terms and the
    /// base pose by half a unit, or their sum, and from decoding them in single precision. In input units.
    pub fn position_error(&self, targets: usize) -> f32 {
        self.rounding(0, targets)
    }

    /// The same bound for its normal before normalisation, as the length of the difference.
    pub fn normal_error(&self, targets: usize) -> f32 {
        self.rounding(1, targets)
    }

    /// The base pose of a group's first `vertices` vertices in integers, [`POSE_FLOATS`] per vertex of `base`; 0 for
    /// the others. In units; where sums are rounded, in units of the sums, before that.
    pub(crate) fn integers(&self, base: &[f32], vertices: usize) -> Vec<i32> {
        let integer = |(i, number): (usize, &f32)| {
            let c = i % POSE_FLOATS;
            let finer = if self.rounds_sums { f64::from(1u32 << DROPPED) } else { 1.0 };
            let exact = (f64::from(*number) - f64::from(self.offsets[c])) / f64::from(self.units[c]) * finer;
            if i < vertices * POSE_FLOATS { exact.round() as i32 } else { 0 }
        };
        base.iter().enumerate().map(integer).collect()
    }

    /// How far rounding the components of a triple, and decoding them, moves a vertex.
    fn rounding(&self, triple: usize, targets: usize) -> f32 {
        let half = f64::from(self.units[triple * TRIPLE]) * 0.75f64.sqrt();
        // The base pose, or the sum.
        let roundings = if self.rounds_terms { targets + 1 } else { 1 };
        // Rounded up.
        ((half * roundings as f64 + self.decoding[triple]) as f32).next_up()
    }
}

/// The error for float32 poses, or deltas that are not in blocks.
pub(super) fn refused(deltas: DeltaFormat, pose: PoseFormat) -> Error {
    let text = format!("{} poses of {} deltas as integer sums", pose.name(), deltas.name());
    Error::invalid(text, "pack in blocks, as 'fast' or 'small', and use fixed32, fixed16 or rebuilt16 poses")
}

/// The components of each stream of directions.
pub(super) fn directions(streams: &[StreamPlace]) -> Vec<Range<usize>> {
    let directions = streams.iter().filter(|stream| stream.semantic.measure() == Measure::Angle);
    directions.map(StreamPlace::morphing_components).collect()
}

/// The bounds of all groups of a mesh, and which of them are those of one group. Weights belong to the mesh: their grid
/// follows from all groups, and is the same in each.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MeshSums {
    pub all: Arc<[Sums]>,
    pub group: usize,
}

impl MeshSums {
    /// Those of a mesh of one group.
    pub fn of(sums: Sums) -> Self {
        Self { all: Arc::new([sums]), group: 0 }
    }

    /// The grid of the group.
    pub fn grid(&self, pose: PoseFormat, weight_max: Option<f32>) -> Result<PoseGrid> {
        let own = &self.all[self.group];
        let bits = pose.row().bits;
        ensure!(bits > 0 && pose.takes(own.format), refused(own.format, pose));
        let weight_max = weight_max.unwrap_or(if bits < i32::BITS { 1.0 } else { own.weight_max });
        let largest = self.all.iter().map(|sums| sums.largest).fold(Largest::default(), Largest::max);
        let most = own.weight_bits(pose, weight_max, largest)?;
        // Weights are coarser where rounding would have to drop more bits of finer ones, in any group.
        let place = |bits: u32| self.all.iter().map(move |sums| sums.place(pose, weight_max, bits)).collect();
        let grids = (*WEIGHT_BITS.start()..=most).rev().map(place).find(Result::is_ok);
        let grids: Vec<PoseGrid> = grids.unwrap_or_else(|| place(most))?;
        Ok(grids[self.group])
    }
}

/// The largest weight in steps of 2^-bits.
fn weight_steps(weight_max: f32, bits: u32) -> f64 {
    (f64::from(weight_max) * f64::from(1u32 << bits)).ceil()
}

impl Sums {
    /// Sums of deltas that have one step, and move nothing yet.
    pub fn new(
        format: DeltaFormat,
        steps: [f32; TRIPLES],
        streams: &[StreamPlace],
        reached: Vec<Reached>,
        weight_max: f32,
    ) -> Self {
        let directions = directions(streams);
        let largest = Largest::default();
        Self { format, steps, directions, reached, largest, targets: 0, weight_max }
    }

    /// Takes the base pose of `vertices` vertices, in blocks of `size`, and the largest numbers of the group.
    pub(super) fn take_base(&mut self, base: &[f32], vertices: usize, size: usize) {
        let blocks = base[..vertices * POSE_FLOATS].chunks(size * POSE_FLOATS);
        for (reached, vertices) in self.reached.iter_mut().zip(blocks) {
            *reached = Reached { sums: reached.sums, ..Reached::default() };
            for (i, number) in vertices.iter().enumerate() {
                let c = i % POSE_FLOATS;
                reached.low[c] = reached.low[c].min(*number);
                reached.high[c] = reached.high[c].max(*number);
            }
        }
        let half = |c: usize| {
            let [low, high] = self.bounds(c, 0.0);
            let half = (high - low) / 2.0;
            // Both are of single precision: the nearest such number to their middle is no further than they are.
            let rounding = (high.abs().max(low.abs()) * f64::from(f32::EPSILON)).min(half);
            (half + rounding) / f64::from(self.steps[c / TRIPLE])
        };
        let base = (0..POSE_FLOATS).map(half).fold(0.0, f64::max);
        let sum = self.reached.iter().flat_map(|reached| reached.sums).fold(0.0, f64::max);
        self.largest = Largest { sum, base };
    }

    /// The most bits of weights up to `weight_max` with which no product or sum overflows before rounding, where these
    /// are the `largest` numbers of the mesh.
    fn weight_bits(&self, pose: PoseFormat, weight_max: f32, largest: Largest) -> Result<u32> {
        // With rounding, the limits leave room for the half unit.
        let half = if pose.row().bits < i32::BITS { HALF } else { 0 };
        let most = f64::from(i32::MAX - half);
        let (most_steps, most, base) = match pose.rounds_products() {
            true => (f64::from(i16::MAX), most, 0.0),
            false => (f64::INFINITY, most - 1.0, largest.base),
        };
        let steps = |bits: u32| weight_steps(weight_max, bits);
        let fits = weight_max > 0.0 && steps(*WEIGHT_BITS.start()) <= most_steps;
        let text = format!("weights up to {weight_max} for {} poses", pose.name());
        ensure!(fits, text, "use a weight_max above 0 and up to 255, or fixed32 poses");
        // Deltas move the offset, too.
        let total =
            |bits: u32| largest.sum * steps(bits) * (1.0 + f64::from(f32::EPSILON)) + base * f64::from(1u32 << bits);
        let fits = |bits: &u32| steps(*bits) <= most_steps && total(*bits) <= most;
        let largest = Largest { base, ..largest };
        WEIGHT_BITS.rev().find(fits).ok_or_else(|| self.overflow(weight_max, largest, most))
    }

    /// The grid for the mesh's weights, up to `weight_max` in steps of 2^-`weight_bits`.
    fn place(&self, pose: PoseFormat, weight_max: f32, weight_bits: u32) -> Result<PoseGrid> {
        let mut grid = PoseGrid {
            weight_bits,
            weight_max,
            units: [0.0; POSE_FLOATS],
            offsets: [0.0; POSE_FLOATS],
            rounds_sums: pose.row().rounds_sums,
            rounds_terms: pose.rounds_products(),
            raised: [0; TRIPLES],
            decoding: [0.0; TRIPLES],
        };
        (0..TRIPLES).try_for_each(|triple| self.place_triple(triple, pose, &mut grid))?;
        Ok(grid)
    }

    /// Finds the offsets of a triple, and the finest unit in which a pose holds what its components reach.
    fn place_triple(&self, triple: usize, pose: PoseFormat, grid: &mut PoseGrid) -> Result<()> {
        let bits = pose.row().bits;
        let product = f64::from(self.steps[triple]) * f64::from(grid.weight_step());
        let components = triple * TRIPLE..(triple + 1) * TRIPLE;
        let (mut half, mut farthest) = (0.0f64, 0.0f64);
        for c in components.clone() {
            let [low, high] = self.bounds(c, weight_steps(grid.weight_max, grid.weight_bits) * product);
            let offset = ((low + high) / 2.0) as f32;
            half = half.max(high - f64::from(offset)).max(f64::from(offset) - low);
            farthest = farthest.max(high).max(-low);
            grid.offsets[c] = offset;
        }
        // One ulp for the integer as a float, and one for the sum, since Vulkan fixes no rounding mode.
        grid.decoding[triple] = 3f64.sqrt() * f64::from(f32::EPSILON) * (half + farthest);
        // The base pose, and each target that moves a component, may round it by half a unit. A unit is at least as
        // coarse as a product.
        let roundings = if grid.rounds_sums { 1 } else { self.targets + 1 };
        let most = f64::from(u32::MAX >> (u32::BITS - bits + 1));
        let unit = |dropped: u32| product * f64::from(dropped).exp2();
        let fits = |dropped: &u32| half / unit(*dropped) + roundings as f64 / 2.0 <= most;
        let rounds = bits < i32::BITS;
        let dropped = if rounds { (0..=DROPPED).find(fits) } else { Some(0) };
        let Some(dropped) = dropped else {
            let (targets, reach) = (self.targets, half / f64::from(self.steps[triple]));
            let what = format!("of which {targets} targets move a vertex, {reach:.0} steps from the middle at most");
            return refuse(
                format!("{} poses of a mesh {what}", pose.name()),
                "use float32 poses, or pack with larger errors",
            );
        };
        if rounds {
            grid.raised[triple] = DROPPED - dropped;
        }
        grid.units[components].fill(unit(dropped) as f32);
        Ok(())
    }

    /// What component `c` reaches, in input units, where weights times the step are up to `weight`; of directions to
    /// both sides of 0.
    fn bounds(&self, c: usize, weight: f64) -> [f64; 2] {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for reached in &self.reached {
            let moved = weight * reached.sums[c];
            low = low.min(f64::from(reached.low[c]) - moved);
            high = high.max(f64::from(reached.high[c]) + moved);
        }
        match self.directions.iter().any(|direction| direction.contains(&c)) {
            _ if low > high => [0.0; 2],
            true => [-high.max(-low), high.max(-low)],
            false => [low, high],
        }
    }

    /// The error for these largest numbers of the mesh, at weights up to `weight_max`, above `most`.
    fn overflow(&self, weight_max: f32, Largest { sum, base }: Largest, most: f64) -> Error {
        let room = most / f64::from(1u32 << WEIGHT_BITS.start());
        let factor = ((sum * f64::from(weight_max) + base) / room).log2().ceil().exp2();
        let error = |step: f32| f64::from(step) * 0.75f64.sqrt();
        let [length, angle] = self.steps.map(error);
        let now = format!("now {length:.1e} in length and {:.2}° at most", angle.to_degrees());
        let fit = format!(
            "a vertex is up to {base:.0} steps from the middle and adds up to {sum:.0}, {room:.0} fit weights up to \
             {weight_max}"
        );
        let remedy = format!(
            "use float32 poses, pack with errors {factor} times as large ({now}), or use a smaller largest weight"
        );
        Error::invalid(format!("integer sums of this mesh could overflow: {fit}"), remedy)
    }
}
