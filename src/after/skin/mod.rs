//! Skinning of poses by joints.
//!
//! `weights`: packing of joints and weights. `reference`: the same in float64.

mod reference;
mod weights;

use super::attached::Attached;
use super::context::TargetContext;
use crate::error::{Result, ensure};
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::gpu::mesh::Upload;
use crate::pack::PackedMesh;
use ash::vk;
pub use reference::skin;
use std::sync::Arc;
pub use weights::{SkinDesc, SkinMethod};

/// Joints and weights of a mesh on the device; see [`MorphEngine::upload_skin`](crate::MorphEngine::upload_skin).
/// Targets keep its buffers alive.
pub struct GpuSkin {
    attached: Arc<Attached>,
    influences: u32,
    joint_count: u32,
    staging: Option<Upload>,
}

impl GpuSkin {
    /// Records the upload.
    ///
    /// # Safety
    /// See [`MorphEngine::upload_skin`](crate::MorphEngine::upload_skin).
    #[allow(unsafe_code)]
    pub(crate) unsafe fn upload(
        device: &Arc<Device>,
        cmd: vk::CommandBuffer,
        mesh: &PackedMesh,
        desc: &SkinDesc<'_>,
    ) -> Result<Self> {
        let words = desc.pack(mesh.layout())?;
        // SAFETY: the caller's obligations.
        let (attached, upload) = unsafe { Attached::upload(device, cmd, mesh, "skin", (&[], &words)) }?;
        let SkinDesc { influences, joint_count, .. } = *desc;
        Ok(Self { attached, influences, joint_count, staging: Some(upload) })
    }

    /// Frees the staging memory. Call it when the upload has finished, or if it will never run:
    /// [`MorphEngine::upload_skin`](crate::MorphEngine::upload_skin) requires that.
    pub fn release_staging(&mut self) {
        self.staging = None;
    }
}

/// The joints of an instance.
#[derive(Clone, Copy)]
pub struct Joints<'a> {
    /// The skin of the mesh.
    pub skin: &'a GpuSkin,
    /// The buffer of joints, with storage buffer usage.
    pub buffer: vk::Buffer,
    /// Bytes of that buffer, from its start, that contain joints.
    pub bytes: u64,
    /// Byte offset of the instance's first joint, a multiple of 16, until
    /// [`Crowd::set_joints`](crate::Crowd::set_joints) sets another.
    pub offset: u64,
    /// Blending method, which determines the layout of joints.
    pub method: SkinMethod,
}

impl<'a> Joints<'a> {
    /// Linear blending of matrices in the first `bytes` bytes of `buffer`.
    pub fn new(skin: &'a GpuSkin, buffer: vk::Buffer, bytes: u64) -> Self {
        Self { skin, buffer, bytes, offset: 0, method: SkinMethod::Linear }
    }
}

/// The skin of an instance, and its joints.
#[derive(Clone)]
pub(super) struct Skinned {
    pub attached: Arc<Attached>,
    pub influences: u32,
    pub method: SkinMethod,
    /// Where joints may be.
    pub joints: BufferRange,
    joint_count: u32,
}

impl Skinned {
    /// The skin of an instance, and the index of its first vector of joints.
    ///
    /// # Errors
    /// A skin of another engine, mesh or packing; joints that do not fit their buffer, or its buffer the device.
    pub fn new(joints: &Joints<'_>, context: &TargetContext<'_>) -> Result<(Self, u32)> {
        let &Joints { skin, buffer, bytes, offset, method } = joints;
        let device = context.device;
        skin.attached.check("a skin", device, context.layout())?;
        let limit = (bytes, "bytes", device.caps.max_storage_range);
        device.caps.check_limit("the joints of an output target take", limit, "split the buffer of joints")?;
        let joints = BufferRange::new(buffer, 0, bytes);
        let GpuSkin { attached, influences, joint_count, .. } = skin;
        let (attached, influences, joint_count) = (attached.clone(), *influences, *joint_count);
        let skinned = Self { attached, influences, method, joints, joint_count };
        let at = skinned.place(offset)?;
        Ok((skinned, at))
    }

    /// The index of the first vector of joints at this offset.
    ///
    /// # Errors
    /// A misaligned offset; joints beyond the end of their buffer.
    pub fn place(&self, offset: u64) -> Result<u32> {
        let Self { joint_count, joints, .. } = *self;
        let size = self.method.joint_bytes() * u64::from(joint_count);
        let fits = offset.is_multiple_of(16) && offset.checked_add(size).is_some_and(|end| end <= joints.size);
        let buffer = format!("a buffer with {} bytes of joints", joints.size);
        let text = format!("{joint_count} joints of {size} bytes at offset {offset} of {buffer}");
        ensure!(fits, text, "use a multiple of 16, and a buffer with room for all joints after it");
        Ok((offset / 16) as u32)
    }
}
