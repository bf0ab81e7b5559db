//! The `blocks` path: a workgroup for each item of the work list, or for each tile.

use super::caps::DeviceCaps;
use super::device::Device;
use super::failed;
use super::pipelines::Objects;
use super::shaders::BlocksPush;
use crate::error::Result;
use crate::mesh::packed::DeltaFormat;
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
    /// Poses and deltas are read as texels (tiles of `fast`).
    pub(crate) texels: bool,
}

impl BlocksVariant {
    /// Asset, work list, poses; integer sums last, where sums are exact. As texels, the asset is bound twice more.
    fn bindings(self) -> Vec<vk::DescriptorType> {
        use vk::DescriptorType as T;
        let (state, texels) = match self.texels {
            true => (T::STORAGE_TEXEL_BUFFER, &[T::UNIFORM_TEXEL_BUFFER; 2][..]),
            false => (T::STORAGE_BUFFER, &[][..]),
        };
        let fixed = [T::STORAGE_BUFFER, T::STORAGE_BUFFER_DYNAMIC, state];
        fixed.iter().chain(texels).copied().chain(self.exact.then_some(state)).collect()
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
        // With texels, a lane has four vertices.
        let lanes = if texels { size / 8 } else { size };
        if widths == 0 {
            objects.add_compute(&name, &[lanes, size])?;
        }
        for rebuilt in 0..if exact { 1 } else { 2 } {
            for width in 0..widths {
                let constants = [lanes, size, 1 << width, rebuilt];
                objects.add_compute(&name, &constants[..if exact { 3 } else { 4 }])?;
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
    /// - `set` was made by [`BlockSets`] for this kernel and lives until the dispatches have run; the list at `list` in
    ///   its second buffer is complete by then, and names blocks, entries and slots that its buffers have.
    pub(crate) unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        set: vk::DescriptorSet,
        list: u32,
        parts: &[BlocksDispatch],
        push: BlocksPush,
    ) {
        let device = &self.objects.device.raw;
        let most = self.objects.device.caps.max_workgroups as usize;
        let (bind, layout) = (vk::PipelineBindPoint::COMPUTE, self.objects.layout);
        // SAFETY: the caller's obligations; `list` is a multiple of the device's offset alignment.
        unsafe { device.cmd_bind_descriptor_sets(cmd, bind, layout, 0, &[set], &[list]) };
        for BlocksDispatch { pipeline, items, first_word, item_words } in parts {
            // SAFETY: the caller's obligations; the push constants fill the layout's range; no dispatch has more
            // workgroups than the device allows.
            unsafe {
                device.cmd_bind_pipeline(cmd, bind, self.objects.pipelines[*pipeline]);
                for first in (0..*items).step_by(most) {
                    let push = BlocksPush { first_item: (first_word + first * item_words) as u32, ..push };
                    let groups = most.min(items - first) as u32;
                    device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::COMPUTE, 0, bytes_of(&push));
                    device.cmd_dispatch(cmd, groups, 1, 1);
                }
            }
        }
    }

    /// Which pipeline takes tiles of 2^width instances that start from the base pose (`apart`) or do not.
    pub(crate) fn pipeline_of(&self, apart: usize, width: usize) -> usize {
        apart * self.variant.widths as usize + width
    }
}

/// Whether `fast` is read as texels, and so in tiles even for a single instance: on software drivers, which pay for
/// storage buffers lane by lane, and several times as much under the control flow that masks take.
pub(crate) fn takes_texels(caps: &DeviceCaps, format: DeltaFormat) -> bool {
    // Whatever a storage descriptor covers, a view of single words covers then.
    caps.is_software() && format == DeltaFormat::Fast && u64::from(caps.max_texels) >= caps.max_storage_range / 4
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
    views: Vec<vk::BufferView>,
    sets: Vec<vk::DescriptorSet>,
}

impl BlockSets {
    pub(crate) fn new(kernel: &BlocksKernel, groups: &[GroupBuffers]) -> Result<Self> {
        let device = &kernel.objects.device;
        let (bindings, count) = (kernel.variant.bindings(), groups.len() as u32);
        let sizes: Vec<_> = bindings.iter().map(|&ty| vk::DescriptorPoolSize { ty, descriptor_count: count }).collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(count).pool_sizes(&sizes);
        // SAFETY: the device is alive.
        let pool =
            unsafe { device.raw.create_descriptor_pool(&info, None) }.map_err(failed("vkCreateDescriptorPool"))?;
        let mut sets = Self { device: device.clone(), pool, views: vec![], sets: vec![] };
        let layouts = vec![kernel.objects.set_layout; groups.len()];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: pool and layout are ours; the pool has room for as many.
        sets.sets =
            unsafe { device.raw.allocate_descriptor_sets(&info) }.map_err(failed("vkAllocateDescriptorSets"))?;
        for (i, group) in groups.iter().enumerate() {
            use vk::Format as F;
            let texels = [(group.asset, F::R32G32B32A32_UINT), (group.asset, F::R32_UINT)];
            let buffers =
                [(group.asset, F::UNDEFINED), (group.list, F::UNDEFINED), (group.poses, F::R32G32B32A32_SFLOAT)]
                    .into_iter()
                    .chain(texels.into_iter().filter(|_| kernel.variant.texels))
                    .chain(group.sums.map(|sums| (sums, F::R32G32B32A32_SINT)));
            for (binding, ((range, format), &ty)) in buffers.zip(&bindings).enumerate() {
                sets.write(sets.sets[i], binding as u32, ty, range, format)?;
            }
        }
        Ok(sets)
    }

    fn write(
        &mut self,
        set: vk::DescriptorSet,
        binding: u32,
        ty: vk::DescriptorType,
        range: BufferRange,
        format: vk::Format,
    ) -> Result<()> {
        let BufferRange { buffer, offset, size } = range;
        let info = [vk::DescriptorBufferInfo { buffer, offset, range: size }];
        let write = vk::WriteDescriptorSet::default().dst_set(set).dst_binding(binding).descriptor_type(ty);
        let view;
        use vk::DescriptorType as T;
        let write = if matches!(ty, T::STORAGE_TEXEL_BUFFER | T::UNIFORM_TEXEL_BUFFER) {
            let info = vk::BufferViewCreateInfo::default().buffer(buffer).offset(offset).range(size).format(format);
            // SAFETY: the buffer was made for such views; every device has these formats for them.
            view = [unsafe { self.device.raw.create_buffer_view(&info, None) }.map_err(failed("vkCreateBufferView"))?];
            self.views.extend(view);
            write.texel_buffer_view(&view)
        } else {
            write.buffer_info(&info)
        };
        // SAFETY: the set is not in use yet; buffers and ranges are the crowd's and the mesh's own.
        unsafe { self.device.raw.update_descriptor_sets(&[write], &[]) };
        Ok(())
    }

    pub(crate) fn get(&self, group: usize) -> vk::DescriptorSet {
        self.sets[group]
    }
}

impl Drop for BlockSets {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, with its sets, when the crowd is no longer in use by the device.
        unsafe {
            self.device.raw.destroy_descriptor_pool(self.pool, None);
            self.views.iter().for_each(|view| self.device.raw.destroy_buffer_view(*view, None));
        }
    }
}
