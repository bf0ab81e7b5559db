//! The kernels: one table that build.rs, the library and the tests share.
//!
//! A row is a GLSL source with its defines. build.rs compiles a module of each row for each format that it takes (and
//! for each number of targets, where they are vertex attributes), and writes a `static` for each row that
//! [`modules`](super::modules) holds. What the library needs to make a pipeline of a module (descriptors, push
//! constants, specialization constants) is in its row, and `tests/project/spirv.rs` compares rows with what modules
//! declare.
//!
//! Plain data without dependencies but [`formats`](super::formats) and [`steps`](super::steps), since build.rs includes
//! this file.

use super::formats::{FormatRow, PoseRow};
use super::steps::after_steps;

/// Vertex attributes that modules are made for at most; two are the pose.
pub const ATTRIBUTES_MAX: u32 = 32;

/// Specialization constants that say where the numbers of a vertex are in a pose: the last ones of kernels that take
/// vertices of hosts (`glsl/places.glsl`). Their defaults are poses of ours.
pub const PLACES: usize = 8;

/// Where a kernel runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A vertex shader.
    Vertex,
    /// A fragment shader, with the vertex shader that goes before it in the table.
    Fragment,
    /// A compute shader with workgroups of [`WORKGROUP`](super::numbers::WORKGROUP) invocations.
    Compute,
    /// A compute shader with workgroups of as many as specialization constant 0 says.
    ComputeSized,
}

/// Which formats there are modules for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Takes {
    /// One module, which reads no deltas.
    NoDeltas,
    /// A module for each dense format.
    Dense,
    /// A module for each number of targets of each dense format, from 0 (a copy) to what [`ATTRIBUTES_MAX`] has room
    /// for.
    DenseBatches,
    /// A module for each format in blocks.
    Blocks,
    /// A module for each format whose entries are loaded as texels, too.
    Texels,
}

impl Takes {
    /// Whether there are modules for deltas in a format.
    pub fn takes(self, format: &FormatRow) -> bool {
        match self {
            Self::NoDeltas => false,
            Self::Dense | Self::DenseBatches => !format.blocks,
            Self::Blocks => format.blocks,
            Self::Texels => format.texels,
        }
    }
}

/// How many targets of a format fit into vertex attributes, next to a pose.
pub const fn batch_max(format: &FormatRow) -> u32 {
    match format.attributes.len() as u32 {
        0 => 0,
        attributes => (ATTRIBUTES_MAX - 2) / attributes,
    }
}

/// What is bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Buffer {
    /// A storage buffer: an array of elements of this many bytes.
    Storage(u32),
    /// A storage buffer whose offset is given when the set is bound.
    Dynamic(u32),
    /// A storage buffer of poses, in elements that suit the pose format.
    Poses,
    /// The deltas of a dense format, at an offset that is given when the set is bound.
    DynamicDeltas,
    /// A texel buffer that is loaded: texels of this `VkFormat`.
    UniformTexels(i32),
    /// A texel buffer that is loaded and may be stored to.
    StorageTexels(i32),
    /// A sampled image that is loaded without a sampler. Its binding comes after those of buffers.
    Image,
}

/// A descriptor of set 0: binding and buffer.
pub type Binding = (u32, Buffer);

/// A kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KernelRow {
    /// Name of its [`source`](Self::source). Names of modules are this, the format's `file`, and the suffix, with
    /// underscores between.
    pub name: &'static str,
    /// End of the names.
    pub suffix: &'static str,
    /// Where it runs.
    pub stage: Stage,
    /// What is defined; with [`Takes::DenseBatches`] `BATCH`, too.
    pub defines: &'static [&'static str],
    /// The delta formats.
    pub takes: Takes,
    /// There are modules for each pose format that goes with the deltas, too; otherwise for the first, or the kernel
    /// reads and writes no poses.
    pub poses: bool,
    /// Set 0.
    pub bindings: &'static [Binding],
    /// Bindings that may be the same memory as another one: decorated Aliased.
    pub aliased: &'static [u32],
    /// The structure of its push constants, in [`push`](super::push); "": it has none, or with [`Takes::DenseBatches`]
    /// as many coefficients as there are targets.
    pub push: &'static str,
    /// Specialization constants of its own: 0 to one less than this.
    pub constants: u32,
    /// Behind them are [`PLACES`] that say where numbers are in a pose.
    pub places: bool,
    /// Of a technique of others, in the package deltamorph-baselines: left out without the feature `baselines`. They
    /// stand in this table since they share its types, the formats' GLSL, and the build script; a second table and
    /// build script would be more code than they are.
    pub baseline: bool,
}

