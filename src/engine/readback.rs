//! Copies poses to host memory, and decodes them.

use super::MorphEngine;
use super::base::Crowd;
use super::views::PoseView;
use crate::asset::streams::{Semantic, StreamPlace};
use crate::error::Result;
use crate::gpu::barriers;
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::statistics::MemoryKind;
use crate::pack::POSE_FLOATS;
use crate::pack::blocks::PoseGrid;
use crate::plan::schedule::Barrier;
use crate::plan::steps::{Access, Resource, Stage, Use};
use crate::update::technique::PoseGroup;
use ash::vk;
use std::sync::Arc;

/// Host memory to which poses are copied: for tools, picking, collision, export, tests. Reusable once the copies
/// recorded with it have finished.
pub struct PoseReadback {
    device: Arc<Device>,
    buffer: Option<Buffer>,
    /// Its capacity.
    bytes: u64,
    copies: Vec<CopiedPose>,
}

/// A pose of a group in the buffer.
struct CopiedPose {
    instance: u32,
    group: usize,
    mesh: Arc<MeshBuffers>,
    view: PoseView,
    at: u64,
    grid: Option<PoseGrid>,
}

/// A pose read back, in the packed mesh's user order, without padding.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ReadPose {
    /// The instance.
    pub instance: u32,
    /// Six numbers per vertex: position in input units, and normal, not normalised.
    pub vertices: Vec<f32>,
    /// The other streams of the mesh: their [components](Semantic::components), vertex by vertex.
    pub streams: Vec<(Semantic, Vec<f32>)>,
}

impl MorphEngine {
    /// Memory for reading poses back, allocated when poses are [recorded](PoseReadback::record).
    pub fn readback(&self) -> PoseReadback {
        PoseReadback { device: self.device.clone(), buffer: None, bytes: 0, copies: vec![] }
    }
}

impl PoseReadback {
    /// Records copies of the poses of `instances`, which replace those recorded before. Call it after the update that
    /// writes the poses, for the same command buffer or a later one.
    ///
    /// Records: a barrier from the stages that write poses to copies (TRANSFER with TRANSFER_READ), independent of the
    /// crowd's [consumers](crate::CrowdDesc::consumers); the copies; and a barrier that makes them visible to the host
    /// (HOST with HOST_READ), for which later updates wait.
    ///
    /// # Errors
    /// A crowd of another engine; errors of [`Crowd::pose`](super::Crowd::pose) for each instance; no memory. Nothing
    /// is recorded then, and earlier copies can still be read.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering, on the queue of the crowd's updates. It runs after the updates of the
    ///   crowd recorded so far, and before later ones.
    /// - Everything recorded with this value before has finished, or will never run.
    /// - This value and the crowd live until the device has finished.
    pub unsafe fn record(&mut self, cmd: vk::CommandBuffer, crowd: &Crowd, instances: &[u32]) -> Result<()> {
        crowd.check_device(&self.device)?;
        let groups = 0..crowd.groups.len();
        let each = instances.iter().flat_map(|&instance| groups.clone().map(move |group| (instance, group)));
        let views = each.map(|(instance, group)| Ok((instance, group, crowd.group_pose(instance, group)?)));
        let views = views.collect::<Result<Vec<_>>>()?;
        // SAFETY: the caller's obligations.
        unsafe { self.record_views(cmd, crowd, &views) }
    }

    /// Records copies of views of a crowd's poses: instance, group and view.
    ///
    /// # Safety
    /// See [`record`](Self::record).
    #[doc(hidden)]
    pub unsafe fn record_views(
        &mut self,
        cmd: vk::CommandBuffer,
        crowd: &Crowd,
        views: &[(u32, usize, PoseView)],
    ) -> Result<()> {
        let (mut bytes, mut regions) = (0, vec![]);
        let mut place = |buffer: vk::Buffer, offset, size| {
            regions.push((buffer, vk::BufferCopy { src_offset: offset, dst_offset: bytes, size }));
            bytes += size;
            bytes - size
        };
        let mut copies = vec![];
        for &(instance, group, view) in views {
            let at = place(view.buffer, view.offset, view.size);
            let PoseGroup { mesh, poses } = &crowd.groups[group];
            copies.push(CopiedPose { instance, group, mesh: mesh.clone(), view, at, grid: poses.grid });
        }
        if bytes > self.bytes || self.buffer.is_none() {
            // The old buffer is freed after success: it stays if there is no memory for both.
            let usage = vk::BufferUsageFlags::TRANSFER_DST;
            let buffer = Buffer::new(&self.device, "deltamorph read-back", bytes, usage, MemoryKind::Readback)?;
            (self.buffer, self.bytes) = (Some(buffer), bytes);
        }
        self.copies = copies;
        let Some(buffer) = &self.buffer else { return Ok(()) };
        let written: Vec<Use> = crowd.writes_of_poses().copied().collect();
        let read = Use::new(Resource::Poses, Stage::Transfer, Access::TransferRead);
        let before = Barrier::between(&written, &[read]);
        let (device, writers) =
            (&self.device.raw, written.iter().map(Use::scope).reduce(|a, b| a | b).unwrap_or_default());
        // SAFETY: the caller's obligations; regions lie within their buffers, and the copies before have finished.
        unsafe {
            before.iter().for_each(|barrier| barriers::record(device, cmd, barrier));
            for (from, region) in regions {
                device.cmd_copy_buffer(cmd, from, buffer.raw, &[region]);
            }
            barriers::record_read_back(device, cmd, writers);
        }
        Ok(())
    }

    /// Decodes the poses recorded last, in that order.
    ///
    /// # Errors
    /// Mapping of host-visible memory fails, which Vulkan does not allow; no such driver is known.
    ///
    /// # Safety
    /// The command buffer that they were recorded into has finished: the host has waited for its fence.
    pub unsafe fn poses(&mut self) -> Result<Vec<ReadPose>> {
        // SAFETY: the caller's obligation.
        let decoded = unsafe { self.decoded() }?;
        let mut poses: Vec<ReadPose> = vec![];
        for (CopiedPose { instance, group, mesh, .. }, vertices) in self.copies.iter().zip(decoded) {
            if *group == 0 {
                poses.push(ReadPose { instance: *instance, vertices, streams: vec![] });
                continue;
            }
            let vertices = || vertices.as_chunks::<POSE_FLOATS>().0.iter();
            let stream = |place: &StreamPlace| {
                (place.semantic, vertices().flat_map(|vertex| &vertex[place.components()]).copied().collect())
            };
            poses.last_mut().into_iter().for_each(|pose| pose.streams.extend(mesh.layout.streams.iter().map(stream)));
        }
        Ok(poses)
    }

    /// Like [`poses`](Self::poses), by view: six numbers per vertex.
    ///
    /// # Safety
    /// The same.
    #[doc(hidden)]
    pub unsafe fn decoded(&mut self) -> Result<Vec<Vec<f32>>> {
        let Some(buffer) = &mut self.buffer else { return Ok(vec![]) };
        let bytes: &[u8] = buffer.mapped()?;
        let decode = |CopiedPose { mesh, view, at, grid, .. }: &CopiedPose| {
            let pose = &bytes[*at as usize..][..view.size as usize];
            mesh.layout.to_user_order(&view.format.decode(pose, grid.as_ref()))
        };
        Ok(self.copies.iter().map(decode).collect())
    }
}
