//! The table of kernels, shared by build.rs, the library and the tests.
//!
//! A row is a GLSL source with its defines. build.rs compiles one module per row and supported format (and per number
//! of targets, if they are vertex attributes) and generates a `static` per row, which [`modules`](super::modules)
//! includes. The row describes what a pipeline needs (descriptors, push constants, specialization constants);
//! the validation layers compare it with the modules' declarations.
//!
//! build.rs includes this file, so it is plain data that depends only on [`formats`](super::formats).

use super::formats::{FormatRow, PoseRow};

/// Most vertex attributes of a module; two of them are the pose.
pub const ATTRIBUTES_MAX: u32 = 32;

/// Shader stage of a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A vertex shader.
    Vertex,
    /// A fragment shader, with the vertex shader that goes before it in the table.
    Fragment,
    /// A compute shader with [`WORKGROUP`](super::numbers::WORKGROUP) invocations per workgroup.
    Compute,
    /// A compute shader whose workgroup size is specialization constant 0.
    ComputeSized,
}

/// Delta formats that a kernel has modules for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Takes {
    /// One module; the kernel reads no deltas.
    NoDeltas,
    /// One module per dense format.
    Dense,
    /// One module per dense format and number of targets, from 0 (a copy) up to the limit of [`ATTRIBUTES_MAX`].
    DenseBatches,
    /// One module per block format.
    Blocks,
}

impl Takes {
    /// Whether there are modules for a delta format.
    pub fn takes(self, format: &FormatRow) -> bool {
        match self {
            Self::NoDeltas => false,
            Self::Dense | Self::DenseBatches => !format.blocks,
            Self::Blocks => format.blocks,
        }
    }
}

/// Most targets of a format that fit in vertex attributes beside a pose.
pub const fn batch_max(format: &FormatRow) -> u32 {
    match format.attributes.len() as u32 {
        0 => 0,
        attributes => (ATTRIBUTES_MAX - 2) / attributes,
    }
}

/// Type of a descriptor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Buffer {
    /// A storage buffer.
    Storage,
    /// A storage buffer with a dynamic offset.
    Dynamic,
    /// A read-only texel buffer of this `VkFormat`.
    UniformTexels(i32),
    /// A read-write texel buffer of this `VkFormat`.
    StorageTexels(i32),
    /// A sampled image, fetched without a sampler. Its binding follows those of buffers.
    Image,
}

/// A descriptor of set 0: binding and buffer.
pub type Binding = (u32, Buffer);

/// A kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KernelRow {
    /// Base name of its [`source`](Self::source). A module's name is this, the format's `file` and the suffix, joined
    /// by underscores.
    pub name: &'static str,
    /// Suffix of module names.
    pub suffix: &'static str,
    /// Shader stage.
    pub stage: Stage,
    /// Preprocessor defines; [`Takes::DenseBatches`] adds `BATCH`.
    pub defines: &'static [&'static str],
    /// Supported delta formats.
    pub takes: Takes,
    /// There are modules for each pose format that the deltas support; otherwise for the first one, or the kernel
    /// accesses no poses.
    pub poses: bool,
    /// Descriptors of set 0.
    pub bindings: &'static [Binding],
    /// Bindings that may alias another one: decorated Aliased.
    pub aliased: &'static [u32],
    /// Bytes of its push constants; with [`Takes::DenseBatches`] they follow from the targets.
    pub push_bytes: u32,
    /// Number of its own specialization constants, from 0 on.
    pub constants: u32,
    /// Part of a baseline (package deltamorph-baselines), left out without the feature `baselines`. In this table,
    /// since baselines share its types, the formats' GLSL and the build script.
    pub baseline: bool,
}

impl KernelRow {
    /// Whether there are modules for this delta format (`None`: reads no deltas) and pose format.
    pub fn takes(&self, format: Option<&FormatRow>, pose: &PoseRow) -> bool {
        let poses = pose.bits == 0 || self.poses && format.is_none_or(|format| format.blocks);
        poses && format.map_or(self.takes == Takes::NoDeltas, |format| self.takes.takes(format))
    }

