//! The blocks of a group on a device, whoever plans them: kernels with a workgroup for each item of the work list or for
//! each tile, integer sums, descriptor sets and push constants.

use super::dispatch::Dispatching;
use crate::abi::modules::{BLOCKS, BLOCKS_EXACT, CROWD, CROWD_EXACT, CROWD_EXACT_TEXELS, CROWD_TEXELS, Module};
use crate::abi::numbers::ROWS;
use crate::abi::push::BlocksPush;
use crate::abi::worklist::{POSES_MAX, TILE, WIDTHS};
use crate::error::Result;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::deltas_bytes;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines, Workgroups};
use crate::pack::blocks::ExactGrid;
use crate::plan::Accumulate;
use crate::update::technique::{Context, Poses};
use ash::vk;
use bytemuck::bytes_of;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// How kernels load a work list: from a storage buffer, or as texels.
pub(crate) const LIST_USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw() | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER.as_raw(),
);

/// Instances that one descriptor set reaches, where other limits allow `most`: as far as the storage range and the
/// names of poses go, whole tiles where there is more than one set.
///
/// # Errors
/// Not even one.
pub(crate) fn set_size(context: &Context<'_>, most: u64) -> Result<u32> {
    let (poses, range) = (context.poses, context.caps().max_storage_range);
    let each = poses.offset(1, 0);
    context.check_range("the slots of one instance", each, "use fewer slots, or split the mesh")?;
    let instances = context.desc.instances;
    Ok(match (range / each).min(POSES_MAX / u64::from(poses.slots)).min(most).min(instances.into()) as u32 {
        size if size < instances && size > TILE as u32 => size - size % TILE as u32,
        size => size,
    })
}

/// The pipeline of a module for blocks of one size, or two where tiles that start from the base pose have their own.
#[derive(Clone, Copy, PartialEq)]
struct BlocksKey {
    module: &'static Module,
    /// Vertices of a block.
    size: u32,
    /// Invocations of a workgroup.
    lanes: u32,
    width: u32,
}

impl PipelineKey for BlocksKey {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self { module, size, lanes, width } = self;
        objects.add_layout(&[module.kernel], 0)?;
        let constants = [0, 1].map(|rebuilt| [lanes, size, 1 << width, if width > 0 { ROWS } else { 1 }, rebuilt]);
        let constants = constants.each_ref().map(|constants| &constants[..module.kernel.constants as usize]);
        // Where nothing tells the two apart, they are one.
        let count = if constants[0] == constants[1] { 1 } else { 2 };
        objects.add_compute(module, &constants[..count])
    }
}

/// The kernels of a crowd, one for items of single instances, or for each width of tiles one.
pub(crate) struct BlocksKernels {
    pub(super) how: Dispatching,
    /// Of exact sums.
    grid: Option<ExactGrid>,
    kernels: Vec<Arc<Pipelines<BlocksKey>>>,
}

impl BlocksKernels {
    /// Of crowds of `instances` of a mesh, of which a descriptor set reaches `group`.
    ///
    /// # Errors
    /// There is no kernel for its format and kind of sums; those of Vulkan.
    pub(crate) fn new(context: &Context<'_>, instances: u32, group: u32) -> Result<Self> {
        let (index, update) = (context.layout().index()?, context.desc.update);
        let exact = update.accumulate == Accumulate::Exact;
        let grid = if exact { Some(index.exact()?) } else { None };
        let (format, caps) = (context.layout().format, context.caps());
        // Tiles have a row at least, of some entry.
        let entries = index.entry_count() > 0;
        let texels = entries && caps.takes_texels(format);
        let tiles = texels || (entries && instances > 1);
        let kernel = match (tiles, texels, exact) {
            (false, _, false) => &BLOCKS,
            (false, _, true) => &BLOCKS_EXACT,
            (true, false, false) => &CROWD,
            (true, false, true) => &CROWD_EXACT,
            (true, true, false) => &CROWD_TEXELS,
            (true, true, true) => &CROWD_EXACT_TEXELS,
        };
        let widths = if tiles { instances.clamp(1, caps.tuning.widest_tile).ilog2() + 1 } else { 0 };
        let (module, size) = (kernel.module(format, update.pose, 0)?, index.size() as u32);
        // With texels, an invocation takes eight vertices.
        let lanes = if texels { size / 8 } else { size };
        let kernel = |width| context.kernels.get(BlocksKey { module, size, lanes, width });
        let how = Dispatching { group, widths, tuning: caps.tuning, most: caps.max_workgroups, texels };
        Ok(Self { how, grid, kernels: (0..widths.max(1)).map(kernel).collect::<Result<_>>()? })
    }
}