impl KernelRow {
    /// Whether there are modules for deltas and poses in a pair of formats; `None`: for a kernel that reads no deltas.
    pub fn takes(&self, format: Option<&FormatRow>, pose: &PoseRow) -> bool {
        let poses = pose.bits == 0 || self.poses && format.is_none_or(|format| format.integers);
        poses && format.map_or(self.takes == Takes::NoDeltas, |format| self.takes.takes(format))
    }

    /// All specialization constants.
    pub const fn all_constants(&self) -> u32 {
        self.constants + if self.places { PLACES as u32 } else { 0 }
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
    push: "",
    constants: 0,
    places: false,
    baseline: false,
};
const COMPUTE: KernelRow = KernelRow { stage: Stage::Compute, ..VERTEX };
/// Tables, state, work list, control: see animation.glsl.
const ANIMATION: KernelRow =
    KernelRow { bindings: &[(0, WORDS), (1, WORDS), (2, WORDS), (3, WORDS)], push: "AnimationPush", ..COMPUTE };
/// Source, destination, deltas. The set has a fourth buffer, which is `dense_list`'s.
const DENSE: KernelRow = KernelRow {
    name: "dense",
    takes: Takes::Dense,
    bindings: &[(0, Buffer::Poses), (1, Buffer::Poses), (2, Buffer::DynamicDeltas)],
    aliased: &[0, 1],
    push: "DensePush",
    constants: 1,
    ..COMPUTE
};
/// Asset, work list, poses. Specialization constants: lanes, vertices of a block.
const BLOCKS: KernelRow = KernelRow {
    name: "blocks",
    stage: Stage::ComputeSized,
    takes: Takes::Blocks,
    bindings: &[(0, WORDS), (1, WORDS), (2, WORDS)],
    push: "BlocksPush",
    constants: 2,
    places: true,
    ..COMPUTE
};
/// Three more specialization constants: instances of a tile, whether all start from the base pose, and
/// whether decoding is to take few registers.
const CROWD: KernelRow = KernelRow { name: "crowd", poses: true, constants: 5, ..BLOCKS };
/// A draw that others' technique `direct` evaluates: deltas, weights.
const DIRECT: KernelRow = KernelRow {
    name: "direct",
    takes: Takes::Dense,
    bindings: &[(0, Buffer::DynamicDeltas), (1, Buffer::Dynamic(8))],
    push: "DirectPush",
    baseline: true,
    ..VERTEX
};
/// A draw of others' technique `texture`: texels of vertices, displacement textures.
const TEXTURED: KernelRow = KernelRow {
    name: "textured",
    bindings: &[(0, WORDS), (2, Buffer::Image)],
    push: "TexturedPush",
    baseline: true,
    ..VERTEX
};
const ATTRIBUTES: KernelRow = KernelRow { takes: Takes::DenseBatches, ..VERTEX };

const WORDS: Buffer = Buffer::Storage(4);
const PAIRS: Buffer = Buffer::Storage(8);
/// R32G32B32A32_UINT.
const WORD_TEXELS: Buffer = Buffer::UniformTexels(107);
/// R32_UINT.
const WORD_LIST: Buffer = Buffer::UniformTexels(98);
const POSE_TEXELS: Buffer = Buffer::StorageTexels(107);

/// Every kernel.
pub const KERNELS: &[KernelRow] = &joined::<{ OURS.len() + STEPS.len() + OTHERS.len() }>([OURS, STEPS, OTHERS]);

const fn joined<const N: usize>(parts: [&[KernelRow]; 3]) -> [KernelRow; N] {
    let (mut all, mut at, mut part) = ([COMPUTE; N], 0, 0);
    while part < parts.len() {
        let mut row = 0;
        while row < parts[part].len() {
            all[at] = parts[part][row];
            (at, row) = (at + 1, row + 1);
        }
        part += 1;
    }
    all
}

/// Those of measurements and of our techniques.
const OURS: &[KernelRow] = &[
    // What measurements need.
    KernelRow { name: "consume", poses: true, push: "ConsumePush", ..VERTEX },
    KernelRow { name: "read", bindings: &[(0, Buffer::Storage(16)), (1, WORDS)], push: "ReadPush", ..COMPUTE },
    // Sampling clips and planning updates; a specialization constant of `budget` says whether levels of detail follow
    // the camera, one of `plan` and `arguments` is the widest tile.
    KernelRow { name: "animate", ..ANIMATION },
    KernelRow { name: "budget", constants: 1, ..ANIMATION },
    KernelRow { name: "commit", ..ANIMATION },
    KernelRow { name: "plan", constants: 1, ..ANIMATION },
    KernelRow { name: "arguments", constants: 1, ..ANIMATION },
    // Levels of detail, before sampling: tables, state.
    KernelRow { name: "level", bindings: &[(0, WORDS), (1, WORDS)], push: "LevelPush", ..COMPUTE },
    // Passes over dense deltas.
    DENSE,
    KernelRow {
        name: "dense_list",
        bindings: &[(0, Buffer::Poses), (1, Buffer::Poses), (2, Buffer::DynamicDeltas), (3, Buffer::Dynamic(16))],
        push: "DenseListPush",
        poses: true,
        constants: 0,
        ..DENSE
    },
    KernelRow { name: "feedback", ..ATTRIBUTES },
    // Blocks of one instance, with masks of what changes.
    BLOCKS,
    // Whole blocks, of several instances at once.
    CROWD,
    // The same for software drivers. Poses are bound as pairs of words to be stored, and as texels to be loaded.
    KernelRow {
        name: "crowd_texels",
        takes: Takes::Texels,
        bindings: &[(0, WORD_TEXELS), (1, WORD_TEXELS), (2, PAIRS), (3, POSE_TEXELS)],
        aliased: &[2, 3],
        constants: 4,
        places: false,
        ..CROWD
    },
];

macro_rules! step_kernels {
    (() $(
        $(#[doc = $doc:literal])*
        $kind:ident $module:ident::$step:ident $public:tt $set:tt {
            $($reads:tt => $written:ident, $push:ident $members:tt [$({ $($fields:tt)* }),*];)*
        }
    )*) => {
        /// Those of the steps after the pose.
        const STEPS: &[KernelRow] =
            &[$($($(KernelRow { push: stringify!($push), $($fields)*, ..COMPUTE },)*)*)*];
    };
}
after_steps!(step_kernels());

/// Those of the techniques of others.
const OTHERS: &[KernelRow] = &[
    // The set of `scatter` and `resolve` is records, sums, base pose, destination.
    KernelRow {
        name: "scatter",
        bindings: &[(0, Buffer::Storage(16)), (1, WORDS)],
        push: "ScatterPush",
        baseline: true,
        ..COMPUTE
    },
    KernelRow {
        name: "resolve",
        bindings: &[(1, WORDS), (2, PAIRS), (3, PAIRS)],
        push: "ResolvePush",
        baseline: true,
        ..COMPUTE
    },
    KernelRow { name: "vertex_store", bindings: &[(0, PAIRS)], baseline: true, ..ATTRIBUTES },
    KernelRow { name: "direct_attributes", baseline: true, ..ATTRIBUTES },
    DIRECT,
    // The same draw, its result captured in the two ways that devices have.
    KernelRow { suffix: "feedback", defines: &["FEEDBACK"], ..DIRECT },
    KernelRow {
        suffix: "store",
        defines: &["STORE"],
        bindings: &[(0, Buffer::DynamicDeltas), (1, Buffer::Dynamic(8)), (2, PAIRS)],
        ..DIRECT
    },
    // Rectangles of texels that a target moves; and its deltas, which are blended there.
    KernelRow { name: "rectangles", bindings: &[(0, WORDS)], push: "RectanglesPush", baseline: true, ..VERTEX },
    KernelRow {
        name: "texels",
        stage: Stage::Fragment,
        takes: Takes::Dense,
        bindings: &[(1, Buffer::Image), (2, Buffer::Image)],
        push: "RectanglesPush",
        baseline: true,
        ..VERTEX
    },
    TEXTURED,
    KernelRow { suffix: "feedback", defines: &["FEEDBACK"], ..TEXTURED },
    KernelRow {
        suffix: "store",
        defines: &["STORE"],
        bindings: &[(0, WORDS), (1, PAIRS), (2, Buffer::Image)],
        ..TEXTURED
    },
];