    /// Its file under glsl/.
    pub fn source(&self) -> String {
        let folder = if self.baseline { "baselines/" } else { "" };
        let ending = match self.stage {
            Stage::Vertex => "vert",
            Stage::Fragment => "frag",
            Stage::Compute | Stage::ComputeSized => "comp",
        };
        format!("{folder}{}.{ending}", self.name)
    }
}

const VERTEX: KernelRow = KernelRow {
    name: "",
    suffix: "",
    stage: Stage::Vertex,
    defines: &[],
    takes: Takes::NoDeltas,
    poses: false,
    bindings: &[],
    aliased: &[],
    push_bytes: 0,
    constants: 0,
    baseline: false,
};
const COMPUTE: KernelRow = KernelRow { stage: Stage::Compute, ..VERTEX };
/// A post-morph pass that writes poses: those of an instance, pieces, destination, the order of its vertices.
/// Specialization constants: those of `glsl/after.glsl`.
const OUTPUT: KernelRow = KernelRow {
    name: "output",
    poses: true,
    bindings: &[(0, Buffer::Storage), (1, WORD_LIST), (2, Buffer::Storage), (3, WORD_LIST)],
    push_bytes: 84,
    constants: 5,
    ..COMPUTE
};
/// The same, skinned: then influences, joints. A further constant: influences per vertex.
const SKINNED: KernelRow = KernelRow {
    bindings: &[
        (0, Buffer::Storage),
        (1, WORD_LIST),
        (2, Buffer::Storage),
        (3, WORD_LIST),
        (4, Buffer::Storage),
        (5, Buffer::Storage),
    ],
    constants: 6,
    ..OUTPUT
};
/// Tables, state, work list, control: see animation.glsl.
const ANIMATION: KernelRow = KernelRow {
    bindings: &[(0, Buffer::Storage), (1, Buffer::Storage), (2, Buffer::Storage), (3, Buffer::Storage)],
    push_bytes: 116,
    ..COMPUTE
};
/// Source, destination, deltas. The set's fourth buffer is for `dense_list`.
const DENSE: KernelRow = KernelRow {
    name: "dense",
    takes: Takes::Dense,
    bindings: &[(0, Buffer::Storage), (1, Buffer::Storage), (2, Buffer::Dynamic)],
    aliased: &[0, 1],
    push_bytes: 116,
    constants: 1,
    ..COMPUTE
};
/// Asset, work list, poses, base pose. Specialization constants: lanes, vertices per block, instances per tile, two
/// bits (bit 0: all start from the base pose; bit 1: sums are rounded), whether decoding should use few registers.
const CROWD: KernelRow = KernelRow {
    name: "crowd",
    stage: Stage::ComputeSized,
    takes: Takes::Blocks,
    poses: true,
    bindings: &[(0, Buffer::Storage), (1, Buffer::Storage), (2, Buffer::Storage), (3, Buffer::Storage)],
    push_bytes: 32,
    constants: 5,
    ..COMPUTE
};
/// A draw of baseline `direct`: deltas, weights.
const DIRECT: KernelRow = KernelRow {
    name: "direct",
    takes: Takes::Dense,
    bindings: &[(0, Buffer::Dynamic), (1, Buffer::Dynamic)],
    push_bytes: 16,
    baseline: true,
    ..VERTEX
};
/// A draw of baseline `texture`: texels of vertices, displacement textures.
const TEXTURED: KernelRow = KernelRow {
    name: "textured",
    bindings: &[(0, Buffer::Storage), (2, Buffer::Image)],
    push_bytes: 8,
    baseline: true,
    ..VERTEX
};
const ATTRIBUTES: KernelRow = KernelRow { takes: Takes::DenseBatches, ..VERTEX };

/// R32G32B32A32_UINT.
const WORD_TEXELS: Buffer = Buffer::UniformTexels(107);
/// R32_UINT.
const WORD_LIST: Buffer = Buffer::UniformTexels(98);
const POSE_TEXELS: Buffer = Buffer::StorageTexels(107);

