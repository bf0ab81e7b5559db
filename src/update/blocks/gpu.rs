//! The kernels of blocks: a workgroup for each item of the work list, or for each tile.

use super::dispatch::Dispatching;
use super::tiles::WIDTHS;
use crate::abi::modules::{BLOCKS, BLOCKS_EXACT, CROWD, CROWD_EXACT, CROWD_EXACT_TEXELS, CROWD_TEXELS, Module};
use crate::abi::numbers::ROWS;
use crate::abi::push::BlocksPush;
use crate::error::Result;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::kernels::Kernel;
use crate::gpu::memory::Buffer;
use crate::gpu::mesh::deltas_bytes;
use crate::gpu::pipelines::Objects;
use crate::pack::blocks::BlockIndex;
use crate::update::technique::Context;
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// The kernels of a crowd, one for items of single instances, or for each width of tiles one.
pub(crate) struct BlocksKernels {
    /// Widths of tiles: 1, 2, 4, … instances; 0: the kernel takes items of single instances, with masks.
    widths: u32,
    /// Whether asset and list are read as texels.
    texels: bool,
    kernels: Vec<Arc<BlocksKernel>>,
}

/// The pipeline of a module for blocks of one size, or two where tiles that start from the base pose have their own.
struct BlocksKernel {
    objects: Objects,
    key: BlocksKey,
}

#[derive(Clone, Copy, PartialEq)]
struct BlocksKey {
    module: &'static Module,
    /// Vertices of a block.
    size: u32,
    /// Invocations of a workgroup.
    lanes: u32,
    width: u32,
}

impl Kernel for BlocksKernel {
    type Key = BlocksKey;

    fn new(device: &Arc<Device>, key: BlocksKey) -> Result<Self> {
        let BlocksKey { module, size, lanes, width } = key;
        let mut objects = Objects::none(device);
        objects.add_layout(&[module.kernel], 0)?;
        let constants = [0, 1].map(|rebuilt| [lanes, size, 1 << width, if width > 0 { ROWS } else { 1 }, rebuilt]);
        let constants = constants.each_ref().map(|constants| &constants[..module.kernel.constants as usize]);
        // Where nothing tells the two apart, they are one.
        let count = if constants[0] == constants[1] { 1 } else { 2 };
        objects.add_compute(module, &constants[..count])?;
        Ok(Self { objects, key })
    }

    fn key(&self) -> BlocksKey {
        self.key
    }
}

impl BlocksKernels {
    /// Of crowds of `instances` of a mesh.
    ///
    /// # Errors
    /// There is no kernel for its format and kind of sums; those of Vulkan.
    pub(crate) fn new(context: &Context<'_>, index: &BlockIndex, exact: bool, instances: u32) -> Result<Self> {
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
        let (module, size) = (kernel.module(format, context.desc.update.pose, 0)?, index.size() as u32);
        // With texels, an invocation takes eight vertices.
        let lanes = if texels { size / 8 } else { size };
        let kernel = |width| context.kernels.get(BlocksKey { module, size, lanes, width });
        Ok(Self { widths, texels, kernels: (0..widths.max(1)).map(kernel).collect::<Result<_>>()? })
    }

    /// How they carry work lists out, with descriptor sets that reach `group` instances.
    pub(crate) fn dispatching(&self, group: u32) -> Dispatching {
        let caps = &self.kernels[0].objects.device.caps;
        let (widths, texels) = (self.widths, self.texels);
        Dispatching { group, widths, tuning: caps.tuning, most: caps.max_workgroups, texels }
    }

    /// Record a dispatch of kernel number `kernel`: of a width, or from [`WIDTHS`] on, of a width for tiles that start
    /// from the base pose; of so many workgroups, or of as many as these arguments will say.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - `set` was made by [`sets`](Self::sets) and lives until the dispatch has run; the list in its second buffer is
    ///   complete by then, and names blocks, entries and slots that its buffers have.
    /// - There are no more workgroups than the device allows.
    pub(crate) unsafe fn dispatch(
        &self,
        cmd: vk::CommandBuffer,
        set: vk::DescriptorSet,
        kernel: u32,
        push: &BlocksPush,
        workgroups: Workgroups,
    ) {
        let (kernel, rebuilt) = (kernel as usize % WIDTHS, kernel as usize / WIDTHS);
        let Objects { device, layout, pipelines, .. } = &self.kernels[kernel].objects;
        let (device, point) = (&device.raw, vk::PipelineBindPoint::COMPUTE);
        // SAFETY: the caller's obligations; the push constants fill the layout's range; the set's layout is the same for
        // all kernels of a module.
        unsafe {
            device.cmd_bind_descriptor_sets(cmd, point, *layout, 0, &[set], &[]);
            device.cmd_bind_pipeline(cmd, point, pipelines[rebuilt]);
            device.cmd_push_constants(cmd, *layout, vk::ShaderStageFlags::COMPUTE, 0, bytes_of(push));
            match workgroups {
                Workgroups::Of(count) => device.cmd_dispatch(cmd, count, 1, 1),
                Workgroups::At(arguments, offset) => device.cmd_dispatch_indirect(cmd, arguments, offset),
            }
        }
    }

    /// A descriptor set for each work list, which is of so many instances from the first on.
    pub(crate) fn sets(
        &self,
        context: &Context<'_>,
        sums: Option<&Buffer>,
        lists: &[(BufferRange, u32, u32)],
    ) -> Result<Sets> {
        let poses = context.poses;
        let asset = BufferRange { buffer: context.mesh.deltas.raw, offset: 0, size: deltas_bytes(context.layout()) };
        let bound = |&(list, first, count): &(BufferRange, u32, u32)| {
            // As texels, poses and sums are bound twice.
            let times = if self.texels { 2 } else { 1 };
            let sums = sums.map(|sums| poses.sums(sums.raw).range(first, count));
            let written = [poses.range(first, count)].into_iter().chain(sums);
            let written = written.flat_map(|range| std::iter::repeat_n(range, times));
            [asset, list].into_iter().chain(written).collect::<Vec<_>>()
        };
        self.kernels[0].objects.sets(&lists.iter().map(bound).collect::<Vec<_>>())
    }
}

/// Workgroups of a dispatch.
#[derive(Clone, Copy)]
pub(crate) enum Workgroups {
    /// So many.
    Of(u32),
    /// As many as the arguments at this offset say when it runs.
    At(vk::Buffer, u64),
}
