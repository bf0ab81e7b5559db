//! Block formats: deltas of the blocks that a target touches, and nothing else.
//!
//! Vertices are reordered (targets cover few blocks then) and cut into blocks of 32, 64 or 128. An *entry* is a target
//! that touches a block, with its deltas there. Each triple of a group has one step for the whole mesh, a power of two:
//! integer sums of all entries of a vertex have one unit then ([`PoseGrid`]).
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

pub use super::grid::PoseGrid;
pub(super) use pack::pack;

use super::formats::{BlockFormat, with_format};
use super::grid::Sums;
use super::order::inverse;
use super::{DeltaFormat, POSE_FLOATS, PoseError, PoseFormat};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::error::Result;
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
    /// Largest error of a position delta (a length), as a fraction of the bounding-box diagonal, above 0. Integers of a
    /// fixed number of bits may exceed it where a target moves further than they reach; [`BlockIndex::error`] has what
    /// was measured.
    pub position_error: f32,
    /// Largest error of a normal or tangent at weight 1, in degrees, above 0.
    pub normal_error_degrees: f32,
    /// Largest error of the numbers of other streams (texture coordinates, colours, masks) at weight 1, above 0.
    pub absolute_error: f32,
    /// The largest weight, either sign, that poses of 32-bit integers
    /// ([`PoseFormat::Fixed32`](crate::pack::PoseFormat::Fixed32)) accept, unless a crowd names another one.
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
    pub(crate) parts: Parts,
    // Derived from it and the words.
    /// Index of the first delta word: the headers end there.
    pub(crate) deltas_at: usize,
    words: usize,
    /// The components that are positions.
    lengths: Range<usize>,
    pub(super) sums: Sums,
    /// Of each entry.
    pub(crate) costs: Vec<EntryCost>,
    /// `[entry][component][word]`: which vertices' components its deltas change.
    pub(crate) masks: Vec<u32>,
    first_incidence: Vec<u32>,
    incidence: Vec<Incidence>,
    /// `[block][component][word]`: which components some target changes.
    pub(crate) block_masks: Vec<u32>,
    /// Largest base position component of each block, and Σ reach of its entries.
    pub(crate) block_base: Vec<f32>,
    pub(crate) block_reach: Vec<f32>,
}

/// What a [`BlockIndex`] is made from: what a packed file holds of it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Parts {
    pub format: DeltaFormat,
    pub size: u32,
    pub order: Arc<[u32]>,
    pub steps: [f32; TRIPLES],
    pub weight_max: f32,
    pub error: PoseError,
    pub first_entry: Vec<u32>,
    pub entry_target: Vec<u32>,
}

impl BlockIndex {
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

    /// The most targets that touch a block.
    pub fn most_entries(&self) -> usize {
        (0..self.count()).map(|block| self.entries(block).len()).max().unwrap_or(0)
    }

    /// The grid for poses of integers and weights up to `weight_max`, either sign; `None`: up to 1 in 16 bits, up to
    /// what the mesh was packed with ([`BlockDesc::weight_max`]) in 32.
    ///
    /// # Errors
    /// `block-float32` has no integers, float32 poses neither; a largest weight that is not above 0, or so large, or
    /// deltas so large against their step, that sums could overflow: the message names a position error that would do.
    pub fn grid(&self, pose: PoseFormat, weight_max: Option<f32>) -> Result<PoseGrid> {
        self.sums.grid(pose, weight_max)
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

    pub(crate) fn entries(&self, block: usize) -> Range<usize> {
        self.parts.first_entry[block] as usize..self.parts.first_entry[block + 1] as usize
    }

    pub(crate) fn incidence(&self, target: usize) -> &[Incidence] {
        &self.incidence[self.first_incidence[target] as usize..self.first_incidence[target + 1] as usize]
    }

    /// The header of an entry, and where `words` has its deltas: `format` is that of the mesh. Kernels, which look up
    /// many short entries, pass it as its own type.
    #[inline(always)]
    pub(crate) fn locate<'a>(
        &self,
        format: &(impl BlockFormat + ?Sized),
        words: &'a [u32],
        entry: usize,
    ) -> (&'a [u32], Range<usize>) {
        let length = format.header_words();
        let header = &words[entry * length..][..length];
        let deltas = format.words(entry, header, &words[self.deltas_at..], self.size());
        (header, self.deltas_at.saturating_add(deltas.start)..self.deltas_at.saturating_add(deltas.end))
    }

    /// Call `f` with each vertex of an entry's block that it holds a delta for: its index in the block, and the delta
    /// in input units, in formats of integers an exact multiple of the [steps](Self::steps).
    pub(crate) fn for_each_lane(&self, words: &[u32], entry: usize, mut f: impl FnMut(usize, [f64; POSE_FLOATS])) {
        with_format!(self.parts.format, dense _f => {}, blocks format => {
            let (header, deltas) = self.locate(format, words, entry);
            let shifts = format.shifts(header);
            let steps = if self.parts.format.has_integers() { self.parts.steps } else { [1.0; TRIPLES] };
            let units = [0, 1].map(|triple| f64::from(steps[triple]) * f64::from(1u32 << shifts[triple]));
            let mut lanes = [None; BLOCK_SIZES[2] as usize];
            format.decode(self.size(), header, &words[deltas], |lane, c, number| {
                lanes[lane].get_or_insert([0.0; POSE_FLOATS])[c] = f64::from(number) * units[c / TRIPLE];
            });
            for (lane, delta) in lanes.into_iter().enumerate().filter_map(|(lane, delta)| Some((lane, delta?))) {
                f(lane, delta);
            }
        });
    }
}

#[cfg(test)]
mod tests;
