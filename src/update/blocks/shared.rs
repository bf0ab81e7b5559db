//! What lists on the host and lists on the GPU have in common: buffers, sizes, push constants.

use super::tiles::TILE;
use crate::abi::push::BlocksPush;
use crate::abi::worklist::POSES_MAX;
use crate::error::Result;
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::deltas_bytes;
use crate::pack::PackedLayout;
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::update::technique::{Context, Poses};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// How kernels load a work list: from a storage buffer, or as texels.
pub(crate) const LIST_USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw() | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER.as_raw(),
);

/// The integer sums of `instances`, one set for all poses of each: stored as a storage buffer, loaded as one or as texels.
pub(crate) fn sums_buffer(device: &Arc<Device>, poses: &Poses, instances: u32) -> Result<Buffer> {
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER
        | vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER
        | vk::BufferUsageFlags::TRANSFER_SRC;
    let (name, bytes) = ("deltamorph integer sums", poses.bytes * u64::from(instances));
    Buffer::new(device, name, bytes, usage, MemoryLocation::GpuOnly)
}

/// Instances that one descriptor set reaches, where other limits allow `most`: as far as the storage range and the
/// names of poses go, whole tiles where there is more than one group.
///
/// # Errors
/// Not even one.
pub(crate) fn group_size(context: &Context<'_>, most: u64) -> Result<u32> {
    let (poses, range) = (context.poses, context.caps().max_storage_range);
    let each = poses.offset(1, 0);
    context.check_range("the slots of one instance", each, "use fewer slots, or split the mesh")?;
    let instances = context.desc.instances;
    Ok(match (range / each).min(POSES_MAX / u64::from(poses.slots)).min(most).min(instances.into()) as u32 {
        size if size < instances && size > TILE as u32 => size - size % TILE as u32,
        size => size,
    })
}

/// The push constants of a mesh and its poses.
pub(crate) fn blocks_push(
    layout: &PackedLayout,
    index: &BlockIndex,
    slots: u32,
    exact: Option<ExactGrid>,
) -> BlocksPush {
    let step = exact.map_or(1.0, |grid| grid.weight_step());
    let ([position, normal], base) = (index.steps(), layout.base_bytes());
    BlocksPush {
        first_item: 0,
        elements_at: 0,
        deltas_at: index.deltas_at() as u32,
        base_at: ((deltas_bytes(layout) - base) / 4) as u32,
        pose_floats: (base / 4) as u32,
        slots,
        position_unit: position * step,
        normal_unit: normal * step,
    }
}
