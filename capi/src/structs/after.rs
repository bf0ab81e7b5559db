//! Structures for post-morph passes.

use deltamorph::ash::vk;

/// Output buffer for normals of an instance's morphed surface, in the order of poses and without padding.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmNormalsTarget {
    /// sizeof(DmNormalsTarget).
    pub struct_size: u32,
    /// Bytes from vertex to vertex, a multiple of 4 from 12 on; 0: 12.
    pub stride: u32,
    /// The buffer, usable as storage buffer.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex's normal, a multiple of 4.
    pub offset: u64,
}

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

/// Output buffer of an instance's pose as float32, in the order of poses and without padding, and the joints that skin
/// it.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmOutputTarget {
    /// sizeof(DmOutputTarget).
    pub struct_size: u32,
    /// Bytes from vertex to vertex, a multiple of 4; 0: 12, or `normals` and 12.
    pub stride: u32,
    /// The buffer, usable as storage buffer.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex's position, a multiple of 4.
    pub offset: u64,
    /// Second output buffer of the same stride, which keeps the previous output when the next is written; null: none.
    pub second_buffer: vk::Buffer,
    /// Offset in the second buffer.
    pub second_offset: u64,
    /// The buffer of the joints, usable as storage buffer; null without a skin.
    pub joints: vk::Buffer,
    /// Bytes from the beginning of that buffer that joints may occupy.
    pub joints_bytes: u64,
    /// Offset of the instance's first joint, a multiple of 16, until `dm_crowd_set_joints` sets another.
    pub joints_offset: u64,
    /// Bytes from a position to its normal, a multiple of 4 from 12 on; 0: no normals. Skinned normals have unit
    /// length.
    pub normals: u32,
    /// `DM_SKIN_…`, how joints are blended, and so their layout; 0: linear.
    pub method: u32,
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
    /// Offset of the first position.
    pub offset: u64,
    /// The buffer with the output before the last update: the same output if nothing changed, on the first update and
    /// after its history was reset. Null: the update overwrote it.
    pub previous_buffer: vk::Buffer,
    /// Offset in that buffer.
    pub previous_offset: u64,
}
