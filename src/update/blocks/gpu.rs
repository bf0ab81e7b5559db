//! The blocks of a group on a device, planned by host or GPU: kernels for the tiles of a work list, descriptor sets
//! and push constants.

use super::dispatch::Dispatching;
use crate::abi::modules::{CROWD, CROWD_TEXELS, Module};
use crate::abi::push::BlocksPush;
use crate::abi::worklist::{ITEMS_MAX, POSES_MAX, TILE, WIDTHS};
use crate::error::Result;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::{base_offset, deltas_bytes};
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines, Workgroups};
use crate::update::technique::{Context, Poses};
use ash::vk::{self, BufferUsageFlags};
use bytemuck::bytes_of;
use std::sync::Arc;

/// A work list is loaded from a storage buffer or as texels.
pub(crate) const LIST_USAGE: BufferUsageFlags = BufferUsageFlags::from_raw(
    BufferUsageFlags::STORAGE_BUFFER.as_raw() | BufferUsageFlags::UNIFORM_TEXEL_BUFFER.as_raw(),
);

/// Instances per descriptor set, at most `most`, limited by the storage range and the 16-bit pose numbers. Whole tiles,
/// if there are several sets.
///
/// # Errors
/// Not even one instance fits.
pub(crate) fn set_size(context: &Context<'_>, most: u64) -> Result<u32> {
    let poses = context.poses;
    let each = poses.range_bytes(1);
    context.check_range("the slots of one instance", each, "use fewer slots, or split the mesh")?;
    let instances = context.desc.instances;
    let in_range = context.caps().max_storage_range / each;
    let size = in_range.min(POSES_MAX / u64::from(poses.slots)).min(most).min(instances.into()) as u32;
    Ok(if size < instances && size > TILE as u32 { size - size % TILE as u32 } else { size })
}

pub(crate) struct Workgroup {
    /// Loads asset and work list as texels.
    texels: bool,
    lanes: u32,
    pub items: u32,
}

/// The workgroup of the kernels of a crowd.
///
/// # Errors
/// A mesh in a dense format.
pub(crate) fn workgroup(context: &Context<'_>) -> Result<Workgroup> {
    let size = context.layout().index()?.size() as u32;
    let caps = context.caps();
    let texels = caps.takes_texels(context.layout().format);
    let items = if texels { 1 } else { (caps.tuning.lanes / size).clamp(1, ITEMS_MAX) };
    // With texels, an invocation processes eight vertices, or four of a block of 32.
    Ok(Workgroup { texels, lanes: if texels { (size / 8).max(8) } else { size * items }, items })
}

/// Key of the two pipelines of a module, block size and width: for any tiles, and for those that start from the base
/// pose.
#[derive(Clone, Copy, PartialEq)]
struct BlocksKey {
    module: &'static Module,
    size: u32,
    lanes: u32,
    width: u32,
    few_registers: bool,
    /// Rounds sums, and not products.
    rounds_sums: bool,
}

impl PipelineKey for BlocksKey {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self { module, size, lanes, width, few_registers, rounds_sums } = self;
        objects.add_layout(&[module.kernel], 0)?;
        let sums = 2 * u32::from(rounds_sums);
        let own = [0, 1].map(|rebuilt| [lanes, size, 1 << width, rebuilt + sums, few_registers.into()]);
        let count = module.kernel.constants as usize;
        objects.add_compute(module, &own.each_ref().map(|own| &own[..count]))
    }
}

/// The kernels of a crowd, one per tile width.
pub(crate) struct BlocksKernels {
    pub(super) how: Dispatching,
    kernels: Vec<Arc<Pipelines<BlocksKey>>>,
}

