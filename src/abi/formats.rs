//! The delta formats and the pose formats: two lists shared by build.rs, the library, the command line and the tests.
//!
//! A delta format is an item of `delta_formats!` and the files src/pack/formats/FILE.rs and glsl/formats/FILE.glsl; a
//! pose format an item of `pose_formats!`, src/pack/poses/FILE.rs and glsl/poses/FILE.glsl. build.rs includes this
//! file, so it is plain data without dependencies.

/// Expands a macro with arguments and the list: dense formats, then block formats.
///
/// An item is the documentation of a `DeltaFormat` (the first line is its summary in the command line's help), its
/// name, its file name, and the [`FormatRow`] fields that differ from the defaults of [`dense`](FormatRow::dense) or
/// [`blocks`](FormatRow::blocks). Append items: reports and tables use this order.
macro_rules! delta_formats {
    ($expanded:ident $arguments:tt) => {
        $expanded! { $arguments
            dense {
                /// Dense, six float32: 24 bytes per vertex and target
                ///
                /// Exact. Two vertex attributes per target.
                Float32 float32 { words: 6, attributes: &[(R32G32B32_SFLOAT, 0), (R32G32B32_SFLOAT, 12)] }

                /// Dense, six signed 16-bit integers: 12 bytes per vertex and target
                ///
                /// Three words, one vertex attribute per target. Value = integer × step, with a step for each triple of
                /// a target: the smallest power of two with which its largest component fits.
                Snorm16 snorm16 { words: 3, attributes: &[(R32G32B32_UINT, 0)], exponents: true }
            }
            blocks {
                /// In blocks, 9 bytes per vertex of a block that a target affects
                ///
                /// 15 bits per component in the first triple, 9 in the second, in planes that a kernel reads as three
                /// words.
                Fast fast { id: 2 }

                /// In blocks, only the vertices that move, with the fewest bits that the error allows: the smallest
                ///
                /// Bit widths per entry and component.
                Small small { id: 3 }
            }
        }
    };
}
pub(crate) use delta_formats;

/// Expands a macro with arguments and the list of pose formats.
///
/// An item is the documentation of a `PoseFormat` (the first line is its summary in the command line's help), its name,
/// its file name, which is also its name on the command line, and the [`PoseRow`] fields that differ from float32's.
/// Append items: reports and tables use this order.
macro_rules! pose_formats {
    ($expanded:ident $arguments:tt) => {
        $expanded! { $arguments
            /// Six float32: 24 bytes per vertex
            ///
            /// Two vertex attributes of three floats, at 0 and 12. Accumulation rounds.
            #[default]
            Float32 float32 { attributes: &[(R32G32B32_SFLOAT, 0), (R32G32B32_SFLOAT, 12)] }

            /// Six signed 32-bit integers: 24 bytes per vertex, fixed point, exact sums
            ///
            /// Value = offset + integer × unit ([`PoseGrid`](crate::packed::PoseGrid)). Two vertex attributes of three
            /// integers, at 0 and 12. Needs deltas in blocks.
            Fixed32 fixed32 { bits: 32, attributes: &[(R32G32B32_SINT, 0), (R32G32B32_SINT, 12)] }

            /// Six signed 16-bit integers: 12 bytes per vertex, fixed point, each target rounded
            ///
            /// Value = offset + integer × unit ([`PoseGrid`](crate::packed::PoseGrid)). Each target's contribution is
            /// rounded to the unit as a function of its weight alone, so sums are exact and independent of earlier
            /// poses. A vertex attribute of four integers at 0 (position, first component of the normal) and one of two
            /// at 8, in formats that every device has. Needs deltas in blocks.
            Fixed16 fixed16 { stride: 12, bits: 16, attributes: &[(R16G16B16A16_SINT, 0), (R16G16_SINT, 8)] }

            /// Like fixed16, but the sum is rounded once: for rigs with many overlapping targets
            ///
            /// The sum of all targets is rounded to the unit, not each contribution: off by half a unit, however many
            /// targets are active. So a block that a changed target touches is evaluated in full, from the base pose,
            /// in any [`UpdateMode`](crate::UpdateMode). Stored, drawn and decoded as `Fixed16`
            /// (`POSE_FIXED16` in shaders). Needs deltas in blocks.
            Rebuilt16 rebuilt16 {
                stride: 12, bits: 16, attributes: &[(R16G16B16A16_SINT, 0), (R16G16_SINT, 8)],
                modules: "fixed16", rounds_sums: true
            }
        }
    };
}
pub(crate) use pose_formats;

