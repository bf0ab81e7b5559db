//! Memory of poses: engine-owned buffers, one per group of the mesh, or one buffer of the host.

use super::upload::GpuMesh;
use crate::error::{Result, ensure};
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::statistics::MemoryKind;
use crate::pack::PackedLayout;
use crate::pack::vertex::VertexOffsets;
use crate::plan::UpdateDesc;
use crate::update::crowd::{CrowdDesc, HostPoses};
use crate::update::technique::{PoseGroup, Poses};
use ash::vk::{self, BufferUsageFlags};
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
    let mut usage = BufferUsageFlags::STORAGE_BUFFER
        | BufferUsageFlags::VERTEX_BUFFER
        | BufferUsageFlags::STORAGE_TEXEL_BUFFER
        | BufferUsageFlags::TRANSFER_SRC
        | desc.pose_usage;
    if device.feedback.is_some() {
        usage |= BufferUsageFlags::TRANSFORM_FEEDBACK_BUFFER_EXT;
    }
    let buffer = Buffer::new(device, "deltamorph poses", bytes_of(layout, desc), usage, MemoryKind::Poses)?;
    let pose = (VertexOffsets::TIGHT, layout.pose_bytes(desc.update.pose));
    Ok((poses_from(buffer.raw, 0, pose, layout, desc, usage)?, buffer))
}

/// Poses of these offsets and bytes each, from a byte of a buffer on.
fn poses_from(
    buffer: vk::Buffer,
    offset: u64,
    (offsets, bytes): (VertexOffsets, u64),
    layout: &PackedLayout,
    desc: &CrowdDesc,
    usage: BufferUsageFlags,
) -> Result<Poses> {
    // Descriptors start at an aligned offset; kernels add the rest.
    let lead = offset % ALIGNMENT;
    let CrowdDesc { instances, update, .. } = *desc;
    let UpdateDesc { pose: format, slots, .. } = update;
    let grid = update.grid(layout)?;
    Ok(Poses { buffer, usage, begin: offset - lead, lead, format, offsets, bytes, instances, slots, grid })
}

fn poses_of_host(device: &Device, host: &HostPoses, layout: &PackedLayout, desc: &CrowdDesc) -> Result<Poses> {
    let offset = host.offset();
    let bytes = host.vertex().pose_bytes(layout);
    let end = offset.saturating_add(bytes.saturating_mul(count(desc)));
    let what = format!("poses of mesh '{}' from byte {offset} on in the host's buffer end at", layout.name);
    device.caps.check_limit(&what, (end, "bytes", device.caps.max_buffer), "use fewer instances or slots")?;
    let text = format!("poses from byte {offset} on in the host's buffer");
    ensure!(offset.is_multiple_of(4), text, "use an offset that is a multiple of 4");
    let poses = BufferRange::new(host.buffer(), offset, end - offset);
    poses.check_room(device, &format!("the poses of {} instances of mesh '{}'", desc.instances, layout.name))?;
    let pose = (host.vertex().offsets(layout, desc.update.pose), bytes);
    poses_from(host.buffer(), offset, pose, layout, desc, BufferUsageFlags::empty())
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