impl BlocksKernels {
    /// Kernels for crowds of `instances`, of which a descriptor set reaches `group`.
    ///
    /// # Errors
    /// No kernel for the formats; Vulkan errors.
    pub fn new(context: &Context<'_>, instances: u32, group: u32) -> Result<Self> {
        let format = context.layout().format;
        let pose = context.desc.update.pose;
        let tuning = context.caps().tuning;
        let Workgroup { texels, lanes, items } = workgroup(context)?;
        let kernel = if texels { &CROWD_TEXELS } else { &CROWD };
        let widths = instances.clamp(1, tuning.widest_tile).ilog2() + 1;
        let module = kernel.module(format.row(), pose.row(), 0)?;
        let size = context.layout().index()?.size() as u32;
        let few_registers = tuning.few_registers;
        let rounds_sums = pose.row().rounds_sums;
        let key = |width| BlocksKey { module, size, lanes, width, few_registers, rounds_sums };
        let kernel = |width| context.kernels.get(key(width));
        let how = Dispatching { group, widths, tuning, most: context.caps().max_workgroups, items, texels };
        Ok(Self { how, kernels: (0..widths).map(kernel).collect::<Result<_>>()? })
    }
}

/// Contents of a descriptor set.
pub(crate) struct Bound {
    pub list: BufferRange,
    /// First instance, and count.
    pub instances: (u32, u32),
}

pub(crate) struct GroupBlocks {
    pub how: Dispatching,
    kernels: Vec<Arc<Pipelines<BlocksKey>>>,
    pub(super) poses: Poses,
    sets: Sets,
    push: BlocksPush,
    /// That of fixed-point poses: keeps the buffer of the sets alive.
    _base_pose: Option<Buffer>,
}

impl GroupBlocks {
    pub fn new(context: &Context<'_>, BlocksKernels { how, kernels }: BlocksKernels, bound: &[Bound]) -> Result<Self> {
        let poses = context.poses;
        let index = context.layout().index()?;
        let [position_unit, normal_unit] = index.steps();
        let asset = BufferRange::new(context.mesh.deltas.raw, 0, deltas_bytes(context.layout()));
        let base_pose = context.integer_base()?;
        let (base, base_at) = match &base_pose {
            None => (asset, (base_offset(context.layout()) / 4) as u32),
            Some(buffer) => {
                let bytes = context.layout().padded_vertices() * poses.format.base_stride();
                (BufferRange::new(buffer.raw, 0, bytes as u64), 0)
            }
        };
        let push = BlocksPush {
            first_item: 0,
            deltas_at: index.deltas_at as u32,
            base_at,
            pose_floats: poses.numbers(),
            position_unit,
            normal_unit,
            raised: poses.grid.map(|grid| grid.raised).unwrap_or_default(),
        };
        let ranges = |&Bound { list, instances: (first, count) }: &Bound| {
            // With texels, poses are bound twice, for stores and loads.
            let poses = std::iter::repeat_n(poses.range(first, count), if how.texels { 2 } else { 1 });
            [asset, list].into_iter().chain(poses).chain([base]).collect::<Vec<_>>()
        };
        let sets = kernels[0].objects.sets(&bound.iter().map(ranges).collect::<Vec<_>>())?;
        Ok(Self { how, kernels, poses, sets, push, _base_pose: base_pose })
    }

    /// Records a dispatch of kernel `kernel` (log2 width; plus [`WIDTHS`] for tiles that start from the base pose) with
    /// set `set`, for the items from word `first_item` of its work list on.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - The group, its mesh and its poses live until the dispatch has finished. The list is complete by then, and
    ///   names only existing slots, blocks and entries.
    /// - `workgroups` is within the device limit.
    pub unsafe fn dispatch(
        &self,
        cmd: vk::CommandBuffer,
        set: usize,
        kernel: usize,
        first_item: u32,
        workgroups: Workgroups,
    ) {
        let width = kernel % WIDTHS;
        let rebuilt = kernel / WIDTHS;
        let set = self.sets.get(set);
        let push = BlocksPush { first_item, ..self.push };
        // SAFETY: the caller's obligations; the layout of the set is the same for all kernels of a module, and the push
        // constants fill its range.
        unsafe { self.kernels[width].objects.dispatch(cmd, rebuilt, (set, &[]), bytes_of(&push), workgroups) };
    }
}