/// Every kernel.
pub const KERNELS: &[KernelRow] = &[
    // Measurements.
    KernelRow { name: "consume", poses: true, ..VERTEX },
    KernelRow { name: "consume_position", poses: true, ..VERTEX },
    KernelRow { name: "read", bindings: &[(0, Buffer::Storage), (1, Buffer::Storage)], push_bytes: 8, ..COMPUTE },
    // Animation on the GPU: sampling clips and planning updates. Specialization constants: the invocations that
    // sample 32 targets; the widest tile.
    KernelRow { name: "animate", constants: 1, ..ANIMATION },
    KernelRow { name: "plan", constants: 1, ..ANIMATION },
    KernelRow { name: "plan_together", constants: 1, ..ANIMATION },
    KernelRow { name: "arguments", constants: 1, ..ANIMATION },
    // Passes over dense deltas.
    DENSE,
    KernelRow {
        name: "dense_list",
        bindings: &[(0, Buffer::Storage), (1, Buffer::Storage), (2, Buffer::Dynamic), (3, Buffer::Dynamic)],
        push_bytes: 12,
        constants: 0,
        ..DENSE
    },
    KernelRow { name: "feedback", ..ATTRIBUTES },
    // Blocks of several instances at once.
    CROWD,
    // The same for software drivers. Poses are bound twice: as pairs of words for stores, as texels for loads.
    KernelRow {
        name: "crowd_texels",
        bindings: &[(0, WORD_TEXELS), (1, WORD_TEXELS), (2, Buffer::Storage), (3, POSE_TEXELS), (4, WORD_TEXELS)],
        aliased: &[2, 3],
        constants: 4,
        ..CROWD
    },
    // Post-morph passes.
    OUTPUT,
    KernelRow { suffix: "skin", defines: &["SKIN"], ..SKINNED },
    KernelRow { suffix: "dual", defines: &["SKIN", "DUAL"], ..SKINNED },
    // Base pose and fans are its last buffer.
    KernelRow {
        name: "normals",
        bindings: &[(0, Buffer::Storage), (1, WORD_LIST), (2, Buffer::Storage), (3, WORD_LIST), (4, Buffer::Storage)],
        ..OUTPUT
    },
    // Baselines. The set of `scatter` and `resolve`: records, sums, base pose, destination.
    KernelRow {
        name: "scatter",
        bindings: &[(0, Buffer::Storage), (1, Buffer::Storage)],
        push_bytes: 12,
        baseline: true,
        ..COMPUTE
    },
    KernelRow {
        name: "resolve",
        bindings: &[(1, Buffer::Storage), (2, Buffer::Storage), (3, Buffer::Storage)],
        push_bytes: 12,
        baseline: true,
        ..COMPUTE
    },
    KernelRow { name: "vertex_store", bindings: &[(0, Buffer::Storage)], baseline: true, ..ATTRIBUTES },
    KernelRow { name: "direct_attributes", baseline: true, ..ATTRIBUTES },
    DIRECT,
    // The same draw with its result captured, in the two ways that devices support.
    KernelRow { suffix: "feedback", defines: &["FEEDBACK"], ..DIRECT },
    KernelRow {
        suffix: "store",
        defines: &["STORE"],
        bindings: &[(0, Buffer::Dynamic), (1, Buffer::Dynamic), (2, Buffer::Storage)],
        ..DIRECT
    },
    // Rectangles of texels that a target moves, and its deltas to blend there.
    KernelRow { name: "rectangles", bindings: &[(0, Buffer::Storage)], push_bytes: 20, baseline: true, ..VERTEX },
    KernelRow {
        name: "texels",
        stage: Stage::Fragment,
        takes: Takes::Dense,
        bindings: &[(1, Buffer::Image), (2, Buffer::Image)],
        push_bytes: 20,
        baseline: true,
        ..VERTEX
    },
    TEXTURED,
    KernelRow { suffix: "feedback", defines: &["FEEDBACK"], ..TEXTURED },
    KernelRow {
        suffix: "store",
        defines: &["STORE"],
        bindings: &[(0, Buffer::Storage), (1, Buffer::Storage), (2, Buffer::Image)],
        ..TEXTURED
    },
];
