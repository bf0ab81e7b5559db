//! How deltas are stored: a file for each format, here and under `glsl/formats/`, and one list of them,
//! `src/abi/formats.rs`.

mod shifts;

use super::POSE_FLOATS;
use super::grid::Term;
use crate::abi::formats::{FORMATS, FormatRow, delta_formats};
use crate::asset::streams::TRIPLES;
use crate::error::{Error, Result};
use crate::math::power_of_two_below;
use std::ops::Range;
use std::str::FromStr;

/// The files of the formats, and their names.
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
            /// Every format.
            pub const ALL: [Self; FORMATS.len()] = [$(Self::$dense,)* $(Self::$blocks),*];
            /// The formats of the paths `feedback`, `compute` and `cpu`.
            pub const DENSE: [Self; [$(Self::$dense),*].len()] = [$(Self::$dense),*];
            /// The formats of the paths `blocks` and `cpu`.
            pub const BLOCKS: [Self; [$(Self::$blocks),*].len()] = [$(Self::$blocks),*];
        }
    };
}
delta_formats!(declared());

/// Evaluate code with `$f` as the format's own type: dense formats one code, formats in blocks the other.
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
    /// What build.rs and the tests know of it, too.
    #[doc(hidden)]
    pub const fn row(self) -> &'static FormatRow {
        &FORMATS[self as usize]
    }

    /// Whether deltas lie in blocks, for the paths `blocks` and `cpu`.
    pub const fn is_blocks(self) -> bool {
        self.row().blocks
    }

    /// Whether deltas are integers, which poses of integers are sums of.
    pub const fn has_integers(self) -> bool {
        self.row().integers
    }

    /// 32-bit words of one delta in a dense format; 0 for block formats, where they differ from entry to entry.
    pub const fn words(self) -> usize {
        self.row().words as usize
    }

    /// Bytes of one delta in a dense format; 0 for block formats.
    pub const fn stride(self) -> usize {
        self.words() * 4
    }

    /// Vertex attributes that one target takes in a feedback pass (dense formats).
    pub const fn attributes(self) -> usize {
        self.row().attributes.len()
    }

    /// The name used on the command line and in reports. The paths `feedback` and `compute` mean the dense `float32`,
    /// `blocks` the one in blocks.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// What it is, in a line: what the command line's help says of it.
    pub const fn summary(self) -> &'static str {
        self.row().summary
    }

    /// The format with this number in packed files.
    pub fn from_id(id: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|f| id != 0 && f.row().id == id)
    }

    /// The block format, unless it is a dense one.
    pub(crate) fn block_format(self) -> Option<&'static dyn BlockFormat> {
        with_format!(self, dense _f => None, blocks f => Some(f))
    }
}

/// From its [name](DeltaFormat::name).
impl FromStr for DeltaFormat {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|f| f.name() == name).ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            Error::invalid(format!("there is no delta format '{name}'"), format!("use one of {names}"))
        })
    }
}

/// A dense format: every vertex of every target has as many words.
pub(crate) trait DenseFormat {
    /// The steps of a target whose largest numbers, by triple, are these: that of the first triple, and the power of
    /// two that it is multiplied by for the second.
    fn steps(&self, largest: [f32; TRIPLES]) -> (f32, i8);

    /// Write a delta.
    fn encode(&self, delta: [f32; POSE_FLOATS], steps: [f32; TRIPLES], out: &mut [u32]);

    /// The reverse of [`encode`](Self::encode).
    fn decode(&self, words: &[u32], steps: [f32; TRIPLES]) -> [f64; POSE_FLOATS];

    /// Add N targets' deltas of consecutive vertices to `sums`, each target times its factors (by triple; they hold the
    /// steps).
    fn add<const N: usize>(&self, factors: [[f32; TRIPLES]; N], rows: [&[u32]; N], sums: &mut [f32]);

    /// Add what a target adds to poses of integers, by triple; never called for float32 deltas, which have no grid.
    fn add_terms(&self, terms: [Term; TRIPLES], row: &[u32], sums: &mut [i32]);
}

