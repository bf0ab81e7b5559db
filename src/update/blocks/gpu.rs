//! The kernels of blocks: a workgroup for each item of the work list, or for each tile.

use super::plan::Dispatching;
use crate::abi::choice::{BlocksCase, BlocksChoice};
use crate::abi::numbers::ROWS;
use crate::abi::push::BlocksPush;
use crate::error::Result;
use crate::gpu::descriptors::{Bound, BufferRange, Sets, descriptor_type};
use crate::gpu::device::Device;
use crate::gpu::kernels::Kernel;
use crate::gpu::pipelines::{Objects, Pipelines};
use crate::pack::blocks::BlockIndex;
use crate::update::technique::Context;
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// What pipelines are made for.
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct BlocksKey {
    choice: BlocksChoice,
    /// Vertices of a block.
    size: u32,
}

impl BlocksKey {
    /// Of crowds of `instances` of a mesh.
    ///
    /// # Errors
    /// There is no kernel for its format and kind of sums.
    pub(crate) fn new(context: &Context<'_>, index: &BlockIndex, exact: bool, instances: u32) -> Result<Self> {
        let (format, pose, entries) = (context.layout().format, context.desc.update.pose, index.entry_count() > 0);
        let (device, texels) = (context.caps().tuning, context.caps().takes_texels(format));
        let case = BlocksCase { format, pose, exact, instances, entries, device, texels };
        Ok(Self { choice: case.choose()?, size: index.size() as u32 })
    }
}

/// The pipelines of a module for blocks of one size: one for items of single instances, or for each width of tiles one,
/// or two where tiles that start from the base pose have their own.
pub(crate) struct BlocksKernel {
    objects: Arc<Objects>,
    /// By width; kernels of other numbers of widths share them.
    pipelines: Vec<Arc<Pipelines>>,
    key: BlocksKey,
}

impl Kernel for BlocksKernel {
    type Key = BlocksKey;

    fn new(device: &Arc<Device>, key: BlocksKey, others: &[Arc<Self>]) -> Result<Self> {
        let BlocksKey { choice, size } = key;
        let akin = |other: &&Arc<Self>| std::ptr::eq(other.key.choice.module, choice.module) && other.key.size == size;
        let (objects, mut pipelines) = match others.iter().filter(akin).max_by_key(|other| other.pipelines.len()) {
            Some(other) => (other.objects.clone(), other.pipelines.clone()),
            None => {
                let mut objects = Objects::none(device);
                objects.add_layout(&[choice.module.kernel], 0)?;
                (Arc::new(objects), vec![])
            }
        };
        let lanes = size / choice.lane_vertices();
        if choice.widths == 0 && pipelines.is_empty() {
            pipelines.push(Arc::new(objects.compute_pipelines(choice.module, &[&[lanes, size]])?));
        }
        let constants = |width: u32| {
            let rows = if width > 0 { ROWS } else { 1 };
            let all = (0..2).map(move |rebuilt| [lanes, size, 1 << width, rows, rebuilt]);
            all.take(choice.pipelines_of_a_width() as usize)
        };
        pipelines.truncate(choice.widths.max(1) as usize);
        let missing: Vec<[u32; 5]> = (pipelines.len() as u32..choice.widths).flat_map(constants).collect();
        let used = choice.module.kernel.constants as usize;
        let missing: Vec<&[u32]> = missing.iter().map(|constants| &constants[..used]).collect();
        if !missing.is_empty() {
            let made = objects.compute_pipelines(choice.module, &missing)?;
            pipelines.extend(made.split(choice.pipelines_of_a_width() as usize).map(Arc::new));
        }
        Ok(Self { objects, pipelines, key })
    }

    fn key(&self) -> BlocksKey {
        self.key
    }
}

impl BlocksKernel {
    /// How it carries work lists out, with descriptor sets that reach `group` instances.
    pub(crate) fn dispatching(&self, group: u32) -> Dispatching {
        let choice = self.key.choice;
        let most = self.objects.device.caps.max_workgroups;
        Dispatching { group, widths: choice.widths, tuning: choice.device, most, texels: choice.texels() }
    }

    /// A pipeline by its number: those of all widths, then those for tiles that start from the base pose.
    fn pipeline(&self, number: u32) -> vk::Pipeline {
        let (number, widths) = (number as usize, self.pipelines.len());
        self.pipelines[number % widths][number / widths]
    }

    /// Record a dispatch of pipeline `kernel`: of so many workgroups, or of as many as these arguments will say.
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
        let (device, layout) = (&self.objects.device.raw, self.objects.layout);
        let (point, pipeline) = (vk::PipelineBindPoint::COMPUTE, self.pipeline(kernel));
        // SAFETY: the caller's obligations; the push constants fill the layout's range.
        unsafe {
            device.cmd_bind_descriptor_sets(cmd, point, layout, 0, &[set], &[]);
            device.cmd_bind_pipeline(cmd, point, pipeline);
            device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::COMPUTE, 0, bytes_of(push));
            match workgroups {
                Workgroups::Of(count) => device.cmd_dispatch(cmd, count, 1, 1),
                Workgroups::At(arguments, offset) => device.cmd_dispatch_indirect(cmd, arguments, offset),
            }
        }
    }

    /// A descriptor set for each group of instances.
    pub(crate) fn sets(&self, groups: &[GroupBuffers]) -> Result<Sets> {
        use vk::Format as F;
        let bindings = self.key.choice.module.kernel.bindings;
        let bound = |group: &GroupBuffers| {
            // As texels, poses and sums are bound twice.
            let times = if self.key.choice.texels() { 2 } else { 1 };
            let lists = [group.asset, group.list].map(|range| (range, F::R32G32B32A32_UINT));
            let poses = std::iter::repeat_n((group.poses, F::R32G32B32A32_SFLOAT), times);
            let sums = group.sums.into_iter().flat_map(|sums| std::iter::repeat_n((sums, F::R32G32B32A32_SINT), times));
            let ranges = lists.into_iter().chain(poses).chain(sums);
            let typed = |((range, format), (_, buffer))| Bound::typed(descriptor_type(buffer), range, format);
            ranges.zip(bindings.iter().copied()).map(typed).collect()
        };
        let bound: Vec<Vec<Bound>> = groups.iter().map(bound).collect();
        Sets::new(&self.objects.device, self.objects.set_layout, &bound)
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

/// The buffers of one group of instances.
pub(crate) struct GroupBuffers {
    pub(crate) asset: BufferRange,
    /// The list of one frame.
    pub(crate) list: BufferRange,
    pub(crate) poses: BufferRange,
    pub(crate) sums: Option<BufferRange>,
}
