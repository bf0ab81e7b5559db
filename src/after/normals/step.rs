//! The device side of recomputed normals.

use super::fans::{Fans, Spread};
use crate::after::attached::Attached;
use crate::error::Result;
use crate::gpu::device::Device;
use crate::gpu::mesh::Upload;
use crate::pack::PackedMesh;
use ash::vk;
use std::sync::Arc;

/// The surface of a mesh on the device; see [`MorphEngine::upload_normals`](crate::MorphEngine::upload_normals).
/// Targets keep its buffers alive.
pub struct GpuNormals {
    pub(in crate::after) surface: Arc<Surface>,
    staging: Option<Upload>,
}

/// Shared by targets.
pub(in crate::after) struct Surface {
    pub attached: Arc<Attached>,
    pub spread: Spread,
}

impl GpuNormals {
    /// Records the upload.
    ///
    /// # Safety
    /// See [`MorphEngine::upload_normals`](crate::MorphEngine::upload_normals).
    pub(crate) unsafe fn upload(device: &Arc<Device>, cmd: vk::CommandBuffer, mesh: &PackedMesh) -> Result<Self> {
        let check = |words| Attached::check_size(device, mesh, "surface", mesh.base().len() as u64 + words);
        let Fans { words, spread } = Fans::new(mesh, check)?;
        // SAFETY: the caller's obligations.
        let (attached, upload) = unsafe { Attached::upload(device, cmd, mesh, "surface", (mesh.base(), &words)) }?;
        Ok(Self { surface: Arc::new(Surface { attached, spread }), staging: Some(upload) })
    }

    /// Frees the staging memory. Call it when the upload has finished, or if it will never run:
    /// [`MorphEngine::upload_normals`](crate::MorphEngine::upload_normals) requires that.
    pub fn release_staging(&mut self) {
        self.staging = None;
    }
}
