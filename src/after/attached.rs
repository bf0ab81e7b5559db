//! Mesh data of a step in one buffer: the base pose, if the step reads it, then words of the step.

use crate::error::{Result, ensure};
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::{Upload, record_uploads};
use crate::pack::{PackedLayout, PackedMesh};
use ash::vk;
use std::sync::Arc;

pub(super) struct Attached {
    buffer: Buffer,
    bytes: u64,
    words_at: u32,
    layout: PackedLayout,
}

impl Attached {
    /// Records the upload of `base` and `words`; `what` names them in errors.
    ///
    /// # Errors
    /// A mesh without vertices; data beyond the storage range; no memory. Nothing is recorded then.
    ///
    /// # Safety
    /// See [`record_uploads`].
    pub unsafe fn upload(
        device: &Arc<Device>,
        cmd: vk::CommandBuffer,
        mesh: &PackedMesh,
        what: &str,
        (base, words): (&[f32], &[u32]),
    ) -> Result<(Arc<Self>, Upload)> {
        let layout = mesh.layout().clone();
        layout.check_not_empty()?;
        let words_at = base.len() as u32;
        let count = (base.len() + words.len()) as u64;
        Self::check_size(device, mesh, what, count)?;
        let lists = [bytemuck::cast_slice(base), bytemuck::cast_slice(words)];
        let (buffer, upload) = Upload::of(device, &format!("deltamorph {what}"), &lists)?;
        // SAFETY: the caller's obligations.
        unsafe { record_uploads(device, cmd, std::slice::from_ref(&upload)) };
        Ok((Arc::new(Self { buffer, bytes: 4 * count, words_at, layout }), upload))
    }

    /// Checks that `words` words fit a descriptor.
    pub fn check_size(device: &Device, mesh: &PackedMesh, what: &str, words: u64) -> Result<()> {
        let bytes = 4 * words;
        let text = format!("{what} of mesh '{}' takes", mesh.layout().name);
        device.caps.check_limit(&text, (bytes, "bytes", device.caps.max_storage_range), "split the mesh")
    }

    /// Word offset of the step's words.
    pub fn words_at(&self) -> u32 {
        self.words_at
    }

    pub fn range(&self) -> BufferRange {
        BufferRange::new(self.buffer.raw, 0, self.bytes)
    }

    /// Checks that a crowd has the same device and vertex order.
    pub fn check(&self, what: &str, device: &Arc<Device>, layout: &PackedLayout) -> Result<()> {
        let order = |layout: &PackedLayout| layout.blocks.as_ref().map(|index| index.order().to_vec());
        let same = self.layout.vertex_count == layout.vertex_count && order(&self.layout) == order(layout);
        let text = format!("{what} of mesh '{}' for a crowd of mesh '{}'", self.layout.name, layout.name);
        let remedy = "upload it with the crowd's engine, for the packed mesh that the crowd was made of";
        ensure!(self.buffer.is_on(device) && same, text, remedy);
        Ok(())
    }
}
