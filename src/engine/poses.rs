//! Memory of poses: a buffer for each group of the mesh.

use super::upload::GpuMesh;
use crate::error::Result;
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::statistics::MemoryKind;
use crate::pack::PackedLayout;
use crate::plan::UpdateDesc;
use crate::update::crowd::CrowdDesc;
use crate::update::technique::{PoseGroup, Poses};
use ash::vk::BufferUsageFlags;
use std::sync::Arc;

/// The poses of a crowd in each group of a mesh, and their buffers.
///
/// # Errors
/// No grid for fixed-point poses; no memory.
pub(super) fn make(device: &Arc<Device>, mesh: &GpuMesh, desc: &CrowdDesc) -> Result<(Vec<PoseGroup>, Vec<Buffer>)> {
    let made = mesh.groups.iter().map(|group| of_group(device, group, desc)).collect::<Result<Vec<_>>>()?;
    Ok(made.into_iter().unzip())
}

fn of_group(device: &Arc<Device>, mesh: &Arc<MeshBuffers>, desc: &CrowdDesc) -> Result<(PoseGroup, Buffer)> {
    let mut usage = BufferUsageFlags::STORAGE_BUFFER
        | BufferUsageFlags::VERTEX_BUFFER
        | BufferUsageFlags::STORAGE_TEXEL_BUFFER
        | BufferUsageFlags::TRANSFER_SRC
        | desc.pose_usage;
    if device.feedback.is_some() {
        usage |= BufferUsageFlags::TRANSFORM_FEEDBACK_BUFFER_EXT;
    }
    let layout = &mesh.layout;
    let buffer = Buffer::new(device, "deltamorph poses", bytes_of(layout, desc), usage, MemoryKind::Poses)?;
    let CrowdDesc { instances, update, .. } = *desc;
    let UpdateDesc { pose: format, slots, .. } = update;
    let bytes = layout.pose_bytes(format);
    let poses = Poses { buffer: buffer.raw, usage, format, bytes, instances, slots, grid: update.grid(layout)? };
    Ok((PoseGroup { mesh: mesh.clone(), poses }, buffer))
}

/// Bytes of device memory for the poses of a crowd in the groups of a mesh.
pub(super) fn bytes<'a>(groups: impl Iterator<Item = &'a PackedLayout>, desc: &CrowdDesc) -> u64 {
    groups.map(|layout| bytes_of(layout, desc)).sum()
}

/// Bytes of a pose buffer. On a direct path one pose, for captures.
fn bytes_of(layout: &PackedLayout, desc: &CrowdDesc) -> u64 {
    let pose = layout.pose_bytes(desc.update.pose);
    let count = u64::from(desc.instances) * u64::from(desc.update.slots);
    if desc.update.path.evaluates_in_draws() { pose } else { pose.saturating_mul(count) }
}
