//! The delta formats and the pose formats: the two lists that build.rs, the library, the command line and the tests
//! share.
//!
//! A new delta format is an item of `delta_formats!` and its two files, src/pack/formats/FILE.rs and
//! glsl/formats/FILE.glsl; a new pose format an item of `pose_formats!`, src/pack/poses/FILE.rs and
//! glsl/poses/FILE.glsl. Plain data without dependencies, since build.rs includes this file.

/// Expand a macro with arguments and the list: dense formats, then those in blocks.
///
/// An item is the documentation of a `DeltaFormat`, whose first line the command line shows; its name; its files' name;
/// and the fields of its [`FormatRow`] that are not what [`dense`](FormatRow::dense) or [`blocks`](FormatRow::blocks)
/// state. Items are appended: reports and tables are in this order.
macro_rules! delta_formats {
    ($expanded:ident $arguments:tt) => {
        $expanded! { $arguments
            dense {
                /// Dense, six float32: 24 bytes per vertex and target.
                ///
                /// Exact. Two vertex attributes a target.
                Float32 float32 { words: 6, attributes: &[(R32G32B32_SFLOAT, 0), (R32G32B32_SFLOAT, 12)] }

                /// Dense, six signed 16-bit integers: 12 bytes per vertex and target.
                ///
                /// In three words, one vertex attribute a target. Value = integer × step, a step for each triple per
                /// target: the smallest power of two that lets its largest component fit.
                Snorm16 snorm16 {
                    words: 3, attributes: &[(R32G32B32_UINT, 0)], exponents: true, integers: true
                }
            }
            blocks {
                /// In blocks, six float32: 24 bytes per vertex and entry.
                ///
                /// Exact, but not for poses of integers.
                BlockFloat32 block_float32 { id: 1, name: "block-float32" }

                /// In blocks, 9 bytes per vertex and entry.
                ///
                /// 15 bits a component in the first triple and 9 in the second, in planes that a kernel reads as three
                /// words.
                Fast fast { id: 2, integers: true, texels: true }

                /// In blocks, as few bits as the error allows, for the vertices that move only: the fewest bytes.
                ///
                /// Bit widths per entry and component.
                Small small { id: 3, since: 4, integers: true }

                /// In blocks, 8 bytes per vertex and entry.
                ///
                /// 13 bits a component in the first triple and 8 in the second, in two words side by side that a
                /// kernel loads at once. Coarser than [`Fast`](Self::Fast) where a target moves far: the step of such
                /// an entry is larger than the errors allowed make it. With the default errors (1e-5 of the diagonal,
                /// 0.5°) a face of 57 targets (ICT-FaceKit) came out at 1.7e-5 and 0.72° (`fast`: 1.0e-5 and 0.50°),
                /// one of 52 (facecap) at 3.6e-5 and 0.77° (`fast`: 1.0e-5 and 0.63°), in 89% of the bytes of `fast`.
                /// [`BlockIndex::error`](crate::pack::blocks::BlockIndex::error) has what was measured for a mesh.
                Pair pair { id: 4, integers: true }
            }
        }
    };
}
pub(crate) use delta_formats;

/// Expand a macro with arguments and the list of pose formats.
///
/// An item is the documentation of a `PoseFormat`, whose first line the command line shows; its name; its files' name,
/// which is its name on the command line; and the fields of its [`PoseRow`] that are not float32's.
macro_rules! pose_formats {
    ($expanded:ident $arguments:tt) => {
        $expanded! { $arguments
            /// Six float32: 24 bytes per vertex, the pose itself.
            ///
            /// Two vertex attributes of three floats, at 0 and 12. Accumulation rounds.
            #[default]
            Float32 float32 { attributes: &[(R32G32B32_SFLOAT, 0), (R32G32B32_SFLOAT, 12)] }

            /// Six signed 32-bit integers: 24 bytes per vertex, the exact displacement from the base pose in steps.
            ///
            /// Two vertex attributes of three integers, at 0 and 12. For deltas that are integers; those of `snorm16`,
            /// whose targets have steps of their own, are rounded to the finest step that fits, as in 16 bits.
            Fixed32 fixed32 { bits: 32, attributes: &[(R32G32B32_SINT, 0), (R32G32B32_SINT, 12)] }

            /// Six signed 16-bit integers: 12 bytes per vertex, the displacement from the base pose in steps.
            ///
            /// What each target adds is rounded to the step, as a function of its weight alone: sums are exact, and
            /// do not depend on the history. A vertex attribute of four integers at 0 (position, first number of the
            /// normal) and one of two at 8. For deltas that are integers.
            Fixed16 fixed16 { stride: 12, bits: 16, attributes: &[(R16G16B16A16_SINT, 0), (R16G16_SINT, 8)] }
        }
    };
}
pub(crate) use pose_formats;

// Numbers of `VkFormat`.
const R16G16_SINT: u32 = 82;
const R16G16B16A16_SINT: u32 = 96;
const R32G32B32_UINT: u32 = 104;
const R32G32B32_SINT: u32 = 105;
const R32G32B32_SFLOAT: u32 = 106;

/// A pose format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoseRow {
    /// Name of its files, without the ending; the first format's is no part of the names of SPIR-V modules.
    pub file: &'static str,
    /// What it is, in a line.
    pub summary: &'static str,
    /// Bytes of a vertex.
    pub stride: u32,
    /// Bits of a number that is an integer: sums of integers, for deltas that are integers. 0: numbers are float32.
    pub bits: u32,
    /// Vertex attributes, from location 0 on, that a draw reads the six numbers from: `VkFormat` and offset.
    pub attributes: &'static [(u32, u32)],
}

impl PoseRow {
    const fn float32(file: &'static str, summary: &'static str) -> Self {
        Self { file, summary: summary.trim_ascii(), stride: 24, bits: 0, attributes: &[] }
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
    /// What it is, in a line.
    pub summary: &'static str,
    /// Name of its files, without the ending; part of the names of SPIR-V modules.
    pub file: &'static str,
    /// Number in packed files; 0: it has no file.
    pub id: u32,
    /// The first version of packed files whose deltas in this format are as they are now.
    pub since: u32,
    /// Deltas lie in blocks; otherwise they are dense.
    pub blocks: bool,
    /// Deltas are integers in steps that are powers of two, of the mesh (in blocks) or of a target, so that sums can be
    /// exact.
    pub integers: bool,
    /// 32-bit words of a delta (dense formats).
    pub words: u32,
    /// Vertex attributes of one target in a vertex pass (dense formats): `VkFormat` and offset.
    pub attributes: &'static [(u32, u32)],
    /// A vertex pass is given a signed byte for each target: the power of two between its two steps.
    pub exponents: bool,
    /// The GLSL file has entries loaded as texels, too (formats in blocks; `TEXELS` in blocks.glsl).
    pub texels: bool,
}

impl FormatRow {
    const fn dense(file: &'static str, summary: &'static str) -> Self {
        Self {
            name: file,
            summary: summary.trim_ascii(),
            file,
            id: 0,
            since: 0,
            blocks: false,
            integers: false,
            words: 0,
            attributes: &[],
            exponents: false,
            texels: false,
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