/// A delta of a vertex in an entry: its place in the block, and its numbers.
pub(crate) type Lane = (u32, [f32; POSE_FLOATS]);

/// Most bits of an integer of the two triples, in any format.
pub(crate) const INTEGER_BITS: [u32; TRIPLES] = [18, 14];

/// A format in blocks: how the deltas of an entry lie in a header and in words of their own.
pub(crate) trait BlockFormat {
    /// Default number of vertices of a block.
    fn default_size(&self) -> u32 {
        64
    }

    /// Steps of integers, by triple: powers of two. `wanted` keep to the errors allowed, and `least` let the largest
    /// numbers fit [`INTEGER_BITS`].
    fn steps(&self, wanted: [f64; TRIPLES], least: [f64; TRIPLES]) -> [f32; TRIPLES] {
        // Rounding down to a power of two halves a step at most.
        std::array::from_fn(|triple| power_of_two_below(wanted[triple].max(2.0 * least[triple])))
    }

    /// Whether finer steps reduce the error of angles (not where the number of bits is fixed: mostly all are in use).
    fn refines(&self) -> bool {
        false
    }

    /// Whether an entry may have deltas of some of its block's vertices only.
    fn is_sparse(&self) -> bool {
        false
    }

    /// Words of an entry's header.
    fn header_words(&self) -> usize;

    /// Which of all `deltas` are those of entry `entry`, in blocks of `size` vertices. May lie behind the last where
    /// nothing was checked yet.
    fn words(&self, entry: usize, header: &[u32], deltas: &[u32], size: usize) -> Range<usize>;

    /// Append an entry to all headers and to all deltas.
    fn encode(&self, size: usize, steps: [f32; TRIPLES], lanes: &[Lane], out: [&mut Vec<u32>; 2]);

    /// Check the header of an entry that may be hostile: integers have to fit what decodes them, whatever the deltas
    /// are. Bits of the largest, by triple.
    fn check_header(&self, header: &[u32]) -> Result<[u32; TRIPLES], String>;

    /// Check all delta words, which may be hostile.
    fn check_deltas(&self, _deltas: &[u32]) -> Result<(), String> {
        Ok(())
    }

    /// By how many bits the integers of an entry are to be shifted, by triple.
    fn shifts(&self, _header: &[u32]) -> [u32; TRIPLES] {
        [0; TRIPLES]
    }

    /// What the numbers of a delta are decoded to: integers to be shifted and multiplied by a step, or input units.
    type Component: Copy
    where
        Self: Sized;

    /// Call `f` with each number of each delta of an entry: the vertex's place in the block, the component, the number.
    fn decode(&self, size: usize, header: &[u32], deltas: &[u32], f: impl FnMut(usize, usize, Self::Component))
    where
        Self: Sized;
}

/// The words of an entry where each has `length`.
#[inline(always)]
fn fixed(entry: usize, length: usize) -> Range<usize> {
    entry * length..(entry + 1) * length
}

/// The multiple of `step` that is nearest to `value`; zero stays zero.
fn quantise(value: f32, step: f64) -> i32 {
    (f64::from(value) / step).round() as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_is_in_the_list_under_a_name_and_a_number_of_its_own() {
        for (format, row) in DeltaFormat::ALL.into_iter().zip(FORMATS) {
            assert_eq!((format.row(), format.name().parse::<DeltaFormat>().unwrap()), (row, format));
            assert_eq!(format.block_format().is_some(), row.blocks);
            assert_eq!(DeltaFormat::from_id(row.id), row.blocks.then_some(format));
            assert!(row.summary.starts_with(if row.blocks { "In blocks, " } else { "Dense, " }), "{}", row.summary);
        }
        let ids = DeltaFormat::BLOCKS.map(|format| format.row().id);
        assert_eq!(ids, std::array::from_fn(|i| i as u32 + 1));
        assert!(DeltaFormat::from_id(99).is_none());
        assert!("float16".parse::<DeltaFormat>().unwrap_err().to_string().contains("block-float32, fast"));
    }
}
