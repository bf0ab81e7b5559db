//! Structures for post-morph passes.

use deltamorph::ash::vk;

/// Joints and weights of the vertices of a mesh.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmSkinDesc {
    /// sizeof(DmSkinDesc).
    pub struct_size: u32,
    /// Joints of each vertex: 4 or 8; 0: 4.
    pub influences: u32,
    /// For each of the DmMeshInfo::vertex_count vertices, in the order of the mesh as it was imported, `influences`
    /// joints. Those with the weight 0 are not used.
    pub joints: *const u16,
    /// The weights of these joints: not negative; they are divided by their sum, which is above 0.
    pub weights: *const f32,
    /// Number of joints: 1 to 65,536.
    pub joint_count: u32,
    /// Zero.
    pub reserved: u32,
}

/// A stream of poses in vertices of the application: buffer, offset, stride and format of their own.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmOutputStream {
    /// `DM_STREAM_…`, which the mesh has.
    pub stream: u32,
    /// Bytes from vertex to vertex, a multiple of 4; 0: those of the components that morph.
    pub stride: u32,
    /// The buffer, usable as storage buffer.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex's stream, a multiple of 4.
    pub offset: u64,
    /// Second buffer with the same stride: updates write the two in turn, and the other one keeps the previous output.
    /// All streams of a target have one, or none. Null: none.
    pub second_buffer: vk::Buffer,
    /// Offset in the second buffer.
    pub second_offset: u64,
    /// VkFormat: R32G32_SFLOAT, R32G32B32_SFLOAT or R32G32B32A32_SFLOAT; for normals and tangents also
    /// R16G16B16A16_SNORM, R8G8B8A8_SNORM or A2B10G10R10_SNORM_PACK32. Normals and tangents have unit length.
    /// Components that do not morph keep their values: a fourth one beside positions and normals, and the handedness of
    /// a tangent in w. 0: float32 of the components that morph.
    pub format: u32,
    /// Zero.
    pub reserved: u32,
}

/// Output of an instance's pose into vertices of the application, and the joints that skin it.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmOutputTarget {
    /// sizeof(DmOutputTarget).
    pub struct_size: u32,
    /// Streams.
    pub stream_count: u32,
    /// The streams that are written, which do not overlap.
    pub streams: *const DmOutputStream,
    /// The buffer of the joints, usable as storage buffer; null without a skin.
    pub joints: vk::Buffer,
    /// Bytes from the beginning of that buffer that joints may occupy.
    pub joints_bytes: u64,
    /// Offset of the instance's first joint, a multiple of 16, until `dm_crowd_set_joints` sets another.
    pub joints_offset: u64,
    /// `DM_SKIN_…`, how joints are blended, and so their layout; 0: linear.
    pub method: u32,
    /// 0: vertices have the order of the mesh as it was imported or handed in. 1: that of poses, with the indices of
    /// the library. There are DmMeshInfo::vertex_count of them in either case.
    pub pose_order: u32,
}

/// Buffer and offset of an output.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmOutputView {
    /// sizeof(DmOutputView).
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// The buffer.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex of the target's first stream.
    pub offset: u64,
    /// The buffer with the output before the last update: the same output if nothing changed, on the first update and
    /// after its history was reset. Null: the update overwrote it.
    pub previous_buffer: vk::Buffer,
    /// Offset in that buffer.
    pub previous_offset: u64,
}
