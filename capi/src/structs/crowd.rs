//! Structures for crowds.

use crate::handles::{DmClip, DmMesh};
use deltamorph::ash::vk;
use std::ffi::c_char;

/// How to make a crowd. Zeros are the defaults.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmCrowdDesc {
    /// sizeof(DmCrowdDesc).
    pub struct_size: u32,
    /// Instances, each with its own weights and poses; 0: 1. The number is fixed: make the most that will be needed,
    /// and remove or hide the rest.
    pub instances: u32,
    /// `DM_PATH_…`; 0: blocks.
    pub path: u32,
    /// Targets per pass (dense formats); 0: all at once.
    pub batch: u32,
    /// `DM_MODE_…`; 0: incremental if the path supports it.
    pub mode: u32,
    /// Pose buffers of an instance; 1: no previous pose is kept; 0: 2.
    pub slots: u32,
    /// `DM_POSE_…`, how poses are stored; 0: float32, for animated crowds 32-bit fixed point.
    pub pose_format: u32,
    /// Updates that may be recorded and not yet finished; 0: 2.
    pub frames_in_flight: u32,
    /// `DM_READ_BY_…`, combined: the readers of poses between updates; 0: vertex attributes and vertex shaders.
    pub consumers: u32,
    /// Largest position error that accumulation in float32 may cause, as a fraction of the diagonal; 0: 1e-5.
    pub tolerance: f32,
    /// Largest absolute weight that fixed-point poses have to hold; 0: 1 in 16 bits, in 32 bits the one that the mesh
    /// was packed with.
    pub weight_max: f32,
    /// Error budget, a length in input units: changes that move a vertex by less are deferred until they add up to
    /// more; 0: none is deferred.
    pub error_budget: f32,
    /// VkBufferUsageFlags of pose buffers, in addition to vertex, storage and storage texel buffer, and source of
    /// copies.
    pub pose_usage: u32,
    /// Zero.
    pub reserved: u32,
    /// The family of the queue that updates of the crowd run on; null: one with graphics and compute. Read during the
    /// call only. For a family without graphics, barriers name no graphics stage: consumers that have one are on
    /// another queue.
    pub queue_family: *const u32,
}

/// Clips for a crowd that is animated on the GPU.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmAnimationDesc {
    /// sizeof(DmAnimationDesc).
    pub struct_size: u32,
    /// Clips.
    pub clip_count: u32,
    /// The clips; they may be destroyed after the call.
    pub clips: *const DmClip,
    /// Bits of a key: 32 or 16; 0: 32.
    pub key_bits: u32,
    /// Zero.
    pub reserved: u32,
    /// Levels of detail; null: all targets are kept.
    pub level: *const DmLevelDesc,
}

/// Levels of detail: an instance keeps as many targets, in the order of their importance, as `dm_crowd_set_level` says.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmLevelDesc {
    /// sizeof(DmLevelDesc).
    pub struct_size: u32,
    /// Pins.
    pub pin_count: u32,
    /// The mesh that was uploaded: its targets are ranked by the mean square of the distances that they move vertices.
    /// It may be destroyed after the call.
    pub mesh: DmMesh,
    /// Names, or beginnings of names, of targets that are always kept.
    pub pins: *const *const c_char,
}

/// How an instance plays a clip.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmPlayback {
    /// sizeof(DmPlayback).
    pub struct_size: u32,
    /// Number of the clip, counted from 0.
    pub clip: u32,
    /// When it starts, in seconds of the clock that `dm_crowd_set_time` sets.
    pub start: f64,
    /// Speed relative to the clip's own, backwards below 0; 0: 1.
    pub speed: f64,
    /// Not 0: the clip stops at its last frame; 0: it repeats.
    pub once: u32,
    /// Zero.
    pub reserved: u32,
}

/// Names an update, to discard it.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmTicket {
    /// Bits of the crowd's handle.
    pub crowd: u64,
    /// Number of the update, from 1 on.
    pub number: u64,
}

/// Statistics of a recorded update. All counts are zero if no weight changed.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmUpdate {
    /// sizeof(DmUpdate).
    pub struct_size: u32,
    /// Bound on the position error that accumulation, or rounding and decoding, may have caused so far, in input units.
    pub bound: f32,
    /// Ticket for `dm_crowd_discard`, should the command buffer never run.
    pub ticket: DmTicket,
    /// Targets applied (dense formats), or whose weight changed (block formats).
    pub coefficients: u64,
    /// Passes.
    pub passes: u64,
    /// Instances that started from the base pose (dense formats).
    pub rebuilt: u64,
    /// Blocks written (block formats).
    pub dirty_blocks: u64,
    /// Of these, blocks that started from the base pose.
    pub rebuilt_blocks: u64,
    /// Bytes loaded and stored.
    pub bytes_moved: u64,
    /// Lower bound of the bytes that any update could move.
    pub bytes_floor: u64,
    /// Timestamps that it writes into the queries of `dm_crowd_set_queries`: one more than steps; 0 without queries, or
    /// if nothing was recorded.
    pub timestamps: u32,
    /// Zero.
    pub reserved: u32,
}

/// Buffer and layout of a pose. A component, in input units, is offset + number × unit; normals are not normalised.
///
/// A draw fetches numbers as `dm_pose_vertex_input` says. A position is `offsets` + number × `units`: a matrix, which
/// the host multiplies into its own model matrix from the right. Normals are directions as they are.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmPoseView {
    /// sizeof(DmPoseView).
    pub struct_size: u32,
    /// Bytes from vertex to vertex.
    pub stride: u32,
    /// The buffer: usable as vertex, storage and transfer-source buffer.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex.
    pub offset: u64,
    /// Bytes, padding included.
    pub size: u64,
    /// `DM_POSE_…`, how vertices are stored.
    pub format: u32,
    /// Slot of the instance.
    pub slot: u32,
    /// Input units per number, by component: position, then normal; 1 for float32. Equal for all poses of a crowd.
    pub units: [f32; 6],
    /// The value of number 0, in input units, by component: 0 for float32 and for normals. Equal for all poses of a
    /// crowd.
    pub offsets: [f32; 6],
    /// The buffer of the pose before the last update, which is the pose itself if nothing changed, on the first update,
    /// and after `dm_crowd_reset_history`. Null: the update had to overwrite it.
    pub previous_buffer: vk::Buffer,
    /// Offset of its first vertex.
    pub previous_offset: u64,
}

/// Buffer and layout of a stream of a pose.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmStreamView {
    /// sizeof(DmStreamView).
    pub struct_size: u32,
    /// Bytes from vertex to vertex.
    pub stride: u32,
    /// The buffer, with the usages of a pose's.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex's first component.
    pub offset: u64,
    /// Components, one after the other.
    pub components: u32,
    /// `DM_POSE_…`, how a component is stored.
    pub format: u32,
    /// Input units per number, by component; 1 for float32.
    pub units: [f32; 4],
    /// The value of number 0, in input units, by component.
    pub offsets: [f32; 4],
    /// Slot of the instance.
    pub slot: u32,
    /// Zero.
    pub reserved: u32,
}
