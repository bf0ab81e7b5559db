//! The `blocks` path: one dispatch, a workgroup for each item of the work list.

use super::device::Device;
use super::failed;
use super::pipelines::Objects;
use super::shaders::BlocksPush;
use crate::error::Result;
use crate::mesh::packed::DeltaFormat;
use ash::vk;
use bytemuck::bytes_of;
use std::ops::Range;
use std::sync::Arc;

/// Storage buffers of the kernel: asset, work list, poses, integer sums (exact accumulation only).
const BINDINGS: [vk::DescriptorType; 4] = {
    use vk::DescriptorType as T;
    [T::STORAGE_BUFFER, T::STORAGE_BUFFER_DYNAMIC, T::STORAGE_BUFFER, T::STORAGE_BUFFER]
};

/// What a pipeline is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BlocksVariant {
    pub(crate) format: DeltaFormat,
    pub(crate) exact: bool,
    /// Vertices of a block.
    pub(crate) size: u32,
}

impl BlocksVariant {
    fn bindings(self) -> &'static [vk::DescriptorType] {
        if self.exact { &BINDINGS } else { &BINDINGS[..3] }
    }
}

/// The pipeline of a variant; where it is [straight](Self::is_straight), that of rebuilt items as well.
pub(crate) struct BlocksKernel {
    pub(crate) objects: Objects,
    variant: BlocksVariant,
}

impl BlocksKernel {
    pub(crate) fn new(device: &Arc<Device>, variant: BlocksVariant) -> Result<Self> {
        // Software drivers pay for every lane's loads: there, several vertices share those of an entry.
        let vertices = if variant.format == DeltaFormat::Fast && device.caps.is_software() { 4 } else { 1 };
        let mut objects = Objects::none(device);
        objects.add_storage_set_layout(variant.bindings())?;
        objects.add_layout(vk::ShaderStageFlags::COMPUTE, size_of::<BlocksPush>() as u32)?;
        let name = super::shaders::blocks_module(variant.format, variant.exact, vertices);
        let size = [variant.size / vertices, variant.size];
        if vertices == 4 && !variant.exact {
            for rebuilt in [0, 1] {
                objects.add_compute(&name, &[size[0], size[1], rebuilt])?;
            }
        } else {
            objects.add_compute(&name, &size)?;
        }
        Ok(Self { objects, variant })
    }

    /// Whether it loads and stores whole blocks, whatever the masks say, and takes rebuilt items in a dispatch of their
    /// own (see `blocks.comp`).
    pub(crate) fn is_straight(&self) -> bool {
        self.objects.pipelines.len() > 1
    }

    pub(crate) fn serves(&self, variant: BlocksVariant) -> bool {
        self.variant == variant
    }

    /// Record items of a work list of `item_words` words an item: `items`, then `rebuilt` ones.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - `set` was made by [`BlockSets`] for this kernel and lives until the dispatch has run; the list at `list` in
    ///   its second buffer is complete by then, and names blocks, entries and slots that its buffers have.
    pub(crate) unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        set: vk::DescriptorSet,
        list: u32,
        items: [Range<usize>; 2],
        item_words: usize,
        push: BlocksPush,
    ) {
        let device = &self.objects.device.raw;
        let most = self.objects.device.caps.max_workgroups as usize;
        let (bind, layout) = (vk::PipelineBindPoint::COMPUTE, self.objects.layout);
        let pipelines = &self.objects.pipelines;
        for (pipeline, items) in pipelines.iter().cycle().zip(items).filter(|(_, items)| !items.is_empty()) {
            // SAFETY: the caller's obligations; the push constants fill the layout's range; `list` is a multiple of the
            // device's offset alignment; no dispatch has more workgroups than the device allows.
            unsafe {
                device.cmd_bind_pipeline(cmd, bind, *pipeline);
                device.cmd_bind_descriptor_sets(cmd, bind, layout, 0, &[set], &[list]);
                for first in items.clone().step_by(most) {
                    let push = BlocksPush { first_item: (first * item_words) as u32, ..push };
                    let groups = most.min(items.end - first) as u32;
                    device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::COMPUTE, 0, bytes_of(&push));
                    device.cmd_dispatch(cmd, groups, 1, 1);
                }
            }
        }
    }
}

/// A buffer and the bytes of it that a descriptor covers.
#[derive(Clone, Copy)]
pub(crate) struct BufferRange {
    pub(crate) buffer: vk::Buffer,
    pub(crate) offset: u64,
    pub(crate) size: u64,
}

/// The buffers of one group of instances.
pub(crate) struct GroupBuffers {
    pub(crate) asset: BufferRange,
    /// The list of one frame; others by dynamic offset.
    pub(crate) list: BufferRange,
    pub(crate) poses: BufferRange,
    pub(crate) sums: Option<BufferRange>,
}

/// A descriptor set for each group of instances.
pub(crate) struct BlockSets {
    device: Arc<Device>,
    pool: vk::DescriptorPool,
    sets: Vec<vk::DescriptorSet>,
}

impl BlockSets {
    pub(crate) fn new(kernel: &BlocksKernel, groups: &[GroupBuffers]) -> Result<Self> {
        let device = &kernel.objects.device;
        let count = groups.len() as u32;
        let sizes = [(vk::DescriptorType::STORAGE_BUFFER, 3), (vk::DescriptorType::STORAGE_BUFFER_DYNAMIC, 1)]
            .map(|(ty, each)| vk::DescriptorPoolSize { ty, descriptor_count: each * count });
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(count).pool_sizes(&sizes);
        // SAFETY: the device is alive.
        let pool =
            unsafe { device.raw.create_descriptor_pool(&info, None) }.map_err(failed("vkCreateDescriptorPool"))?;
        let mut sets = Self { device: device.clone(), pool, sets: vec![] };
        let layouts = vec![kernel.objects.set_layout; groups.len()];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: pool and layout are ours; the pool has room for as many.
        sets.sets =
            unsafe { device.raw.allocate_descriptor_sets(&info) }.map_err(failed("vkAllocateDescriptorSets"))?;
        for (group, set) in groups.iter().zip(&sets.sets) {
            let infos: Vec<[vk::DescriptorBufferInfo; 1]> = [group.asset, group.list, group.poses]
                .into_iter()
                .chain(group.sums)
                .map(|r| [vk::DescriptorBufferInfo { buffer: r.buffer, offset: r.offset, range: r.size }])
                .collect();
            let writes: Vec<_> = infos
                .iter()
                .zip(kernel.variant.bindings())
                .enumerate()
                .map(|(binding, (info, ty))| {
                    vk::WriteDescriptorSet::default()
                        .dst_set(*set)
                        .dst_binding(binding as u32)
                        .descriptor_type(*ty)
                        .buffer_info(info)
                })
                .collect();
            // SAFETY: the set is not in use yet; buffers and ranges are the crowd's and the mesh's own.
            unsafe { device.raw.update_descriptor_sets(&writes, &[]) };
        }
        Ok(sets)
    }

    pub(crate) fn get(&self, group: usize) -> vk::DescriptorSet {
        self.sets[group]
    }
}

impl Drop for BlockSets {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, with its sets, when the crowd is no longer in use by the device.
        unsafe { self.device.raw.destroy_descriptor_pool(self.pool, None) };
    }
}
