//! The `blocks` path: a workgroup for each item of the work list, or for each tile.

use super::barriers;
use super::descriptors::{Bound, BufferRange, Sets};
use super::device::Device;
use super::pipelines::Objects;
use super::shaders::BlocksPush;
use crate::error::Result;
use crate::pack::DeltaFormat;
use crate::plan::blocks::ROWS;
use crate::plan::commands::Hazard;
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// What a pipeline is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BlocksVariant {
    pub(crate) format: DeltaFormat,
    pub(crate) exact: bool,
    /// Vertices of a block.
    pub(crate) size: u32,
    /// Widths of tiles that there are (`crowd.comp`); 0: single instances, with masks (`blocks.comp`).
    pub(crate) widths: u32,
    /// Asset and list are read as texels (tiles of `fast`).
    pub(crate) texels: bool,
}

impl BlocksVariant {
    /// Asset, work list, poses; integer sums last, where sums are exact. As texels, poses and sums are bound twice: to be
    /// stored, and to be loaded.
    fn bindings(self) -> Vec<vk::DescriptorType> {
        use vk::DescriptorType as T;
        let (loaded, state): (T, &[T]) = match self.texels {
            true => (T::UNIFORM_TEXEL_BUFFER, &[T::STORAGE_BUFFER, T::STORAGE_TEXEL_BUFFER]),
            false => (T::STORAGE_BUFFER, &[T::STORAGE_BUFFER]),
        };
        [loaded; 2].iter().chain(state).chain(state.iter().filter(|_| self.exact)).copied().collect()
    }
}

/// The pipeline of a variant; where it is [tiled](Self::is_tiled), one for each width, and for rebuilt tiles apart.
pub(crate) struct BlocksKernel {
    pub(crate) objects: Objects,
    variant: BlocksVariant,
}

impl BlocksKernel {
    pub(crate) fn new(device: &Arc<Device>, variant: BlocksVariant) -> Result<Self> {
        let BlocksVariant { format, exact, size, widths, texels } = variant;
        let mut objects = Objects::none(device);
        objects.add_storage_set_layout(&variant.bindings())?;
        objects.add_layout(vk::ShaderStageFlags::COMPUTE, size_of::<BlocksPush>() as u32)?;
        let name = super::shaders::blocks_module(if widths > 0 { "crowd" } else { "blocks" }, format, exact, texels);
        // With texels, a lane has eight vertices.
        let lanes = if texels { size / 8 } else { size };
        if widths == 0 {
            objects.add_compute(&name, &[lanes, size])?;
        }
        for rebuilt in 0..if exact { 1 } else { 2 } {
            for width in 0..widths {
                let constants = [lanes, size, 1 << width, if width > 0 { ROWS } else { 1 }, rebuilt];
                objects.add_compute(&name, &constants[..if exact { 4 } else { 5 }])?;
            }
        }
        Ok(Self { objects, variant })
    }

    /// Whether it takes tiles: whole blocks of several instances.
    pub(crate) fn is_tiled(&self) -> bool {
        self.variant.widths > 0
    }

    pub(crate) fn serves(&self, variant: BlocksVariant) -> bool {
        self.variant == variant
    }

    /// Record items of a work list.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - `set` was made by [`sets`](Self::sets) and lives until the dispatches have run; the list in its second buffer is
    ///   complete by then, and names blocks, entries and slots that its buffers have.
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
                device.cmd_bind_pipeline(cmd, bind, self.objects.pipelines[*pipeline]);
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

    /// Part a dispatch from the one before of the same set. They write different blocks, and a storage buffer in common tells
    /// synchronization validation as much; as texels, poses are loaded through one descriptor and stored through another,
    /// for which a barrier is asked. Software drivers, the only ones, run one dispatch after the other anyway.
    ///
    /// # Safety
    /// As [`record`](Self::record).
    unsafe fn part(&self, cmd: vk::CommandBuffer) {
        if self.variant.texels {
            // SAFETY: the caller's obligations.
            unsafe { barriers::record(&self.objects.device.raw, cmd, Hazard::ComputeWriteToComputeUpdate) };
        }
    }

    /// Widths of tiles that there are.
    pub(crate) fn widths(&self) -> usize {
        self.variant.widths as usize
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
        let (point, pipeline) = (vk::PipelineBindPoint::COMPUTE, self.objects.pipelines[self.pipeline_of(0, width)]);
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
        let bindings = self.variant.bindings();
        let bound = |group: &GroupBuffers| {
            // As texels, poses and sums are bound twice.
            let times = if self.variant.texels { 2 } else { 1 };
            let lists = [group.asset, group.list].map(|range| (range, F::R32G32B32A32_UINT));
            let poses = std::iter::repeat_n((group.poses, F::R32G32B32A32_SFLOAT), times);
            let sums = group.sums.into_iter().flat_map(|sums| std::iter::repeat_n((sums, F::R32G32B32A32_SINT), times));
            let ranges = lists.into_iter().chain(poses).chain(sums);
            ranges.zip(&bindings).map(|((range, format), &ty)| Bound::typed(ty, range, format)).collect()
        };
        let bound: Vec<Vec<Bound>> = groups.iter().map(bound).collect();
        Sets::new(&self.objects.device, self.objects.set_layout, &bound)
    }

    /// Which pipeline takes tiles of 2^width instances that start from the base pose (`apart`) or do not.
    pub(crate) fn pipeline_of(&self, apart: usize, width: usize) -> usize {
        apart * self.variant.widths as usize + width
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
