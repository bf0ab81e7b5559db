//! Block formats: only the deltas of blocks that a target touches.
//!
//! Vertices are reordered so that targets cover few blocks, and cut into blocks of 32, 64 or 128. An *entry* holds the
//! deltas of one target in one block. Each triple of a group has one step for the whole mesh, a power of two, so that
//! the integer sums of a vertex have one unit ([`PoseGrid`]).
//!
//! ```text
//! words   [entry][header words] [entry][delta words]       entries block after block, ascending by target
//! base    [vertex][px py pz nx ny nz]                      in the packed order, padded to whole blocks
//! ```
//!
//! Integers are rounded to nearest, in `small` to any within the error limit; zero stays zero. A delta within the error
//! limit of its stream is dropped.

pub(super) mod derive;
mod pack;

pub use super::grid::PoseGrid;
pub(super) use pack::pack;

use super::formats::{BlockFormat, with_format};
use super::order::inverse;
use super::{DeltaFormat, POSE_FLOATS, PoseError};
use crate::asset::streams::{TRIPLE, TRIPLES};
use std::ops::Range;
use std::sync::Arc;

/// Supported block sizes.
pub const BLOCK_SIZES: [u32; 3] = [32, 64, 128];

/// Describes packing in blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockDesc {
    /// Vertices per block, one of [`BLOCK_SIZES`]. `None`: 32 for `small`, else 64.
    pub size: Option<u32>,
    /// Largest error of a position delta (a length), as a fraction of
    /// [`PackedLayout::diagonal`](crate::PackedLayout::diagonal); positive. Formats with a fixed number of bits exceed
    /// it if a target moves further than they reach; [`PackedLayout::error`](crate::PackedLayout::error) is measured.
    pub position_error: f32,
    /// Largest error of a normal or tangent at weight 1, in degrees; positive.
    pub normal_error_degrees: f32,
    /// Largest error of other streams (texture coordinates, colours, masks) at weight 1; positive.
    pub absolute_error: f32,
    /// Largest absolute weight for 32-bit fixed-point poses
    /// ([`PoseFormat::Fixed32`](crate::pack::PoseFormat::Fixed32)), unless
    /// [`UpdateDesc::weight_max`](crate::UpdateDesc) is set.
    pub weight_max: f32,
}

impl Default for BlockDesc {
    /// 1e-5 of the diagonal, 0.5°, 1e-4 (less than half a texel of 4096), weights up to 4.
    fn default() -> Self {
        Self { size: None, position_error: 1e-5, normal_error_degrees: 0.5, absolute_error: 1e-4, weight_max: 4.0 }
    }
}

/// A block that a target touches, and the entry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Incidence {
    pub block: u32,
    pub entry: u32,
}

/// Load cost and effect of an entry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EntryCost {
    /// Bytes of its header and deltas.
    pub bytes: u32,
    /// Length of its longest position delta, in input units; 0 in groups without positions.
    pub reach: f32,
    /// The vertices that it moves, and some between them; whole vectors of 8.
    pub lanes: [u8; 2],
}

/// The blocks of a mesh: the targets that touch them, and the layout of their deltas.
#[derive(Clone, Debug, PartialEq)]
#[doc(hidden)]
pub struct BlockIndex {
    pub(crate) parts: Parts,
    // Derived from `parts` and the words.
    /// First delta word, after all headers.
    pub(crate) deltas_at: usize,
    words: usize,
    /// The position components.
    lengths: Range<usize>,
    pub(crate) costs: Vec<EntryCost>,
    first_incidence: Vec<u32>,
    incidence: Vec<Incidence>,
    /// By block: the largest base position component, and Σ reach of its entries.
    pub(crate) block_base: Vec<f32>,
    pub(crate) block_reach: Vec<f32>,
}

/// The data of a [`BlockIndex`] that a packed file stores.
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
    /// Vertices per block.
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

    /// Number of blocks that any target touches.
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

    /// The packing error, measured when the mesh was packed.
    pub fn error(&self) -> PoseError {
        self.parts.error
    }

    /// Input units per integer step, by triple of the group (positions, normals).
    pub fn steps(&self) -> [f32; TRIPLES] {
        self.parts.steps
    }

    /// Bytes of deltas.
    pub fn delta_bytes(&self) -> u64 {
        4 * (self.words - self.deltas_at) as u64
    }

    /// Bytes of index data (headers of entries).
    pub fn index_bytes(&self) -> u64 {
        4 * self.deltas_at as u64
    }

    pub(crate) fn entries(&self, block: usize) -> Range<usize> {
        self.parts.first_entry[block] as usize..self.parts.first_entry[block + 1] as usize
    }

    pub(crate) fn incidence(&self, target: usize) -> &[Incidence] {
        &self.incidence[self.first_incidence[target] as usize..self.first_incidence[target + 1] as usize]
    }

    /// The header of an entry, and the range of its deltas in `words`. `format` is the mesh's; kernels, which read many
    /// short entries, pass its concrete type.
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

    /// Calls `f(vertex, delta)` for each delta of an entry: index in the block, and delta in input units, an exact
    /// multiple of the [steps](Self::steps). Not generic: copies for two callers took 15 kB of the C
    /// library.
    pub(crate) fn for_each_lane(&self, words: &[u32], entry: usize, f: &mut dyn FnMut(usize, [f64; POSE_FLOATS])) {
        with_format!(self.parts.format, dense _f => {}, blocks format => {
            let (header, deltas) = self.locate(format, words, entry);
            let shifts = format.shifts(header);
            let units = [0, 1].map(|triple| f64::from(self.parts.steps[triple]) * f64::from(1u32 << shifts[triple]));
            let mut lanes = [None; BLOCK_SIZES[2] as usize];
            format.decode(self.size(), 0..self.size(), header, &words[deltas], |lane, c, number| {
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
