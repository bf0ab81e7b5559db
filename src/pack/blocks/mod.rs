//! Block formats: deltas of the blocks that a target touches, and nothing else.
//!
//! Vertices are reordered (targets cover few blocks then) and cut into blocks of 32, 64 or 128. An *entry* is a target
//! that touches a block, with its deltas there. The two triples of a group have one step each for the whole mesh, a power of
//! two, so that integer sums of all entries of a vertex have one unit ([`Accumulate::Exact`](crate::plan::Accumulate)).
//!
//! ```text
//! words   [entry][header words] [entry][delta words]       entries block after block, ascending by target
//! base    [vertex][px py pz nx ny nz]                      in the packed order, padded to whole blocks
//! ```
//!
//! Integers are rounded to nearest, and zero decodes to zero. A delta that is not longer than the error allowed is
//! dropped, for each stream on its own.

mod derive;
mod pack;

pub(super) use pack::{pack, target};

use super::formats::{BlockFormat, Component, with_format};
use super::order::inverse;
use super::{POSE_FLOATS, PoseError};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::error::{Error, Result};
use crate::setters::setters;
use std::ops::Range;
use std::sync::Arc;

/// Sizes that a block may have.
pub const BLOCK_SIZES: [u32; 3] = [32, 64, 128];

/// How to pack into blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct BlockDesc {
    /// Vertices of a block: one of [`BLOCK_SIZES`]; `None`: what suits the format (32 for `small`, else 64).
    pub size: Option<u32>,
    /// Largest error of a position delta (a length), as a fraction of the bounding-box diagonal, above 0. A format whose
    /// integers have a fixed number of bits may exceed it where a target moves further than they reach;
    /// [`BlockIndex::error`] has what was measured.
    pub position_error: f32,
    /// Largest error of a normal or tangent at weight 1, in degrees, above 0.
    pub normal_error_degrees: f32,
    /// Largest error of the numbers of other streams (texture coordinates, colours) at weight 1, above 0.
    pub absolute_error: f32,
    /// The largest weight, either sign, that [`Accumulate::Exact`](crate::plan::Accumulate) accepts.
    pub weight_max: f32,
}

setters!(BlockDesc {
    size: Option<u32>,
    position_error: f32,
    normal_error_degrees: f32,
    absolute_error: f32,
    weight_max: f32,
});

impl Default for BlockDesc {
    /// 1e-5 of the diagonal, 0.5°, 1e-4 (less than half a texel of 4096), weights up to 4.
    fn default() -> Self {
        Self { size: None, position_error: 1e-5, normal_error_degrees: 0.5, absolute_error: 1e-4, weight_max: 4.0 }
    }
}

/// The grid of weights on which integer sums cannot overflow, whatever the weights up to its largest.
///
/// Rounding to it moves a component by at most ½·[`weight_step`](Self::weight_step)·Σ|delta|, on top of what packing lost
/// of the deltas ([`BlockIndex::error`], for each target at weight 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactGrid {
    /// Weights are whole multiples of 2^-bits.
    pub weight_bits: u32,
    /// The largest weight, either sign.
    pub weight_max: f32,
}

impl ExactGrid {
    /// The step of weights.
    pub fn weight_step(&self) -> f32 {
        1.0 / (1u32 << self.weight_bits) as f32
    }

    /// The multiple of the step that is nearest to `weight`: what exact sums take for it.
    pub fn round(&self, weight: f32) -> f32 {
        self.steps(weight) as f32 * self.weight_step()
    }

    /// `weight` in steps. Both factors of the product fit 24 bits, and a power of two changes none: one rounding.
    pub(crate) fn steps(&self, weight: f32) -> i32 {
        (weight * (1u32 << self.weight_bits) as f32).round() as i32
    }
}

/// Fewer bits than this are no grid to animate on.
const WEIGHT_BITS_MIN: u32 = 7;

/// An entry as seen from its target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Incidence {
    pub block: u32,
    pub entry: u32,
}

/// What a kernel loads for an entry, and what it may change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EntryCost {
    /// Bytes of its header and deltas.
    pub bytes: u32,
    /// Length of its longest position delta, in input units; 0 in groups without positions.
    pub reach: f32,
}

