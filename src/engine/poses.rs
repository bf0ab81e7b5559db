//! Memory of poses: engine-owned buffers, one per group of the mesh, or one buffer of the host.

use super::upload::GpuMesh;
use crate::error::{Result, ensure};
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::statistics::MemoryKind;
use crate::pack::PackedLayout;
use crate::pack::vertex::Places;
use crate::update::crowd::{CrowdDesc, HostPoses};
use crate::update::technique::{PoseGroup, Poses};
use ash::vk;
use std::sync::Arc;

/// Largest alignment of storage-buffer offsets of any device.
const ALIGNMENT: u64 = 256;

/// The poses of a crowd in each group of a mesh, and the engine-owned buffers.
///
/// # Errors
/// A host buffer with a misaligned offset, or too small; no grid for fixed-point poses; no memory.
pub(super) fn make(device: &Arc<Device>, mesh: &GpuMesh, desc: &CrowdDesc) -> Result<(Vec<PoseGroup>, Vec<Buffer>)> {
    let mut buffers = vec![];
    let group = |group: &Arc<MeshBuffers>| {
        let poses = match &desc.poses {
            Some(host) => poses_of_host(device, host, &group.layout, desc)?,
            None => {
                let (poses, buffer) = poses_of_ours(device, &group.layout, desc)?;
                buffers.push(buffer);
                poses
            }
        };
        Ok(PoseGroup { mesh: group.clone(), poses })
    };
    let groups = mesh.groups.iter().map(group).collect::<Result<_>>()?;
    Ok((groups, buffers))
}

fn poses_of_ours(device: &Arc<Device>, layout: &PackedLayout, desc: &CrowdDesc) -> Result<(Poses, Buffer)> {
    let mut usage = vk::BufferUsageFlags::STORAGE_BUFFER
        | vk::BufferUsageFlags::VERTEX_BUFFER
        | vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER
        | vk::BufferUsageFlags::TRANSFER_SRC
        | desc.pose_usage;
    if device.feedback.is_some() {
        usage |= vk::BufferUsageFlags::TRANSFORM_FEEDBACK_BUFFER_EXT;
    }
    let bytes = bytes_of(layout, desc);
    let buffer = Buffer::new(device, "deltamorph poses", bytes, usage, MemoryKind::Poses)?;
    let format = desc.update.pose;
    let slots = desc.update.slots;
    let poses = Poses {
        buffer: buffer.raw,
        usage,
        begin: 0,
        lead: 0,
        format,
        places: Places::TIGHT,
        bytes: layout.pose_bytes(format),
        instances: desc.instances,
        slots,
        grid: desc.update.grid(layout)?,
    };
    Ok((poses, buffer))
}

fn poses_of_host(device: &Device, host: &HostPoses, layout: &PackedLayout, desc: &CrowdDesc) -> Result<Poses> {
    let offset = host.offset();
    let format = desc.update.pose;
    let bytes = host.vertex().pose_bytes(layout);
    let end = offset.saturating_add(bytes.saturating_mul(count(desc)));
    let what = format!("poses of mesh '{}' from byte {offset} on in the host's buffer end at", layout.name);
    device.caps.check_limit(&what, (end, "bytes", device.caps.max_buffer), "use fewer instances or slots")?;
    let text = format!("poses from byte {offset} on in the host's buffer");
    ensure!(offset.is_multiple_of(4), text, "use an offset that is a multiple of 4");
    let poses = BufferRange::new(host.buffer(), offset, end - offset);
    poses.check_room(device, &format!("the poses of {} instances of mesh '{}'", desc.instances, layout.name))?;
    // Descriptors start at an aligned offset; kernels add the rest.
    let lead = offset % ALIGNMENT;
    Ok(Poses {
        buffer: host.buffer(),
        usage: vk::BufferUsageFlags::empty(),
        begin: offset - lead,
        lead,
        format,
        places: host.vertex().places(layout, format),
        bytes,
        instances: desc.instances,
        slots: desc.update.slots,
        grid: desc.update.grid(layout)?,
    })
}

/// Bytes of device memory for the poses of a crowd in the groups of a mesh.
pub(super) fn bytes<'a>(mut groups: impl Iterator<Item = &'a PackedLayout>, desc: &CrowdDesc) -> u64 {
    match &desc.poses {
        // All groups share the host's vertices.
        Some(host) => groups.next().map_or(0, |layout| host.vertex().pose_bytes(layout).saturating_mul(count(desc))),
        None => groups.map(|layout| bytes_of(layout, desc)).sum(),
    }
}

/// Bytes of an engine-owned pose buffer. On a direct path one pose, for captures.
fn bytes_of(layout: &PackedLayout, desc: &CrowdDesc) -> u64 {
    let pose = layout.pose_bytes(desc.update.pose);
    if desc.update.path.evaluates_in_draws() { pose } else { pose.saturating_mul(count(desc)) }
}

fn count(desc: &CrowdDesc) -> u64 {
    u64::from(desc.instances) * u64::from(desc.update.slots)
}
