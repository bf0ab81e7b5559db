//! Push constants and coefficient lists, in the layout that shaders declare.

use super::formats::FormatRow;
use super::numbers::DENSE_BATCH_MAX;
use crate::asset::streams::{GROUP_COMPONENTS, TRIPLES};

/// Declares a structure that a shader reads, with its members in order.
#[doc(hidden)]
#[macro_export]
macro_rules! shader_structure {
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
        #[allow(missing_docs, reason = "many fields are what they are called")]
        pub struct $name { $($(#[$field_doc])* pub $field: $type,)* }
    };
}

shader_structure! {
    /// Push constants of `dense.comp`.
    DensePush {
        /// Vertices of the chunk: the length of a target's row.
        chunk_vertices: u32,
        /// Coefficients of positions, in quantised units.
        coefficients: [f32; DENSE_BATCH_MAX as usize],
        /// Target indices, two 16-bit ones per word.
        targets: [u32; DENSE_BATCH_MAX as usize / 2],
        /// log2 of normal step / position step, four signed bytes per word.
        normal_exponents: [u32; DENSE_BATCH_MAX as usize / 4],
    }
}

shader_structure! {
    /// Push constants of `dense_list.comp`.
    DenseListPush {
        /// Vertices of the chunk: the length of a target's row.
        chunk_vertices: u32,
        first_entry: u32,
        entry_count: u32,
    }
}

shader_structure! {
    /// An entry of the coefficient list of `dense_list.comp`.
    DenseListEntry {
        target: u32,
        /// Coefficient of positions, in quantised units.
        coefficient: f32,
        /// Coefficient of normals, in quantised units.
        normal_coefficient: f32,
    }
}

shader_structure! {
    /// Push constants of `crowd.comp`.
    BlocksPush {
        /// First word of the first item in the work list.
        first_item: u32,
        /// Word offset of deltas in the asset, which begins with headers.
        deltas_at: u32,
        /// Index of the base pose's first number in its buffer.
        base_at: u32,
        /// Numbers per pose; six per vertex, padding included, in engine-owned poses.
        pose_floats: u32,
        /// Float32 sums: input units per integer of a position delta.
        position_unit: f32,
        /// Float32 sums: input units per integer of a normal delta.
        normal_unit: f32,
        /// Poses of 16 bits: left shift of products to 2^-16 of units, by triple.
        raised: [u32; TRIPLES],
    }
}

shader_structure! {
    /// Push constants of `read.comp`.
    ReadPush {
        /// Number of 16-byte vectors to read.
        count: u32,
        /// Number of invocations.
        stride: u32,
    }
}

shader_structure! {
    /// Push constants of the kernels of animation on the GPU, described in `glsl/animation.glsl`.
    AnimationPush {
        now: u32,
        instances: u32,
        targets: u32,
        words: u32,
        blocks: u32,
        block_targets_at: u32,
        first_entry_at: u32,
        entries_at: u32,
        phases_at: u32,
        weights_at: u32,
        deltas_at: u32,
        bits_at: u32,
        history_at: u32,
        history_mask: u32,
        slots: u32,
        source: u32,
        destination: u32,
        always_rebuild: u32,
        first_instance: u32,
        group_instances: u32,
        first_block: u32,
        run_blocks: u32,
        run_entries: u32,
        first_counter: u32,
        counters: u32,
        chunks: u32,
        chunk_workgroups: u32,
        /// Rows hold the applied weight beside the new one, 16 bits each.
        pairs: u32,
        /// Items per workgroup.
        workgroup_items: u32,
    }
}

shader_structure! {
    /// Push constants of post-morph passes, described in `glsl/after.glsl`.
    AfterPush {
        units: [f32; GROUP_COMPONENTS],
        offsets: [f32; GROUP_COMPONENTS],
        written_at: [u32; 2],
        strides: [u32; 2],
        pose_at: u32,
        vertices: u32,
        count: u32,
        listed: u32,
        reads_at: u32,
    }
}

/// Bytes of push constants of a vertex pass over `batch` targets: a float each and, if the format has exponents, a
/// signed byte each, padded to words.
pub const fn attribute_push_bytes(format: &FormatRow, batch: u32) -> u32 {
    4 * batch + if format.exponents { 4 * batch.div_ceil(4) } else { 0 }
}
