//! Structures for meshes in memory, and for clips.

use crate::handles::DmEngine;
use std::ffi::{c_char, c_void};

/// How to import and pack a mesh. Zeros are the defaults.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmMeshDesc {
    /// sizeof(DmMeshDesc).
    pub struct_size: u32,
    /// `DM_MESH_…`, combined.
    pub flags: u32,
    /// The engine for whose limits dense formats are split; zero: the limits of Khronos' Android baseline.
    pub engine: DmEngine,
    /// Shorter position deltas are dropped, as a fraction of the diagonal (`DmMeshInfo`); 0: 1e-6.
    pub position_tolerance: f32,
    /// Shorter normal deltas are dropped; 0: 1e-3, about 0.06 degrees.
    pub normal_tolerance: f32,
    /// `DM_DELTAS_…`, storage of the deltas; 0: `DM_DELTAS_FAST`.
    pub delta_format: u32,
    /// Vertices of a block: 32, 64 or 128; 0: the format's default (block formats).
    pub block_size: u32,
    /// Largest error of a position delta, as a fraction of the diagonal (`DmMeshInfo`); 0: 1e-5 (block formats).
    pub position_error: f32,
    /// Largest error of a normal or tangent at weight 1, in degrees; 0: 0.5 (block formats).
    pub normal_error_degrees: f32,
    /// Largest error of other streams' components at weight 1; 0: 1e-4 (block formats).
    pub absolute_error: f32,
    /// Largest absolute weight that 32-bit fixed-point poses accept; 0: 4 (block formats).
    pub weight_max: f32,
    /// Called with each message on the mesh; null: messages are dropped. Errors are results.
    pub message: DmMessage,
    /// Passed to `message`. Neither is used after the call that gets this structure.
    pub message_user: *mut c_void,
}

/// Receives a message: `DM_MESSAGE_…`, and a text in UTF-8, ended by a zero, valid until the function returns. The
/// library calls it only during the call that it was passed to, and on that thread; it may call the library. No
/// exception, panic or longjmp may leave it.
pub type DmMessage = Option<unsafe extern "C" fn(user: *mut c_void, severity: u32, text: *const c_char)>;

/// A base pose and its targets: arrays with one element per vertex, or null for missing data.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmMeshArrays {
    /// sizeof(DmMeshArrays).
    pub struct_size: u32,
    /// Vertices.
    pub vertex_count: u32,
    /// Name for messages; null: "unnamed".
    pub name: *const c_char,
    /// Positions, three floats each.
    pub positions: *const f32,
    /// Normals of unit length, three floats each; null: computed as `dm_mesh_open` describes.
    pub normals: *const f32,
    /// Tangents of unit length with the handedness (1 or -1) in w, four floats each; null: none.
    pub tangents: *const f32,
    /// Texture coordinates, two floats each; null: none.
    pub texcoords: *const f32,
    /// Triangles, three vertices each.
    pub indices: *const u32,
    /// The targets.
    pub targets: *const DmTargetArrays,
    /// Indices: three for each triangle.
    pub index_count: u32,
    /// Targets.
    pub target_count: u32,
    /// Not 0: targets state positions; 0: displacements from the base pose.
    pub absolute: u32,
    /// Bytes from vertex to vertex in positions, normals, tangents and texcoords, which may be interleaved: a multiple
    /// of 4; 0: each of them is contiguous.
    pub stride: u32,
}

/// A target of `DmMeshArrays`; a null array changes nothing.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmTargetArrays {
    /// sizeof(DmTargetArrays), the same for all targets.
    pub struct_size: u32,
    /// Bytes from vertex to vertex in its arrays, a multiple of 4; 0: each of them is contiguous.
    pub stride: u32,
    /// Name; null: "target" and its number.
    pub name: *const c_char,
    /// Positions, or their deltas, three floats for each vertex.
    pub positions: *const f32,
    /// Normals, or their deltas, three floats for each vertex; null: computed from the deformed surface.
    pub normals: *const f32,
    /// The tangents' x y z, or their deltas, three floats for each vertex.
    pub tangents: *const f32,
}

/// The built-in head: the same description gives the same head on every machine.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmSampleDesc {
    /// sizeof(DmSampleDesc).
    pub struct_size: u32,
    /// Vertices; 0: 43,788.
    pub vertices: u32,
    /// Targets; the first ones have ARKit's names; 0: 72.
    pub targets: u32,
    /// Mean fraction of the vertices that a target moves, in (0, 1]; 0: 0.12.
    pub sparsity: f32,
    /// Seed; 0: 1.
    pub seed: u64,
}

/// Sizes of a mesh.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmMeshInfo {
    /// sizeof(DmMeshInfo).
    pub struct_size: u32,
    /// Vertices.
    pub vertex_count: u32,
    /// Vertices of a pose buffer, padding included.
    pub padded_vertex_count: u32,
    /// Targets.
    pub target_count: u32,
    /// Indices that `dm_mesh_indices` writes.
    pub index_count: u32,
    /// `DM_DELTAS_…`, storage of the deltas.
    pub delta_format: u32,
    /// The length that errors are fractions of, in input units: the diagonal of the bounding box of what targets move
    /// (of the smallest such part, if several are far apart).
    pub diagonal: f32,
    /// Zero.
    pub reserved: u32,
    /// Bytes of a float32 pose, padding included.
    pub pose_bytes: u64,
    /// Bytes of device memory that the mesh takes; staging memory takes as many until it is released.
    pub device_bytes: u64,
}

/// Render vertices for `dm_mesh_render_vertices`: the vertices of the mesh, doubled where they have several texture
/// coordinates. Arrays that are null are not written.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmRenderVertices {
    /// sizeof(DmRenderVertices).
    pub struct_size: u32,
    /// Render vertices: in, the room; out, their number.
    pub vertex_count: u32,
    /// Indices: in, the room; out, their number.
    pub index_count: u32,
    /// Zero.
    pub reserved: u32,
    /// For each render vertex, the vertex of pose buffers that it takes position and normal from.
    pub pose_vertices: *mut u32,
    /// For each render vertex, two texture coordinates.
    pub texcoords: *mut f32,
    /// Triangles, three render vertices each.
    pub indices: *mut u32,
}

/// Size and rate of a clip.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmClipInfo {
    /// sizeof(DmClipInfo).
    pub struct_size: u32,
    /// Frames.
    pub frame_count: u32,
    /// Targets with weights in the clip.
    pub column_count: u32,
    /// Frames per second.
    pub fps: f32,
}

/// A clip of weights.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmClipArrays {
    /// sizeof(DmClipArrays).
    pub struct_size: u32,
    /// Frames.
    pub frame_count: u32,
    /// Targets with weights in the clip.
    pub column_count: u32,
    /// Frames per second, above 0.
    pub fps: f32,
    /// Name for messages; null: "unnamed".
    pub name: *const c_char,
    /// A target's name for each column.
    pub names: *const *const c_char,
    /// A weight for each column, frame after frame.
    pub values: *const f32,
}
