//! Pose formats: one file each, here and in `glsl/poses/`; `src/abi/formats.rs` lists them.

pub(crate) mod sums;

use super::grid::PoseGrid;
use super::{BASE_STRIDE, DeltaFormat, POSE_FLOATS};
use crate::abi::formats::{POSE_FORMATS, PoseRow, pose_formats};
use bytemuck::Pod;
use sums::{Sum, rounded};

macro_rules! declared {
    (() $($(#[$meta:meta])* $name:ident $file:ident $row:tt)*) => {
        $(pub(crate) mod $file;)*

        /// How pose buffers store the six components of a vertex (position and normal, in the first group).
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum PoseFormat {
            $($(#[$meta])* $name,)*
        }

        impl PoseFormat {
            /// All formats.
            pub const ALL: [Self; POSE_FORMATS.len()] = [$(Self::$name),*];
        }
    };
}
pose_formats!(declared());

/// Evaluates `$code` with the format's concrete type as `$p`.
macro_rules! with_pose {
    ((@match $format:expr, $p:ident => $code:expr) $($(#[$meta:meta])* $name:ident $file:ident $row:tt)*) => {
        match $format {
            $($crate::pack::PoseFormat::$name => {
                type $p = $crate::pack::poses::$file::$name;
                $code
            })*
        }
    };
    ($format:expr, $p:ident => $code:expr) => {
        $crate::abi::formats::pose_formats!(with_pose (@match $format, $p => $code))
    };
}
pub(crate) use with_pose;

pub(crate) trait PoseStorage {
    /// A stored component; a vertex has six.
    type Number: Pod + Send + Sync;
    /// The CPU's sum of deltas in blocks.
    type Sum: Sum;

    /// Adds a sum. Integers wrap.
    fn plus(number: Self::Number, sum: Self::Sum) -> Self::Number;

    /// Sums are rounded after the base pose is added to them, which is then in finer units.
    const ROUNDS_SUMS: bool = false;

    /// Adds the base pose to a sum, if sums are rounded.
    #[inline(always)]
    fn plus_base(sum: Self::Sum, _word: u32) -> Self::Sum {
        sum
    }

    /// The sum to add: rounded, if sums are.
    #[inline(always)]
    fn rounded(sum: Self::Sum) -> Self::Sum {
        sum
    }
}

impl PoseFormat {
    /// Its row in the table that build.rs and tests share.
    #[doc(hidden)]
    pub const fn row(self) -> &'static PoseRow {
        &POSE_FORMATS[self as usize]
    }

    /// The name used on the command line and in reports.
    pub const fn name(self) -> &'static str {
        self.row().file
    }

    /// One-line description, shown in the command line's help.
    #[doc(hidden)]
    pub const fn summary(self) -> &'static str {
        self.row().summary
    }

    /// The name of the format in shaders, which is that of another with the same numbers: `rebuilt16` is decoded as
    /// `fixed16`. `glsl/host/pose.glsl` takes it as `POSE_FIXED16`, the WGSL of deltamorph-wgpu as `pose_fixed16`.
    pub const fn decoder(self) -> &'static str {
        self.row().modules
    }

    /// Bytes per vertex.
    pub const fn stride(self) -> usize {
        self.row().stride as usize
    }

    /// Whether poses are fixed-point: integers, independent of earlier poses.
    #[doc(hidden)]
    pub const fn has_integers(self) -> bool {
        self.row().bits > 0
    }

    /// Whether poses of this format can be sums of `deltas`: fixed-point poses need deltas in blocks.
    pub fn takes(self, deltas: DeltaFormat) -> bool {
        !self.has_integers() || deltas.is_blocks()
    }

    /// Whether a target's contribution is rounded to the unit, so that work lists hold applied and new weights.
    pub(crate) const fn rounds_products(self) -> bool {
        self.has_integers() && self.row().bits < i32::BITS && !self.row().rounds_sums
    }

    pub(crate) const fn number_bytes(self) -> usize {
        self.stride() / POSE_FLOATS
    }

    pub(crate) const fn offset(self, component: usize) -> usize {
        self.number_bytes() * component
    }

    /// The integers of a pose, [`POSE_FLOATS`] per vertex; empty for float32.
    #[doc(hidden)]
    pub fn integers(self, pose: &[u8]) -> Vec<i32> {
        match self.row().bits {
            0 => vec![],
            16 => pose.as_chunks().0.iter().map(|bytes| i16::from_ne_bytes(*bytes).into()).collect(),
            _ => pose.as_chunks().0.iter().map(|bytes| i32::from_ne_bytes(*bytes)).collect(),
        }
    }

    /// The components of a pose, [`POSE_FLOATS`] per vertex, in input units: offset + integer × unit on `grid`; float32
    /// takes none.
    #[doc(hidden)]
    pub fn decode(self, pose: &[u8], grid: Option<&PoseGrid>) -> Vec<f32> {
        let Some(grid) = grid.filter(|_| self.has_integers()) else {
            return pose.as_chunks().0.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect();
        };
        let numbers = self.integers(pose).into_iter().enumerate();
        // The unit is a power of two: integers below 2^24 scale exactly.
        let value = |(i, number)| grid.offsets[i % POSE_FLOATS] + number as f32 * grid.units[i % POSE_FLOATS];
        numbers.map(value).collect()
    }

    /// Bytes per vertex of the base pose that kernels for blocks load.
    pub(crate) const fn base_stride(self) -> usize {
        if self.row().rounds_sums { BASE_STRIDE } else { self.stride() }
    }

    /// The base pose of a group with `vertices` vertices, as kernels for blocks load it: a pose or, where sums are
    /// rounded, a word for each number.
    pub(crate) fn base_words(self, grid: &PoseGrid, base: &[f32], vertices: usize) -> Vec<u32> {
        match grid.rounds_sums {
            true => bytemuck::cast_slice(&grid.integers(base, vertices)).to_vec(),
            false => self.base_pose(grid, base, vertices),
        }
    }

    /// The words of the base pose of a group with `vertices` vertices, on `grid`.
    pub(crate) fn base_pose(self, grid: &PoseGrid, base: &[f32], vertices: usize) -> Vec<u32> {
        let mut words = vec![0; base.len() * self.number_bytes() / size_of::<u32>()];
        let integers = grid.integers(base, vertices).into_iter();
        match self.row().bits {
            16 => {
                let halves: &mut [i16] = bytemuck::cast_slice_mut(&mut words);
                let integers = integers.map(|integer| if grid.rounds_sums { rounded(integer) } else { integer });
                halves.iter_mut().zip(integers).for_each(|(half, integer)| *half = integer as i16);
            }
            _ => words.iter_mut().zip(integers).for_each(|(word, integer)| *word = integer as u32),
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::VERTEX_PADDING;

    #[test]
    fn poses_begin_where_descriptors_may() {
        for format in PoseFormat::ALL {
            assert_eq!(POSE_FORMATS.iter().filter(|row| row.file == format.row().file).count(), 1);
            assert_eq!(with_pose!(format, P => size_of::<<P as PoseStorage>::Number>()), format.number_bytes());
            assert_eq!(format.stride() * VERTEX_PADDING % 256, 0, "{format:?}");
            assert!((0..POSE_FLOATS).all(|component| format.offset(component) < format.stride()), "{format:?}");
        }
    }
}
