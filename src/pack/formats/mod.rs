//! Delta formats: one file each, here and in `glsl/formats/`; `src/abi/formats.rs` lists them.

use super::POSE_FLOATS;
use crate::abi::formats::{FORMATS, FormatRow, delta_formats};
use crate::asset::streams::TRIPLES;
use crate::math::power_of_two_below;
use std::ops::Range;

macro_rules! declared {
    (()
        dense { $($(#[$dense_doc:meta])* $dense:ident $dense_file:ident $dense_row:tt)* }
        blocks { $($(#[$blocks_doc:meta])* $blocks:ident $blocks_file:ident $blocks_row:tt)* }
    ) => {
        $(pub(crate) mod $dense_file;)*
        $(pub(crate) mod $blocks_file;)*

        /// How deltas are stored.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum DeltaFormat {
            $($(#[$dense_doc])* $dense,)*
            $($(#[$blocks_doc])* $blocks,)*
        }

        impl DeltaFormat {
            /// All formats.
            pub const ALL: [Self; FORMATS.len()] = [$(Self::$dense,)* $(Self::$blocks),*];
            /// Formats of paths `feedback`, `compute` and `cpu`.
            pub const DENSE: [Self; [$(Self::$dense),*].len()] = [$(Self::$dense),*];
            /// Formats of paths `blocks` and `cpu`.
            pub const BLOCKS: [Self; [$(Self::$blocks),*].len()] = [$(Self::$blocks),*];
        }
    };
}
delta_formats!(declared());

/// Evaluates an expression with the format's concrete type as `$d` (dense) or `$b` (blocks).
macro_rules! with_format {
    ((@match $format:expr, $d:ident => $dense:expr, $b:ident => $blocks:expr)
        dense { $($(#[$dense_doc:meta])* $dense_name:ident $dense_file:ident $dense_row:tt)* }
        blocks { $($(#[$blocks_doc:meta])* $blocks_name:ident $blocks_file:ident $blocks_row:tt)* }
    ) => {
        match $format {
            $($crate::pack::DeltaFormat::$dense_name => {
                let $d = &$crate::pack::formats::$dense_file::$dense_name;
                $dense
            })*
            $($crate::pack::DeltaFormat::$blocks_name => {
                let $b = &$crate::pack::formats::$blocks_file::$blocks_name;
                $blocks
            })*
        }
    };
    ($format:expr, dense $d:ident => $dense:expr, blocks $b:ident => $blocks:expr) => {
        $crate::abi::formats::delta_formats!(with_format (@match $format, $d => $dense, $b => $blocks))
    };
}
pub(crate) use with_format;

impl DeltaFormat {
    /// Its row in the table that build.rs and tests share.
    #[doc(hidden)]
    pub const fn row(self) -> &'static FormatRow {
        &FORMATS[self as usize]
    }

    /// Whether it is a block format (paths `blocks` and `cpu`), whose deltas are integers, as fixed-point poses need.
    pub const fn is_blocks(self) -> bool {
        self.row().blocks
    }

    /// 32-bit words per delta; 0 for block formats, where it varies by entry.
    #[doc(hidden)]
    pub const fn words(self) -> usize {
        self.row().words as usize
    }

    /// Bytes per delta; 0 for block formats.
    #[doc(hidden)]
    pub const fn stride(self) -> usize {
        self.words() * 4
    }

    /// Vertex attributes per target in a feedback pass (dense formats).
    #[doc(hidden)]
    pub const fn attributes(self) -> usize {
        self.row().attributes.len()
    }

    /// The name used on the command line and in reports.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// One-line description, shown in the command line's help.
    #[doc(hidden)]
    pub const fn summary(self) -> &'static str {
        self.row().summary
    }

    /// The format of this id in packed files; `None` if there is none.
    #[doc(hidden)]
    pub fn from_id(id: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|f| id != 0 && f.row().id == id)
    }

    pub(crate) fn block_format(self) -> Option<&'static dyn BlockFormat> {
        with_format!(self, dense _f => None, blocks f => Some(f))
    }
}

/// A dense format: a fixed number of words per vertex and target.
pub(crate) trait DenseFormat {
    /// The first triple's step of a target with these largest numbers by triple, and log2 of second step / first step.
    fn steps(&self, largest: [f32; TRIPLES]) -> (f32, i8);

    fn encode(&self, delta: [f32; POSE_FLOATS], steps: [f32; TRIPLES], out: &mut [u32]);

    fn decode(&self, words: &[u32], steps: [f32; TRIPLES]) -> [f64; POSE_FLOATS];

    /// Adds the deltas of N targets for consecutive vertices to `sums`, each multiplied by its factors by triple, which
    /// include the steps.
    fn add<const N: usize>(&self, factors: [[f32; TRIPLES]; N], rows: [&[u32]; N], sums: &mut [f32]);
}

/// A vertex's index (in its block, or the user's) and delta.
pub(crate) type Lane = (u32, [f32; POSE_FLOATS]);

/// A delta in steps.
pub(crate) type Integers = [i32; POSE_FLOATS];

/// Most bits of an integer in any format, by triple.
pub(crate) const INTEGER_BITS: [u32; TRIPLES] = [18, 14];

/// A block format: encodes an entry as a header and delta words.
pub(crate) trait BlockFormat {
    /// Default vertices per block.
    fn default_size(&self) -> u32 {
        64
    }

    /// Steps by triple, powers of two: `wanted` from the error limits, `least` from the largest numbers and
    /// [`INTEGER_BITS`].
    fn steps(&self, wanted: [f64; TRIPLES], least: [f64; TRIPLES]) -> [f32; TRIPLES] {
        // Rounding down to a power of two at most halves a step.
        std::array::from_fn(|triple| power_of_two_below(wanted[triple].max(2.0 * least[triple])))
    }

    /// Whether finer steps reduce angular errors; not with a fixed width, whose bits are mostly all in use.
    fn refines(&self) -> bool {
        false
    }

    fn header_words(&self) -> usize;

    /// Range of the words of entry `entry` in `deltas`, for blocks of `size` vertices. May be out of bounds before the
    /// headers are checked.
    fn words(&self, entry: usize, header: &[u32], deltas: &[u32], size: usize) -> Range<usize>;

    /// Appends an entry to the headers and deltas `out`.
    fn encode(&self, size: usize, steps: [f32; TRIPLES], lanes: &[Lane], out: [&mut Vec<u32>; 2]);

    /// Checks an untrusted header: integers must fit their decoded type whatever the deltas are. Returns the bits of
    /// the largest integer, by triple.
    fn check_header(&self, header: &[u32]) -> Result<[u32; TRIPLES], String>;

    /// Left shifts of an entry's integers, by triple.
    fn shifts(&self, _header: &[u32]) -> [u32; TRIPLES] {
        [0; TRIPLES]
    }

    /// Whether it is `small`, whose entries are [`Records`](small::Records).
    #[inline(always)]
    fn has_records(&self) -> bool {
        false
    }

    /// Calls `f(lane, component, number)` for each number of an entry, at least for these vertices; 0 for those that it
    /// leaves out. A number is an integer to shift and multiply by the step. `deltas` begins with the entry's words,
    /// and may go on behind them.
    fn decode(
        &self,
        size: usize,
        lanes: Range<usize>,
        header: &[u32],
        deltas: &[u32],
        f: impl FnMut(usize, usize, i32),
    ) where
        Self: Sized;
}

/// The integer nearest to `value / step`.
pub(super) fn quantise(value: f32, step: f64) -> i32 {
    // As `round`, which is a call on baseline x86-64. Value and step have 24 bits each, so no quotient is so close to a
    // half that the sum would round to another integer.
    let exact = f64::from(value) / step;
    (exact + 0.5f64.copysign(exact)) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::PoseFormat;
    use ash::vk;

    /// VK_KHR_portability_subset leaves out other strides and offsets, and attributes beyond the stride.
    #[test]
    fn vertex_attributes_are_those_of_portable_drivers() {
        let deltas = DeltaFormat::ALL.into_iter().map(|format| (format.stride(), format.row().attributes));
        let poses = PoseFormat::ALL.into_iter().map(|format| (format.stride(), format.row().attributes));
        for (stride, attributes) in deltas.chain(poses) {
            assert_eq!(stride % 4, 0);
            for &(format, offset) in attributes {
                let size = match vk::Format::from_raw(format as i32) {
                    vk::Format::R32G32B32_SFLOAT | vk::Format::R32G32B32_SINT | vk::Format::R32G32B32_UINT => 12,
                    vk::Format::R16G16B16A16_SINT => 8,
                    vk::Format::R16G16_SINT => 4,
                    other => panic!("{other:?}: a format of unknown size"),
                };
                assert!(offset % 4 == 0 && offset as usize + size <= stride, "{offset} + {size} of {stride}");
            }
        }
    }

    #[test]
    fn every_format_is_in_the_list_under_a_name_and_a_number_of_its_own() {
        for (format, row) in DeltaFormat::ALL.into_iter().zip(FORMATS) {
            assert_eq!(format.row(), row);
            assert_eq!(format.block_format().is_some(), row.blocks);
            assert_eq!(DeltaFormat::from_id(row.id), row.blocks.then_some(format));
            assert!(row.summary.starts_with(if row.blocks { "In blocks, " } else { "Dense, " }), "{}", row.summary);
        }
        assert!(DeltaFormat::from_id(99).is_none());
    }
}
