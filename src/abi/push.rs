//! Push constants and coefficient lists, as shaders declare them.

use super::kernels::Push;
use super::numbers::DENSE_BATCH_MAX;
use crate::pack::DeltaFormat;
use bytemuck::{Pod, Zeroable};
use std::mem::offset_of;

/// Bytes of push constants that every device has: what Vulkan promises.
pub const PUSH_BYTES_MIN: u32 = 128;

/// Structures of words, and for each the names and offsets of its members, which tests compare with the shaders'.
macro_rules! shared {
    ($($(#[$doc:meta])* pub struct $name:ident { $($(#[$field_doc:meta])* pub $field:ident: $type:ty,)* })*) => {
        $(
            $(#[$doc])*
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
            pub struct $name { $($(#[$field_doc])* pub $field: $type,)* }

            impl $name {
                /// Names and offsets of the members.
                pub const MEMBERS: &[(&str, usize)] = &[$((stringify!($field), offset_of!($name, $field))),*];
            }
        )*
    };
}

shared! {
    /// Push constants of `dense.comp`.
    pub struct DensePush {
        /// Vertices of the chunk: the length of a target's row.
        pub chunk_vertices: u32,
        /// Coefficients of positions, in quantised units.
        pub coefficients: [f32; DENSE_BATCH_MAX as usize],
        /// Targets: two 16-bit indices to a word.
        pub targets: [u32; DENSE_BATCH_MAX as usize / 2],
        /// Powers of two from position steps to normal steps: four signed bytes to a word.
        pub normal_exponents: [u32; DENSE_BATCH_MAX as usize / 4],
    }

    /// Push constants of `dense_list.comp`.
    pub struct DenseListPush {
        /// Vertices of the chunk: the length of a target's row.
        pub chunk_vertices: u32,
        /// Entries of the list.
        pub entry_count: u32,
    }

    /// An entry of the coefficient list of `dense_list.comp`.
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
    pub struct BlocksPush {
        /// Index of the first item's first word in the work list.
        pub first_item: u32,
        /// Index of the first element's first word in the work list (`blocks.comp`).
        pub elements_at: u32,
        /// Index of the first delta word of the asset.
        pub deltas_at: u32,
        /// Index of the base pose's first word in the asset.
        pub base_at: u32,
        /// Numbers of a pose: six for each vertex, padding included.
        pub pose_floats: u32,
        /// Poses of an instance.
        pub slots: u32,
        /// Input units of an integer sum, or of a step for float32 sums: positions.
        pub position_unit: f32,
        /// Input units of an integer sum, or of a step for float32 sums: normals.
        pub normal_unit: f32,
    }

    /// Push constants of `read.comp`.
    pub struct ReadPush {
        /// Vectors of 16 bytes to read.
        pub count: u32,
        /// Invocations.
        pub stride: u32,
    }

    /// Push constants of the kernels of animation on the GPU; `glsl/animation.glsl` says what is where.
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
    pub struct ScatterPush {
        /// The target's first record.
        pub first: u32,
        /// Records.
        pub count: u32,
        /// The weight, on the grid of exact sums.
        pub weight: i32,
    }

    /// Push constants of `baselines/resolve.comp`.
    pub struct ResolvePush {
        /// Vertex of the first invocation.
        pub first_vertex: u32,
        /// Input units of an integer sum: positions.
        pub position_unit: f32,
        /// Input units of an integer sum: normals.
        pub normal_unit: f32,
    }

    /// Push constants of `baselines/direct.vert`.
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
}

impl Push {
    /// Names and offsets of the members, and bytes in all; nothing for [`Push::Attributes`], which
    /// [`attribute_push_bytes`] tells.
    pub const fn members(self) -> (&'static [(&'static str, usize)], usize) {
        match self {
            Self::None | Self::Attributes => (&[], 0),
            Self::Read => (ReadPush::MEMBERS, size_of::<ReadPush>()),
            Self::Animation => (AnimationPush::MEMBERS, size_of::<AnimationPush>()),
            Self::Dense => (DensePush::MEMBERS, size_of::<DensePush>()),
            Self::DenseList => (DenseListPush::MEMBERS, size_of::<DenseListPush>()),
            Self::Blocks => (BlocksPush::MEMBERS, size_of::<BlocksPush>()),
            Self::Scatter => (ScatterPush::MEMBERS, size_of::<ScatterPush>()),
            Self::Resolve => (ResolvePush::MEMBERS, size_of::<ResolvePush>()),
            Self::Direct => (DirectPush::MEMBERS, size_of::<DirectPush>()),
        }
    }
}

/// Bytes of push constants of a vertex pass over `batch` targets: a float each and, where the format has exponents, a
/// signed byte each, padded to words.
pub const fn attribute_push_bytes(format: DeltaFormat, batch: u32) -> u32 {
    4 * batch + if format.row().exponents { 4 * batch.div_ceil(4) } else { 0 }
}