/// The blocks of a mesh: which targets touch them, and where their deltas are.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockIndex {
    parts: Parts,
    // Derived from it and the words.
    deltas_at: usize,
    words: usize,
    exact: Option<ExactGrid>,
    /// The largest Σ|integer| of any vertex component.
    largest_sum: u64,
    costs: Vec<EntryCost>,
    /// `[entry][component][word]`: which vertices' components its deltas change.
    masks: Vec<u32>,
    first_incidence: Vec<u32>,
    incidence: Vec<Incidence>,
    /// `[block][component][word]`: which components some target changes.
    block_masks: Vec<u32>,
    /// Largest base position component of each block, and Σ reach of its entries.
    block_base: Vec<f32>,
    block_reach: Vec<f32>,
}

/// What a [`BlockIndex`] is made from: what a packed file holds of it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Parts {
    pub format: &'static dyn BlockFormat,
    pub size: u32,
    pub order: Arc<[u32]>,
    pub steps: [f32; TRIPLES],
    pub weight_max: f32,
    pub error: PoseError,
    pub first_entry: Vec<u32>,
    pub entry_target: Vec<u32>,
}

impl BlockIndex {
    /// The grid for [`Accumulate::Exact`](crate::plan::Accumulate).
    ///
    /// # Errors
    /// `block-float32` has no integers; deltas so large against their step that sums could overflow: the message
    /// names a position error that would do.
    pub fn exact(&self) -> Result<ExactGrid> {
        if !self.parts.format.format().has_integers() {
            return Err(Error::invalid("exact accumulation of float32 deltas", "pack as 'fast' or 'small'"));
        }
        self.exact.ok_or_else(|| {
            let room = f64::from(i32::MAX) / f64::from(self.parts.weight_max) / f64::from(1u32 << WEIGHT_BITS_MIN);
            let factor = (self.largest_sum as f64 / room).log2().ceil().exp2();
            Error::invalid(
                format!(
                    "integer sums of this mesh could overflow: a vertex adds up to {} steps, {room:.0} fit weights up \
                     to {}",
                    self.largest_sum, self.parts.weight_max
                ),
                format!(
                    "pack with errors {factor} times as large (now {:.1e} in length and {:.2}° at most), or with a \
                     smaller largest weight",
                    f64::from(self.parts.steps[0]) * 0.75f64.sqrt(),
                    (f64::from(self.parts.steps[1]) * 0.75f64.sqrt()).to_degrees()
                ),
            )
        })
    }

    /// Take a coarser grid, which other groups need.
    pub(super) fn set_exact(&mut self, grid: Option<ExactGrid>) {
        self.exact = grid;
    }

    /// Vertices of a block.
    pub fn size(&self) -> usize {
        self.parts.size as usize
    }

    /// Number of blocks.
    pub fn count(&self) -> usize {
        self.parts.first_entry.len() - 1
    }

    /// Number of entries: pairs of a block and a target that touches it.
    pub fn entry_count(&self) -> usize {
        self.parts.entry_target.len()
    }

    /// Blocks that some target touches.
    pub fn touched(&self) -> usize {
        (0..self.count()).filter(|&b| !self.entries(b).is_empty()).count()
    }

    /// Packed → user vertex order.
    pub fn order(&self) -> &[u32] {
        &self.parts.order
    }

    /// User → packed vertex order.
    pub fn packed_vertices(&self) -> Vec<u32> {
        inverse(&self.parts.order)
    }

    /// What packing lost, measured when the mesh was packed.
    pub fn error(&self) -> PoseError {
        self.parts.error
    }

    /// Input units of an integer step, for each triple of the group: of positions and of normals.
    pub fn steps(&self) -> [f32; TRIPLES] {
        self.parts.steps
    }

    /// Bytes of the deltas.
    pub fn delta_bytes(&self) -> u64 {
        4 * (self.words - self.deltas_at) as u64
    }

    /// Bytes that say which vertices the deltas belong to and how they are stored.
    pub fn index_bytes(&self) -> u64 {
        4 * self.deltas_at as u64
    }

