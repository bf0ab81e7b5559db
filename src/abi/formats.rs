//! The delta formats: the one list that build.rs, the library, the command line and the tests share.
//!
//! Plain data without dependencies, since build.rs includes this file.

/// A delta format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FormatRow {
    /// Name on the command line and in reports.
    pub name: &'static str,
    /// Number in packed files; 0: it has no file.
    pub id: u32,
    /// Deltas lie in blocks; otherwise they are dense.
    pub blocks: bool,
    /// Deltas are integers on a grid of one step per triple, so that sums can be exact.
    pub integers: bool,
    /// Part of the names of SPIR-V modules.
    pub module: &'static str,
    /// The GLSL file of the format, under glsl/formats/.
    pub glsl: &'static str,
    /// Vertex attributes of one target in a vertex pass (dense formats).
    pub attributes: u32,
}

/// Every format, in the order of `DeltaFormat::ALL`.
pub const FORMATS: [FormatRow; 5] = [
    FormatRow {
        name: "float32",
        id: 0,
        blocks: false,
        integers: false,
        module: "float32",
        glsl: "float32.glsl",
        attributes: 2,
    },
    FormatRow {
        name: "snorm16",
        id: 0,
        blocks: false,
        integers: false,
        module: "snorm16",
        glsl: "snorm16.glsl",
        attributes: 1,
    },
    FormatRow {
        name: "block-float32",
        id: 1,
        blocks: true,
        integers: false,
        module: "float32",
        glsl: "block_float32.glsl",
        attributes: 0,
    },
    FormatRow { name: "fast", id: 2, blocks: true, integers: true, module: "fast", glsl: "fast.glsl", attributes: 0 },
    FormatRow {
        name: "small",
        id: 3,
        blocks: true,
        integers: true,
        module: "small",
        glsl: "small.glsl",
        attributes: 0,
    },
];