/// The blocks of a group.
pub(crate) struct GroupBlocks {
    pub(crate) how: Dispatching,
    kernels: Vec<Arc<Pipelines<BlocksKey>>>,
    pub(super) poses: Poses,
    /// One set of sums for all poses of an instance: stored as a storage buffer, loaded as one or as texels.
    sums: Option<Buffer>,
    /// One for each work list.
    sets: Sets,
    push: BlocksPush,
}

impl GroupBlocks {
    /// `lists`: the work lists, each of so many instances from the first on. `elements_at`: where elements or rows begin
    /// in them, in words.
    pub(crate) fn new(
        context: &Context<'_>,
        BlocksKernels { how, grid, kernels }: BlocksKernels,
        lists: &[(BufferRange, u32, u32)],
        elements_at: usize,
    ) -> Result<Self> {
        use vk::BufferUsageFlags as U;
        let (layout, poses, index) = (context.layout(), context.poses, context.layout().index()?);
        let usage = U::STORAGE_BUFFER | U::STORAGE_TEXEL_BUFFER | U::TRANSFER_SRC;
        let (name, bytes) = ("deltamorph integer sums", poses.bytes * u64::from(context.desc.instances));
        let sums =
            grid.map(|_| Buffer::new(context.device, name, bytes, usage, MemoryLocation::GpuOnly)).transpose()?;
        let step = grid.map_or(1.0, |grid| grid.weight_step());
        let ([position, normal], base) = (index.steps(), layout.base_bytes());
        let push = BlocksPush {
            first_item: 0,
            elements_at: elements_at as u32,
            deltas_at: index.deltas_at as u32,
            base_at: ((deltas_bytes(layout) - base) / 4) as u32,
            pose_floats: (base / 4) as u32,
            slots: poses.slots,
            position_unit: position * step,
            normal_unit: normal * step,
        };
        let asset = BufferRange { buffer: context.mesh.deltas.raw, offset: 0, size: deltas_bytes(layout) };
        let bound = |&(list, first, count): &(BufferRange, u32, u32)| {
            // As texels, poses and sums are bound twice.
            let times = if how.texels { 2 } else { 1 };
            let sums = sums.as_ref().map(|sums| poses.sums(sums.raw).range(first, count));
            let written = [poses.range(first, count)].into_iter().chain(sums);
            let written = written.flat_map(|range| std::iter::repeat_n(range, times));
            [asset, list].into_iter().chain(written).collect::<Vec<_>>()
        };
        let bound: Vec<_> = lists.iter().map(bound).collect();
        let sets = kernels[0].objects.sets(&bound)?;
        Ok(Self { how, kernels, poses, sums, sets, push })
    }

    /// Record a dispatch of kernel number `kernel` (a width, or from [`WIDTHS`] on, a width for tiles that start from the
    /// base pose) for the work list of this number, from the word `first_item` on.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - The group, its mesh and its poses live until the dispatch has run; the list is complete by then, and names
    ///   blocks, entries and slots that there are.
    /// - There are no more workgroups than the device allows.
    pub(crate) unsafe fn dispatch(
        &self,
        cmd: vk::CommandBuffer,
        list: usize,
        kernel: u32,
        first_item: u32,
        workgroups: Workgroups,
    ) {
        let (kernel, rebuilt) = (kernel as usize % WIDTHS, kernel as usize / WIDTHS);
        let (push, set) = (BlocksPush { first_item, ..self.push }, self.sets.get(list));
        // SAFETY: the caller's obligations; the layout of the set is the same for all kernels of a module, and the push
        // constants fill its range.
        unsafe { self.kernels[kernel].objects.dispatch(cmd, rebuilt, (set, &[]), bytes_of(&push), workgroups) };
    }

    /// Buffer and offset of the sums of an instance.
    #[cfg_attr(not(feature = "headless"), allow(dead_code, reason = "read back by headless alone"))]
    pub(crate) fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        self.sums.as_ref().map(|sums| (sums.raw, self.poses.sums(sums.raw).offset(instance, 0)))
    }
}
