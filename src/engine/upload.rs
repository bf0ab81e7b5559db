//! Upload of meshes to the device.

use super::MorphEngine;
use crate::abi::numbers::WORKGROUP;
use crate::error::Result;
use crate::gpu::caps::CAPTURE_STRIDE;
use crate::gpu::mesh::{MeshBuffers, Upload, chunk_bytes, deltas_bytes, record_uploads};
use crate::pack::{PackedGroup, PackedLayout, PackedMesh};
use crate::plan::UpdatePath;
use crate::update::technique::Techniques;
use ash::vk;
use std::sync::Arc;

/// A mesh on the device. Crowds keep its buffers alive.
pub struct GpuMesh {
    /// At least one.
    pub(crate) groups: Vec<Arc<MeshBuffers>>,
    pub(super) staging: Vec<Upload>,
}

impl GpuMesh {
    /// Frees the staging memory. Call it when the upload has finished, or if it will never run:
    /// [`MorphEngine::upload`] requires that.
    pub fn release_staging(&mut self) {
        self.staging.clear();
    }

    /// The layout of positions and normals: names, steps and sizes.
    pub fn layout(&self) -> &PackedLayout {
        &self.groups[0].layout
    }

    /// The layouts of all [groups](PackedMesh::groups).
    pub fn layouts(&self) -> impl Iterator<Item = &PackedLayout> + Clone {
        self.groups.iter().map(|group| &group.layout)
    }
}

impl MorphEngine {
    /// Bytes of device memory for a mesh, and of staging memory until [`GpuMesh::release_staging`].
    pub fn mesh_bytes(mesh: &PackedMesh) -> u64 {
        let of = |layout: &PackedLayout| {
            let base = if layout.format.is_blocks() { 0 } else { layout.base_bytes() };
            base + deltas_bytes(layout)
        };
        mesh.layouts().map(of).sum()
    }

    /// Creates a mesh's buffers and records their upload. The base pose stays in main memory, too (24 bytes a vertex):
    /// crowds with fixed-point poses have another in their integers.
    ///
    /// Records: for each group copies from staging memory, and a barrier that makes them visible to every update path
    /// and draw (first stage TRANSFER with TRANSFER_WRITE; last ALL_COMMANDS with MEMORY_READ and MEMORY_WRITE).
    ///
    /// The caller is responsible for: submitting `cmd` before any update of the mesh, and calling
    /// [`GpuMesh::release_staging`] once it has finished.
    ///
    /// # Errors
    /// A mesh beyond the device's limits, with the numbers; no memory.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering, on any queue.
    /// - It runs exactly once, before any update of the mesh; if it never runs, no crowd of the mesh is updated.
    /// - [`GpuMesh::release_staging`] is called only when `cmd` has finished, or if it never runs.
    /// - The returned value is dropped only when the device no longer uses it.
    pub unsafe fn upload(&self, cmd: vk::CommandBuffer, mesh: &PackedMesh) -> Result<GpuMesh> {
        let group = |group: &PackedGroup| {
            self.check_mesh(group.layout())?;
            MeshBuffers::new(&self.device, group.layout().clone(), group.base(), group.deltas(), None)
        };
        let groups: Result<(Vec<_>, Vec<_>)> = mesh.groups().iter().map(group).collect();
        let (groups, staging) = groups?;
        // SAFETY: the caller's obligations.
        Ok(unsafe { self.upload_buffers(cmd, groups, staging) })
    }

    /// Like [`upload`](Self::upload), for crowds on `path`, which may have its own encoding.
    ///
    /// # Errors
    /// Those of [`upload`](Self::upload); a mesh that the path does not support; a baseline that is not linked.
    ///
    /// # Safety
    /// See [`upload`](Self::upload).
    #[doc(hidden)]
    pub unsafe fn upload_for(&self, cmd: vk::CommandBuffer, mesh: &PackedMesh, path: UpdatePath) -> Result<GpuMesh> {
        let device = &self.device;
        let layout = mesh.layout();
        if !path.row().has_own_upload {
            // SAFETY: the caller's obligations.
            return unsafe { self.upload(cmd, mesh) };
        }
        device.caps.check_path(path)?;
        path.check_format(layout.format)?;
        path.check_groups(mesh.groups().len(), layout)?;
        layout.check_not_empty()?;
        let others = Techniques::of(self.others.get().copied(), path, &device.caps)?;
        // SAFETY: the caller's obligations.
        unsafe {
            let (groups, uploads) = (others.upload)(device, cmd, mesh, path)?;
            Ok(self.upload_buffers(cmd, groups, uploads))
        }
    }

    /// Records these uploads, of groups of a checked mesh.
    ///
    /// # Safety
    /// See [`upload`](Self::upload).
    unsafe fn upload_buffers(&self, cmd: vk::CommandBuffer, groups: Vec<MeshBuffers>, staging: Vec<Upload>) -> GpuMesh {
        // SAFETY: the caller's obligations.
        unsafe { record_uploads(&self.device, cmd, &staging) };
        GpuMesh { groups: groups.into_iter().map(Arc::new).collect(), staging }
    }

    fn check_mesh(&self, layout: &PackedLayout) -> Result<()> {
        let caps = &self.device.caps;
        let limit = |what: &str, amount: u64, unit: &str, most: u64, remedy: &str| {
            caps.check_limit(&format!("mesh '{}': {what}", layout.name), (amount, unit, most), remedy)
        };
        layout.check_not_empty()?;
        let range = caps.max_storage_range;
        let groups = caps.max_workgroups.into();
        let chunk_groups = (layout.chunk_vertices as u64).div_ceil(WORKGROUP.into());
        limit("a pose takes", layout.base_bytes(), "bytes", range, "split the mesh")?;
        if layout.format.is_blocks() {
            let remedy = "pack it in a format with smaller deltas ('small'), or split the mesh";
            return limit("its deltas and base pose take", deltas_bytes(layout), "bytes", range, remedy);
        }
        limit("a chunk of deltas takes", chunk_bytes(layout), "bytes", range, "pack with MorphEngine::pack_desc")?;
        limit("a chunk takes", chunk_groups, "workgroups", groups, "pack with MorphEngine::pack_desc")?;
        if let Some(feedback) = caps.transform_feedback {
            let captured = (layout.chunk_vertices * CAPTURE_STRIDE) as u64;
            let most = feedback.max_buffer_bytes;
            limit("a chunk captures", captured, "bytes", most, "pack with MorphEngine::pack_desc")?;
        }
        let deltas = deltas_bytes(layout);
        limit("its deltas take", deltas, "bytes", u32::MAX.into(), "split the mesh or use the snorm16 format")
    }
}