// `VkFormat` values.
const R16G16_SINT: u32 = 82;
const R16G16B16A16_SINT: u32 = 96;
const R32G32B32_UINT: u32 = 104;
const R32G32B32_SINT: u32 = 105;
const R32G32B32_SFLOAT: u32 = 106;

/// A pose format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoseRow {
    /// Base name of its files. Names of SPIR-V modules contain it, except for the first format.
    pub file: &'static str,
    /// One-line description.
    pub summary: &'static str,
    /// Bytes per vertex.
    pub stride: u32,
    /// Bits per integer component; 0: float32.
    pub bits: u32,
    /// Vertex attributes of a draw, from location 0 on: `VkFormat` and offset.
    pub attributes: &'static [(u32, u32)],
    /// The format whose GLSL and SPIR-V modules it uses, by `file`: itself, or an earlier one with the same numbers.
    pub modules: &'static str,
    /// Sums are rounded to the unit, and not each target's contribution; blocks always start from the base pose.
    pub rounds_sums: bool,
}

impl PoseRow {
    const fn float32(file: &'static str, summary: &'static str) -> Self {
        Self {
            file,
            summary: summary.trim_ascii(),
            stride: 24,
            bits: 0,
            attributes: &[],
            modules: file,
            rounds_sums: false,
        }
    }
}

macro_rules! pose_rows {
    (() $(
        #[doc = $summary:literal] $(#[doc = $more:literal])* $(#[default])?
        $name:ident $file:ident { $($fields:tt)* }
    )*) => {
        /// Every pose format, in the order of `PoseFormat::ALL`.
        pub const POSE_FORMATS: &[PoseRow] =
            &[$(PoseRow { $($fields)*, ..PoseRow::float32(stringify!($file), $summary) }),*];
    };
}
pose_formats!(pose_rows());

/// A delta format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FormatRow {
    /// Name on the command line and in reports.
    pub name: &'static str,
    /// One-line description.
    pub summary: &'static str,
    /// Base name of its files; part of the names of SPIR-V modules.
    pub file: &'static str,
    /// Id in packed files; 0 for dense formats, which packed files cannot hold.
    pub id: u32,
    /// A block format: integers with power-of-two steps for the mesh, so that sums can be exact; otherwise dense.
    pub blocks: bool,
    /// 32-bit words per delta (dense formats).
    pub words: u32,
    /// Vertex attributes per target in a vertex pass (dense formats): `VkFormat` and offset.
    pub attributes: &'static [(u32, u32)],
    /// Vertex passes take a signed byte per target: log2 of the ratio of its two steps.
    pub exponents: bool,
}

impl FormatRow {
    const fn dense(file: &'static str, summary: &'static str) -> Self {
        Self {
            name: file,
            summary: summary.trim_ascii(),
            file,
            id: 0,
            blocks: false,
            words: 0,
            attributes: &[],
            exponents: false,
        }
    }

    const fn blocks(file: &'static str, summary: &'static str) -> Self {
        Self { blocks: true, ..Self::dense(file, summary) }
    }
}

macro_rules! rows {
    (() $($layout:ident {
        $(#[doc = $summary:literal] $(#[doc = $more:literal])* $name:ident $file:ident { $($fields:tt)* })*
    })*) => {
        /// Every format, in the order of `DeltaFormat::ALL`.
        pub const FORMATS: &[FormatRow] =
            &[$($(FormatRow { $($fields)*, ..FormatRow::$layout(stringify!($file), $summary) }),*),*];
    };
}
delta_formats!(rows());
