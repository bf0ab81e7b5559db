//! The SPIR-V modules, embedded by build.rs, and the layouts that host and shader share.
//!
//! `tests/spirv.rs` reflects every module and holds bindings, offsets, sizes and workgroup sizes against what
//! is stated here.

use crate::pack::DeltaFormat;
use bytemuck::{Pod, Zeroable};

/// Invocations of a workgroup of every dense compute kernel.
pub const WORKGROUP: u32 = 64;

/// Targets of a compute pass with coefficients in push constants, at most.
pub const DENSE_BATCH_MAX: u32 = 16;

/// What the modules were made from: compiler, sources, outputs.
pub const MANIFEST: &str = include_str!(concat!(env!("OUT_DIR"), "/manifest.txt"));

/// Every module: `(name, SPIR-V)`.
pub const MODULES: &[(&str, &[u8])] = &include!(concat!(env!("OUT_DIR"), "/modules.rs"));

/// Push constants of `dense.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DensePush {
    /// Vertices of the chunk: the length of a target's row.
    pub chunk_vertices: u32,
    /// Coefficients of positions, in quantised units.
    pub coefficients: [f32; DENSE_BATCH_MAX as usize],
    /// Targets: two 16-bit indices to a word.
    pub targets: [u32; DENSE_BATCH_MAX as usize / 2],
    /// [`PackedTarget::normal_exponent`](crate::pack::PackedTarget): four signed bytes to a word.
    pub normal_exponents: [u32; DENSE_BATCH_MAX as usize / 4],
}

/// Push constants of `dense_list.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DenseListPush {
    /// Vertices of the chunk: the length of a target's row.
    pub chunk_vertices: u32,
    /// Entries of the list.
    pub entry_count: u32,
}

/// An entry of the coefficient list of `dense_list.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DenseListEntry {
    /// The target.
    pub target: u32,
    /// Coefficient of positions, in quantised units.
    pub coefficient: f32,
    /// Coefficient of normals, in quantised units.
    pub normal_coefficient: f32,
    /// Padding to 16 bytes.
    pub unused: u32,
}

/// Push constants of `blocks.comp` and `crowd.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BlocksPush {
    /// Index of the first item's first word in the work list.
    pub first_item: u32,
    /// Index of the first element's first word in the work list (`blocks.comp`).
    pub elements_at: u32,
    /// Index of the first delta word of the asset.
    pub deltas_at: u32,
    /// Index of the base pose's first word in the asset.
    pub base_at: u32,
    /// Floats of a pose.
    pub pose_floats: u32,
    /// Poses of an instance.
    pub slots: u32,
    /// Input units of an integer sum, or of a step for float32 sums: positions.
    pub position_unit: f32,
    /// The same of normals.
    pub normal_unit: f32,
}

/// Name of the module of a kernel ("blocks" or "crowd") for a format and a kind of sums; there are `texels` in "crowd"
/// for `fast` alone.
pub fn blocks_module(kernel: &str, format: DeltaFormat, exact: bool, texels: bool) -> String {
    let format = match format {
        DeltaFormat::Fast => "fast",
        DeltaFormat::Small => "small",
        _ => "float32",
    };
    format!("{kernel}_{format}{}{}", if exact { "_exact" } else { "" }, if texels { "_texels" } else { "" })
}

/// Push constants of `read.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ReadPush {
    /// Vectors of 16 bytes to read.
    pub count: u32,
    /// Invocations.
    pub stride: u32,
}

