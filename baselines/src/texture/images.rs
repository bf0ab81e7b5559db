//! Images used as textures and colour attachments, each with its memory and its views.

use deltamorph::ash::vk;
use deltamorph::gpu_allocator::vulkan::AllocationScheme;
use deltamorph::internals::gpu::allocation::Memory;
use deltamorph::internals::gpu::device::Device;
use deltamorph::internals::gpu::memory::{Buffer, sharing};
use deltamorph::internals::gpu::statistics::MemoryKind;
use deltamorph::{Error, Result};
use std::ops::Range;
use std::sync::Arc;

/// A 2D image of one mip level, in device-local memory. Dropped only when the device no longer uses it.
pub(super) struct Image {
    device: Arc<Device>,
    pub(super) raw: vk::Image,
    pub(super) size: [u32; 2],
    format: vk::Format,
    memory: Option<Memory>,
    /// The views that were made, in order.
    pub(super) views: Vec<vk::ImageView>,
}

impl Image {
    /// Makes an image of `size` texels with this many layers, undefined contents and undefined layout.
    pub(super) fn new(
        device: &Arc<Device>,
        name: &str,
        format: vk::Format,
        (size, layers): ([u32; 2], u32),
        usage: vk::ImageUsageFlags,
    ) -> Result<Self> {
        let (sharing, families) = sharing(&device.families);
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width: size[0], height: size[1], depth: 1 })
            .mip_levels(1)
            .array_layers(layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(usage)
            .sharing_mode(sharing)
            .queue_family_indices(families);
        // SAFETY: the device is alive (Device::borrow); the size is within its limits, and every device has the formats
        // for these usages, or caps say so (checked by the callers).
        let raw = unsafe { device.raw.create_image(&info, None) }.map_err(Error::vulkan("vkCreateImage"))?;
        device.name(raw, || name.to_owned());
        // From here on, dropping `image` destroys the objects made so far.
        let mut image = Self { device: device.clone(), raw, size, format, memory: None, views: vec![] };
        // SAFETY: created above.
        let requirements = unsafe { device.raw.get_image_memory_requirements(raw) };
        let own = AllocationScheme::DedicatedImage(raw);
        let memory = device.allocate(MemoryKind::Meshes, name, requirements, own)?;
        let (memory, offset) = image.memory.insert(memory).place();
        // SAFETY: the memory was allocated for this image's requirements and is bound once.
        unsafe { device.raw.bind_image_memory(raw, memory, offset) }.map_err(Error::vulkan("vkBindImageMemory"))?;
        Ok(image)
    }

    /// Makes a view of these layers, as an array if `is_array`. It lives as long as the image.
    pub(super) fn view(&mut self, layers: Range<u32>, is_array: bool) -> Result<vk::ImageView> {
        let range = vk::ImageSubresourceRange {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            level_count: 1,
            base_array_layer: layers.start,
            layer_count: layers.end - layers.start,
            ..Default::default()
        };
        let kind = if is_array { vk::ImageViewType::TYPE_2D_ARRAY } else { vk::ImageViewType::TYPE_2D };
        let info = vk::ImageViewCreateInfo::default()
            .image(self.raw)
            .view_type(kind)
            .format(self.format)
            .subresource_range(range);
        // SAFETY: the image is ours and has memory; the layers are its own.
        let view =
            unsafe { self.device.raw.create_image_view(&info, None) }.map_err(Error::vulkan("vkCreateImageView"))?;
        self.views.push(view);
        Ok(view)
    }
}

/// Records the copy of all texels of a new image from a buffer, with layout changes around it; afterwards shaders can
/// load the image.
///
/// # Safety
/// - `cmd` is in the recording state on the image's device, outside a render pass.
/// - `texels` holds all texels of the image, and both live until the copy has run; the image is not used meanwhile.
pub(super) unsafe fn record_filling(
    device: &Device,
    cmd: vk::CommandBuffer,
    (image, [width, height]): (vk::Image, [u32; 2]),
    texels: vk::Buffer,
) {
    use vk::{AccessFlags as Access, ImageLayout as Layout, PipelineStageFlags as Stage};
    let layers =
        vk::ImageSubresourceLayers { aspect_mask: vk::ImageAspectFlags::COLOR, layer_count: 1, ..Default::default() };
    let extent = vk::Extent3D { width, height, depth: 1 };
    let whole = vk::BufferImageCopy::default().image_subresource(layers).image_extent(extent);
    let range = vk::ImageSubresourceRange {
        aspect_mask: vk::ImageAspectFlags::COLOR,
        level_count: 1,
        layer_count: 1,
        ..Default::default()
    };
    let barrier = vk::ImageMemoryBarrier::default()
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .image(image)
        .subresource_range(range);
    let filling = Layout::TRANSFER_DST_OPTIMAL;
    let before = barrier.dst_access_mask(Access::TRANSFER_WRITE).old_layout(Layout::UNDEFINED).new_layout(filling);
    let after = barrier
        .src_access_mask(Access::TRANSFER_WRITE)
        .dst_access_mask(Access::MEMORY_READ)
        .old_layout(filling)
        .new_layout(Layout::SHADER_READ_ONLY_OPTIMAL);
    let none = vk::DependencyFlags::empty();
    // No shader stage is named, so that every queue accepts the barrier.
    // SAFETY: the caller's obligations.
    unsafe {
        device.raw.cmd_pipeline_barrier(cmd, Stage::TOP_OF_PIPE, Stage::TRANSFER, none, &[], &[], &[before]);
        device.raw.cmd_copy_buffer_to_image(cmd, texels, image, filling, &[whole]);
        device.raw.cmd_pipeline_barrier(cmd, Stage::TRANSFER, Stage::ALL_COMMANDS, none, &[], &[], &[after]);
    }
}

/// Makes staging memory with these bytes.
pub(super) fn staging(device: &Arc<Device>, bytes: &[u8]) -> Result<Buffer> {
    let (size, usage) = (bytes.len() as u64, vk::BufferUsageFlags::TRANSFER_SRC);
    let mut staging = Buffer::new(device, "deltamorph upload", size, usage, MemoryKind::Staging)?;
    staging.mapped()?[..bytes.len()].copy_from_slice(bytes);
    Ok(staging)
}

/// Binds an image that shaders load, in the layout SHADER_READ_ONLY_OPTIMAL, to a set that is not in use yet.
pub(super) fn write_image(device: &Device, set: vk::DescriptorSet, binding: u32, view: vk::ImageView) {
    let layout = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;
    let info = [vk::DescriptorImageInfo::default().image_view(view).image_layout(layout)];
    let write = vk::WriteDescriptorSet::default().dst_set(set).dst_binding(binding);
    let write = write.descriptor_type(vk::DescriptorType::SAMPLED_IMAGE).image_info(&info);
    // SAFETY: the set is not in use yet; its owner keeps the view alive.
    unsafe { device.raw.update_descriptor_sets(&[write], &[]) };
}

impl Drop for Image {
    fn drop(&mut self) {
        // SAFETY: created in `new` and `view`, destroyed once, and no longer used by the device (see the type).
        unsafe {
            self.views.iter().for_each(|&view| self.device.raw.destroy_image_view(view, None));
            self.device.raw.destroy_image(self.raw, None);
        }
        // Freed last: the allocator may be the host's, and reuse the memory at once.
        if let Some(memory) = self.memory.take() {
            self.device.free(memory);
        }
    }
}
