//! Descriptor sets and their pool.

use super::device::Device;
use crate::abi::kernels::{Binding, Buffer};
use crate::error::{Error, Result, ensure, refuse};
use ash::vk;
use std::sync::Arc;

/// A buffer and the range of it that a descriptor covers.
#[derive(Clone, Copy)]
pub struct BufferRange {
    /// The buffer.
    pub buffer: vk::Buffer,
    /// First byte of the range.
    pub offset: u64,
    /// Bytes.
    pub size: u64,
}

impl BufferRange {
    /// `size` bytes from `offset` on.
    pub fn new(buffer: vk::Buffer, offset: u64, size: u64) -> Self {
        Self { buffer, offset, size }
    }

    /// Refuses a range that ends beyond a host buffer, as far as Vulkan reveals its size: the memory that a buffer
    /// needs is no smaller than the buffer.
    pub fn check_room(self, device: &Device, what: &str) -> Result<()> {
        // SAFETY: who hands a buffer in promises that it is of this device, and alive.
        let room = unsafe { device.raw.get_buffer_memory_requirements(self.buffer) }.size;
        let end = self.offset.saturating_add(self.size);
        let text = format!("{what}, to byte {end} of a host buffer of at most {room} bytes");
        ensure!(end <= room, text, "make the buffer larger, or use a smaller offset or stride");
        Ok(())
    }
}

/// Returns the descriptor type of a buffer that a kernel declares.
pub fn descriptor_type(buffer: Buffer) -> vk::DescriptorType {
    match buffer {
        Buffer::Storage => vk::DescriptorType::STORAGE_BUFFER,
        Buffer::Dynamic => vk::DescriptorType::STORAGE_BUFFER_DYNAMIC,
        Buffer::UniformTexels(_) => vk::DescriptorType::UNIFORM_TEXEL_BUFFER,
        Buffer::StorageTexels(_) => vk::DescriptorType::STORAGE_TEXEL_BUFFER,
        Buffer::Image => vk::DescriptorType::SAMPLED_IMAGE,
    }
}

/// Descriptor sets of one layout, destroyed together.
pub struct Sets {
    device: Arc<Device>,
    pool: vk::DescriptorPool,
    views: Vec<vk::BufferView>,
    sets: Vec<vk::DescriptorSet>,
}

impl Sets {
    /// Makes sets of the layout that `kernel` declares with these `bindings`: one for each element of `bound`, which
    /// has a range for each binding.
    pub(super) fn new(
        device: &Arc<Device>,
        (kernel, bindings, set_layout): (&str, &[Binding], vk::DescriptorSetLayout),
        bound: &[impl AsRef<[BufferRange]>],
    ) -> Result<Self> {
        let descriptor_count = bound.len() as u32;
        let size = |&(_, buffer): &Binding| vk::DescriptorPoolSize { ty: descriptor_type(buffer), descriptor_count };
        let sizes: Vec<_> = bindings.iter().map(size).collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(descriptor_count).pool_sizes(&sizes);
        // SAFETY: the device is alive.
        let pool = unsafe { device.raw.create_descriptor_pool(&info, None) }
            .map_err(Error::vulkan("vkCreateDescriptorPool"))?;
        let mut sets = Self { device: device.clone(), pool, views: vec![], sets: vec![] };
        let layouts = vec![set_layout; bound.len()];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: pool and layout are ours; the pool has room for as many.
        sets.sets =
            unsafe { device.raw.allocate_descriptor_sets(&info) }.map_err(Error::vulkan("vkAllocateDescriptorSets"))?;
        for (number, set) in sets.sets.iter().enumerate() {
            device.name(*set, || format!("deltamorph {kernel}, set {number}"));
        }
        for (set, ranges) in bound.iter().enumerate() {
            for (binding, range) in bindings.iter().zip(ranges.as_ref()) {
                sets.write(set, *binding, *range)?;
            }
        }
        Ok(sets)
    }

    fn write(&mut self, set: usize, (binding, declared): Binding, bound: BufferRange) -> Result<()> {
        let BufferRange { buffer, offset, size } = bound;
        let info = [vk::DescriptorBufferInfo { buffer, offset, range: size }];
        let write = vk::WriteDescriptorSet::default().dst_set(self.sets[set]).dst_binding(binding);
        let write = write.descriptor_type(descriptor_type(declared));
        let view;
        let write = match declared {
            Buffer::UniformTexels(format) | Buffer::StorageTexels(format) => {
                let format = vk::Format::from_raw(format);
                let info = vk::BufferViewCreateInfo::default().buffer(buffer).offset(offset).range(size).format(format);
                // SAFETY: the buffer was made for such views; every device has these formats for them.
                let made = unsafe { self.device.raw.create_buffer_view(&info, None) };
                view = [made.map_err(Error::vulkan("vkCreateBufferView"))?];
                self.views.extend(view);
                write.texel_buffer_view(&view)
            }
            Buffer::Storage | Buffer::Dynamic => write.buffer_info(&info),
            Buffer::Image => return refuse("a buffer is bound to a kernel's image", "report this"),
        };
        // SAFETY: the set is not in use yet; its owner keeps buffers and ranges valid.
        unsafe { self.device.raw.update_descriptor_sets(&[write], &[]) };
        Ok(())
    }

    /// A set, by its number.
    pub fn get(&self, set: usize) -> vk::DescriptorSet {
        self.sets[set]
    }

    /// Returns adjacent sets.
    pub fn range(&self, sets: std::ops::Range<usize>) -> &[vk::DescriptorSet] {
        &self.sets[sets]
    }
}

impl Drop for Sets {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, with its sets, when the device no longer uses their owner.
        unsafe {
            self.device.raw.destroy_descriptor_pool(self.pool, None);
            self.views.iter().for_each(|view| self.device.raw.destroy_buffer_view(*view, None));
        }
    }
}