/// Push constants of the kernels of animation on the GPU; `glsl/animation.glsl` says what is where.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct AnimationPush {
    /// The tick.
    pub now: u32,
    /// Heads of the crowd.
    pub heads: u32,
    /// Targets.
    pub targets: u32,
    /// Words of a bit for each target.
    pub words: u32,
    /// Blocks.
    pub blocks: u32,
    /// Entries.
    pub entries: u32,
    /// Tables: which targets touch each block.
    pub block_targets_at: u32,
    /// Tables: the first entry of each block.
    pub first_entry_at: u32,
    /// Tables: target and bytes of each entry.
    pub entries_at: u32,
    /// State: phases.
    pub phases_at: u32,
    /// State: weights.
    pub weights_at: u32,
    /// State: what the last update changed of them.
    pub deltas_at: u32,
    /// State: bits of targets, one kind after another.
    pub bits_at: u32,
    /// State: which updates touched each block.
    pub history_at: u32,
    /// Bits of the updates that a slot may have missed.
    pub history_mask: u32,
    /// Slots of a head.
    pub slots: u32,
    /// The slot of the last update.
    pub source: u32,
    /// The slot of this one.
    pub destination: u32,
    /// Not 0: touched blocks start from the base pose.
    pub always_rebuild: u32,
    /// The group's first head.
    pub first_head: u32,
    /// Heads of the group.
    pub group_heads: u32,
    /// The group's first counter.
    pub first_counter: u32,
    /// Items of a width that there is room for.
    pub capacity: u32,
    /// Work list: the first row.
    pub rows_at: u32,
    /// Counters of all groups.
    pub counters: u32,
    /// Dispatches of a width.
    pub chunks: u32,
    /// Workgroups of a dispatch, at most.
    pub chunk_items: u32,
    /// Tables: budget and reaches; 0: no change waits.
    pub budget_at: u32,
    /// State: the weights asked for, with an error budget.
    pub requested_at: u32,
}

/// Push constants of `baselines/scatter.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ScatterPush {
    /// The target's first record.
    pub first: u32,
    /// Records.
    pub count: u32,
    /// The weight, on the grid of exact sums.
    pub weight: i32,
}

/// Push constants of `baselines/resolve.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ResolvePush {
    /// Vertex of the first invocation.
    pub first_vertex: u32,
    /// Input units of an integer sum: positions.
    pub position_unit: f32,
    /// The same of normals.
    pub normal_unit: f32,
}

/// Push constants of `baselines/direct.vert`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct DirectPush {
    /// Vertices of the chunk: the length of a target's row.
    pub chunk_vertices: u32,
    /// Targets of the mesh.
    pub target_count: u32,
    /// Targets whose weight is not zero.
    pub active_targets: u32,
    /// First vertex of the chunk.
    pub first_vertex: u32,
}

/// Bytes of push constants of a feedback pass over `batch` targets: a float each and, for snorm16, a signed
/// byte each, padded to words.
pub const fn feedback_push_bytes(format: DeltaFormat, batch: u32) -> u32 {
    match format {
        DeltaFormat::Snorm16 => 4 * batch + 4 * batch.div_ceil(4),
        _ => 4 * batch,
    }
}

/// Name of the feedback module for `batch` targets; 0 copies.
pub fn feedback_module(format: DeltaFormat, batch: u32) -> String {
    format!("feedback_{}_{batch:02}", format.name())
}

/// Name of the module of `vertex-store` for `batch` targets; 0 copies.
pub fn vertex_store_module(format: DeltaFormat, batch: u32) -> String {
    format!("vertex_store_{}_{batch:02}", format.name())
}

/// Name of the module of `direct-attributes` for `batch` active targets.
pub fn direct_attributes_module(format: DeltaFormat, batch: u32) -> String {
    format!("direct_attributes_{}_{batch:02}", format.name())
}

/// The largest batch that there is a feedback module for; there are as many of `vertex-store` and `direct-attributes`.
pub fn feedback_batch_max(format: DeltaFormat) -> u32 {
    let prefix = format!("feedback_{}_", format.name());
    MODULES.iter().filter(|(name, _)| name.starts_with(&prefix)).count() as u32 - 1
}

/// The SPIR-V of module `name`, as words.
///
/// # Panics
/// When there is no such module: the table is made by our own build.
pub(crate) fn words(name: &str) -> Vec<u32> {
    let (_, bytes) = MODULES.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no module {name}"));
    bytes.chunks_exact(4).map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]])).collect()
}
