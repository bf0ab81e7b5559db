//! Descriptor sets: what is bound where, and the pool that goes with them.

use super::device::Device;
use super::failed;
use crate::abi::kernels::Buffer;
use crate::error::Result;
use ash::vk;
use std::sync::Arc;

/// A buffer and the bytes of it that a descriptor covers.
#[derive(Clone, Copy)]
pub(crate) struct BufferRange {
    pub(crate) buffer: vk::Buffer,
    pub(crate) offset: u64,
    pub(crate) size: u64,
}

/// A buffer in a set.
#[derive(Clone, Copy)]
pub(crate) struct Bound {
    ty: vk::DescriptorType,
    range: BufferRange,
    /// Of texel buffers.
    format: vk::Format,
}

impl Bound {
    pub(crate) fn new(buffer: vk::Buffer, offset: u64, size: u64) -> Self {
        let range = BufferRange { buffer, offset, size };
        Self { ty: vk::DescriptorType::STORAGE_BUFFER, range, format: vk::Format::UNDEFINED }
    }

    /// Where it starts is said when the set is bound.
    pub(crate) fn dynamic(buffer: vk::Buffer, size: u64) -> Self {
        Self { ty: vk::DescriptorType::STORAGE_BUFFER_DYNAMIC, ..Self::new(buffer, 0, size) }
    }

    /// Of any type: `format` counts for texel buffers, which the buffer was made for then.
    pub(crate) fn typed(ty: vk::DescriptorType, range: BufferRange, format: vk::Format) -> Self {
        Self { ty, range, format }
    }
}

/// The descriptor of a buffer that a kernel declares.
pub(crate) fn descriptor_type(buffer: Buffer) -> vk::DescriptorType {
    match buffer {
        Buffer::Storage(_) | Buffer::Poses => vk::DescriptorType::STORAGE_BUFFER,
        Buffer::Dynamic(_) | Buffer::DynamicDeltas => vk::DescriptorType::STORAGE_BUFFER_DYNAMIC,
        Buffer::UniformTexels => vk::DescriptorType::UNIFORM_TEXEL_BUFFER,
        Buffer::StorageTexels => vk::DescriptorType::STORAGE_TEXEL_BUFFER,
    }
}

/// Types of buffers in sets.
const TYPES: [vk::DescriptorType; 4] = {
    use vk::DescriptorType as T;
    [T::STORAGE_BUFFER, T::STORAGE_BUFFER_DYNAMIC, T::STORAGE_TEXEL_BUFFER, T::UNIFORM_TEXEL_BUFFER]
};

/// Descriptor sets of one layout, destroyed together.
pub(crate) struct Sets {
    device: Arc<Device>,
    pool: vk::DescriptorPool,
    views: Vec<vk::BufferView>,
    sets: Vec<vk::DescriptorSet>,
}

impl Sets {
    /// A set for each list of buffers, bound at 0, 1, …; all lists have the types of the first.
    pub(crate) fn new(device: &Arc<Device>, layout: vk::DescriptorSetLayout, bound: &[Vec<Bound>]) -> Result<Self> {
        let count = |ty| bound.iter().flatten().filter(|b| b.ty == ty).count() as u32;
        let sizes: Vec<_> = TYPES
            .into_iter()
            .map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: count(ty) })
            .filter(|size| size.descriptor_count > 0)
            .collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(bound.len() as u32).pool_sizes(&sizes);
        // SAFETY: the device is alive.
        let pool =
            unsafe { device.raw.create_descriptor_pool(&info, None) }.map_err(failed("vkCreateDescriptorPool"))?;
        let mut sets = Self { device: device.clone(), pool, views: vec![], sets: vec![] };
        let layouts = vec![layout; bound.len()];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: pool and layout are ours; the pool has room for as many.
        sets.sets =
            unsafe { device.raw.allocate_descriptor_sets(&info) }.map_err(failed("vkAllocateDescriptorSets"))?;
        for (set, bound) in bound.iter().enumerate() {
            for (binding, bound) in (0..).zip(bound) {
                sets.write(sets.sets[set], binding, bound)?;
            }
        }
        Ok(sets)
    }

    fn write(&mut self, set: vk::DescriptorSet, binding: u32, bound: &Bound) -> Result<()> {
        use vk::DescriptorType as T;
        let BufferRange { buffer, offset, size } = bound.range;
        let info = [vk::DescriptorBufferInfo { buffer, offset, range: size }];
        let write = vk::WriteDescriptorSet::default().dst_set(set).dst_binding(binding).descriptor_type(bound.ty);
        let view;
        let write = if matches!(bound.ty, T::STORAGE_TEXEL_BUFFER | T::UNIFORM_TEXEL_BUFFER) {
            let info =
                vk::BufferViewCreateInfo::default().buffer(buffer).offset(offset).range(size).format(bound.format);
            // SAFETY: the buffer was made for such views; every device has these formats for them.
            view = [unsafe { self.device.raw.create_buffer_view(&info, None) }.map_err(failed("vkCreateBufferView"))?];
            self.views.extend(view);
            write.texel_buffer_view(&view)
        } else {
            write.buffer_info(&info)
        };
        // SAFETY: the set is not in use yet; buffers and ranges are those of whoever owns the sets.
        unsafe { self.device.raw.update_descriptor_sets(&[write], &[]) };
        Ok(())
    }

    pub(crate) fn get(&self, set: usize) -> vk::DescriptorSet {
        self.sets[set]
    }

    /// Sets that lie side by side.
    pub(crate) fn range(&self, sets: std::ops::Range<usize>) -> &[vk::DescriptorSet] {
        &self.sets[sets]
    }
}

impl Drop for Sets {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, with its sets, when whoever owns them is no longer in use by the device.
        unsafe {
            self.device.raw.destroy_descriptor_pool(self.pool, None);
            self.views.iter().for_each(|view| self.device.raw.destroy_buffer_view(*view, None));
        }
    }
}
