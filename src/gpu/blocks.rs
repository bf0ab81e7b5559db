//! The `blocks` path: a workgroup for each item of the work list, or for each tile.

use super::barriers;
use super::descriptors::{Bound, BufferRange, Sets, descriptor_type};
use super::device::Device;
use super::pipelines::{Objects, Pipelines};
use crate::abi::choice::BlocksChoice;
use crate::abi::kernels::DeviceTuning;
use crate::abi::numbers::ROWS;
use crate::abi::push::BlocksPush;
use crate::error::Result;
use crate::plan::commands::Hazard;
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// The pipelines of a module for blocks of one size: one for items of single instances, or for each width of tiles one,
/// or two where tiles that start from the base pose have their own.
pub(crate) struct BlocksKernel {
    pub(crate) objects: Arc<Objects>,
    /// By width; kernels of other numbers of widths share them.
    pipelines: Vec<Arc<Pipelines>>,
    choice: BlocksChoice,
    /// Vertices of a block.
    size: u32,
}

impl BlocksKernel {
    /// `others` are the kernels made so far: what they have in common with this one is taken over.
    pub(crate) fn new<'a>(
        device: &Arc<Device>,
        choice: BlocksChoice,
        size: u32,
        others: impl Iterator<Item = &'a Self>,
    ) -> Result<Self> {
        let akin = |other: &&Self| std::ptr::eq(other.choice.module, choice.module) && other.size == size;
        let (objects, mut pipelines) = match others.filter(akin).max_by_key(|other| other.pipelines.len()) {
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
        Ok(Self { objects, pipelines, choice, size })
    }

    /// Whether it takes tiles: whole blocks of several instances.
    pub(crate) fn is_tiled(&self) -> bool {
        self.choice.widths > 0
    }

    /// What decides how wide tiles are.
    pub(crate) fn device(&self) -> DeviceTuning {
        self.choice.device
    }

    pub(crate) fn serves(&self, choice: &BlocksChoice, size: u32) -> bool {
        self.choice == *choice && self.size == size
    }

    /// A pipeline by its [number](Self::pipeline_of).
    fn pipeline(&self, number: usize) -> vk::Pipeline {
        self.pipelines[number % self.pipelines.len()][number / self.pipelines.len()]
    }

    /// Record items of a work list.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - `set` was made by [`sets`](Self::sets) and lives until the dispatches have run; the list in its second buffer
    ///   is complete by then, and names blocks, entries and slots that its buffers have.
    pub(crate) unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        set: vk::DescriptorSet,
        parts: &[BlocksDispatch],
        push: BlocksPush,
    ) {
        let device = &self.objects.device.raw;
        let most = self.objects.device.caps.max_workgroups as usize;
        let (bind, layout) = (vk::PipelineBindPoint::COMPUTE, self.objects.layout);
        // SAFETY: the caller's obligations.
        unsafe { device.cmd_bind_descriptor_sets(cmd, bind, layout, 0, &[set], &[]) };
        let mut begun = false;
        for BlocksDispatch { pipeline, items, first_word, item_words } in parts {
            // SAFETY: the caller's obligations; the push constants fill the layout's range; no dispatch has more
            // workgroups than the device allows.
            unsafe {
                device.cmd_bind_pipeline(cmd, bind, self.pipeline(*pipeline));
                for first in (0..*items).step_by(most) {
                    if std::mem::replace(&mut begun, true) {
                        self.part(cmd);
                    }
                    let push = BlocksPush { first_item: (first_word + first * item_words) as u32, ..push };
                    let groups = most.min(items - first) as u32;
                    device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::COMPUTE, 0, bytes_of(&push));
                    device.cmd_dispatch(cmd, groups, 1, 1);
                }
            }
        }
    }

    /// Part a dispatch from the one before of the same set. They write different blocks, and a storage buffer in common
    /// tells synchronization validation as much; as texels, poses are loaded through one descriptor and stored through
    /// another, for which a barrier is asked. Software drivers, the only ones, run one dispatch after the other anyway.
    ///
    /// # Safety
    /// As [`record`](Self::record).
    unsafe fn part(&self, cmd: vk::CommandBuffer) {
        if self.choice.texels() {
            // SAFETY: the caller's obligations.
            unsafe { barriers::record(&self.objects.device.raw, cmd, Hazard::ComputeWriteToComputeUpdate) };
        }
    }

    /// Widths of tiles that there are.
    pub(crate) fn widths(&self) -> usize {
        self.choice.widths as usize
    }

    /// Bind a set for [`dispatch_indirect`](Self::dispatch_indirect).
    ///
    /// # Safety
    /// As [`record`](Self::record), but that the list is complete when the dispatches run.
    pub(crate) unsafe fn bind_indirect(&self, cmd: vk::CommandBuffer, set: vk::DescriptorSet) {
        let (device, layout) = (&self.objects.device.raw, self.objects.layout);
        // SAFETY: the caller's obligations.
        unsafe {
            device.cmd_bind_descriptor_sets(cmd, vk::PipelineBindPoint::COMPUTE, layout, 0, &[set], &[]);
        }
    }

    /// Dispatch as many tiles of 2^width instances, from `push.first_item` on, as `arguments` will say at `offset`.
    ///
    /// # Safety
    /// As [`bind_indirect`](Self::bind_indirect), which was called before; `arguments` holds them by then.
    pub(crate) unsafe fn dispatch_indirect(
        &self,
        cmd: vk::CommandBuffer,
        width: usize,
        push: BlocksPush,
        arguments: vk::Buffer,
        offset: u64,
    ) {
        let (device, layout) = (&self.objects.device.raw, self.objects.layout);
        let (point, pipeline) = (vk::PipelineBindPoint::COMPUTE, self.pipeline(self.pipeline_of(0, width)));
        // SAFETY: the caller's obligations; the push constants fill the layout's range.
        unsafe {
            self.part(cmd);
            device.cmd_bind_pipeline(cmd, point, pipeline);
            device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::COMPUTE, 0, bytes_of(&push));
            device.cmd_dispatch_indirect(cmd, arguments, offset);
        }
    }

    /// A descriptor set for each group of instances.
    pub(crate) fn sets(&self, groups: &[GroupBuffers]) -> Result<Sets> {
        use vk::Format as F;
        let bindings = self.choice.module.kernel.bindings;
        let bound = |group: &GroupBuffers| {
            // As texels, poses and sums are bound twice.
            let times = if self.choice.texels() { 2 } else { 1 };
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

    /// Which pipeline takes tiles of 2^width instances that start from the base pose (`apart`) or do not.
    pub(crate) fn pipeline_of(&self, apart: usize, width: usize) -> usize {
        apart * self.choice.widths as usize + width
    }
}

/// Items that go into one dispatch, or more where the device allows only so many workgroups.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlocksDispatch {
    pub(crate) pipeline: usize,
    pub(crate) items: usize,
    /// Index of the first item's first word in the list.
    pub(crate) first_word: usize,
    pub(crate) item_words: usize,
}

/// The buffers of one group of instances.
pub(crate) struct GroupBuffers {
    pub(crate) asset: BufferRange,
    /// The list of one frame.
    pub(crate) list: BufferRange,
    pub(crate) poses: BufferRange,
    pub(crate) sums: Option<BufferRange>,
}