    /// 32-bit words of a mask of a block's vertices.
    pub(crate) fn mask_words(&self) -> usize {
        self.parts.size as usize / 32
    }

    /// Index of the first delta word: the headers end there.
    pub(crate) fn deltas_at(&self) -> usize {
        self.deltas_at
    }

    pub(crate) fn format(&self) -> &'static dyn BlockFormat {
        self.parts.format
    }

    pub(crate) fn weight_max(&self) -> f32 {
        self.parts.weight_max
    }

    pub(crate) fn first_entries(&self) -> &[u32] {
        &self.parts.first_entry
    }

    pub(crate) fn entry_targets(&self) -> &[u32] {
        &self.parts.entry_target
    }

    pub(crate) fn entries(&self, block: usize) -> Range<usize> {
        self.parts.first_entry[block] as usize..self.parts.first_entry[block + 1] as usize
    }

    pub(crate) fn incidence(&self, target: usize) -> &[Incidence] {
        &self.incidence[self.first_incidence[target] as usize..self.first_incidence[target + 1] as usize]
    }

    pub(crate) fn costs(&self) -> &[EntryCost] {
        &self.costs
    }

    pub(crate) fn masks(&self) -> &[u32] {
        &self.masks
    }

    pub(crate) fn block_masks(&self) -> &[u32] {
        &self.block_masks
    }

    /// Largest base position component of each block.
    pub(crate) fn block_base(&self) -> &[f32] {
        &self.block_base
    }

    /// Σ of the longest deltas of each block's entries.
    pub(crate) fn block_reach(&self) -> &[f32] {
        &self.block_reach
    }

    /// The header of an entry, and where `words` has its deltas: `format` is that of the mesh. Kernels, which look up many
    /// short entries, pass it as its own type.
    #[inline(always)]
    pub(crate) fn locate<'a>(
        &self,
        format: &(impl BlockFormat + ?Sized),
        words: &'a [u32],
        entry: usize,
    ) -> (&'a [u32], Range<usize>) {
        let length = format.header_words(self.size());
        let header = &words[entry * length..][..length];
        let deltas = format.words(entry, header, self.size());
        (header, self.deltas_at.saturating_add(deltas.start)..self.deltas_at.saturating_add(deltas.end))
    }

    /// Call `f` with each vertex of an entry's block that it holds a delta for: its place in the block, the delta in
    /// input units, and in steps (zero for float32).
    pub(crate) fn for_each_lane(
        &self,
        words: &[u32],
        entry: usize,
        mut f: impl FnMut(usize, [f64; POSE_FLOATS], [i32; POSE_FLOATS]),
    ) {
        let steps = self.parts.steps.map(f64::from);
        with_format!(self.parts.format.format(), dense _f => {}, blocks format => {
            let (header, deltas) = self.locate(format, words, entry);
            let shifts = format.shifts(header);
            let mut lanes = [None; BLOCK_SIZES[2] as usize];
            format.decode(self.size(), header, &words[deltas], |lane, c, number| {
                let (value, integer) = lanes[lane].get_or_insert(([0.0; POSE_FLOATS], [0; POSE_FLOATS]));
                (value[c], integer[c]) = number.value(steps[c / TRIPLE], shifts[c / TRIPLE]);
            });
            for (lane, (value, integer)) in lanes.into_iter().enumerate().filter_map(|(i, lane)| Some((i, lane?))) {
                f(lane, value, integer);
            }
        });
    }

    /// [`PackedGroup::for_each_delta`](super::PackedGroup::for_each_delta), of deltas in `words`.
    pub(crate) fn for_each_delta(&self, words: &[u32], target: usize, mut f: impl FnMut(usize, [f64; POSE_FLOATS])) {
        for incidence in self.incidence(target) {
            let first = incidence.block as usize * self.parts.size as usize;
            self.for_each_lane(words, incidence.entry as usize, |lane, delta, _| {
                if let Some(&user) = self.parts.order.get(first + lane) {
                    f(user as usize, delta);
                }
            });
        }
    }
}

#[cfg(test)]
mod tests;
