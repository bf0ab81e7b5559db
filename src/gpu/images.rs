//! Images for textures and colour attachments, each with its memory and its views.

use super::device::{Device, allocation_failed};
use super::failed;
use super::memory::sharing;
use crate::error::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationScheme};
use std::ops::Range;
use std::sync::Arc;

/// A 2D image of one mip level, in device-local memory. Dropped only when the device no longer uses it.
pub(crate) struct Image {
    device: Arc<Device>,
    pub(crate) raw: vk::Image,
    pub(crate) size: [u32; 2],
    format: vk::Format,
    allocation: Option<Allocation>,
    /// The views made so far, in order.
    pub(crate) views: Vec<vk::ImageView>,
}

impl Image {
    /// Makes an image of `size` texels with this number of layers; its contents and layout are undefined.
    pub(crate) fn new(
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
        // SAFETY: the device is alive (Device::borrow); the size is within its limits, and the formats support these
        // usages: on every device, or as the caller has checked in the caps.
        let raw = unsafe { device.raw.create_image(&info, None) }.map_err(failed("vkCreateImage"))?;
        device.name(raw, || name.to_owned());
        // From here on, dropping `image` destroys everything that was made.
        let mut image = Self { device: device.clone(), raw, size, format, allocation: None, views: vec![] };
        // SAFETY: created just now.
        let requirements = unsafe { device.raw.get_image_memory_requirements(raw) };
        let (own, location) = (AllocationScheme::DedicatedImage(raw), MemoryLocation::GpuOnly);
        let allocation = device.allocate(name, requirements, own, location);
        let allocation =
            image.allocation.insert(allocation.map_err(|e| allocation_failed(name, requirements.size, &e))?);
        // SAFETY: the allocation was made for this image's requirements and is bound once.
        unsafe { device.raw.bind_image_memory(raw, allocation.memory(), allocation.offset()) }
            .map_err(failed("vkBindImageMemory"))?;
        Ok(image)
    }

    /// Makes a view of these layers, as an array if `is_array`. It lives as long as the image.
    pub(crate) fn view(&mut self, layers: Range<u32>, is_array: bool) -> Result<vk::ImageView> {
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
        let view = unsafe { self.device.raw.create_image_view(&info, None) }.map_err(failed("vkCreateImageView"))?;
        self.views.push(view);
        Ok(view)
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        // SAFETY: created in `new` and `view`, destroyed once, and no longer used by the device (see the type).
        unsafe {
            self.views.iter().for_each(|&view| self.device.raw.destroy_image_view(view, None));
            self.device.raw.destroy_image(self.raw, None);
        }
        // Freed last: the allocator may be the host's, and reuse the memory at once.
        if let Some(allocation) = self.allocation.take() {
            self.device.free(allocation);
        }
    }
}
