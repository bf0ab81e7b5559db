//! Images used as textures, attachments and pictures, each with its memory and its views; and passes over them.

use crate::gpu::allocation::Memory;
use crate::gpu::device::Device;
use crate::gpu::memory::sharing;
use crate::gpu::statistics::MemoryKind;
use deltamorph::ash::vk;
use deltamorph::gpu_allocator::vulkan::AllocationScheme;
use deltamorph::{Error, Result};
use std::ops::Range;
use std::slice::from_ref;
use std::sync::Arc;

/// Description of an [`Image`].
#[derive(Clone, Copy, Debug)]
pub struct ImageDesc {
    /// Width and height, in texels.
    pub size: [u32; 2],
    /// Number of layers.
    pub layers: u32,
    /// Format of the texels.
    pub format: vk::Format,
    /// Samples per texel.
    pub samples: vk::SampleCountFlags,
    /// Allowed uses.
    pub usage: vk::ImageUsageFlags,
}

/// A 2D image of one mip level, in device-local memory. Dropped only when the device no longer uses it.
pub struct Image {
    device: Arc<Device>,
    /// The handle.
    pub raw: vk::Image,
    /// Its description.
    pub desc: ImageDesc,
    memory: Option<Memory>,
    /// The views that were made, in order.
    pub views: Vec<vk::ImageView>,
}

impl Image {
    /// Makes an image with undefined contents and undefined layout.
    ///
    /// # Errors
    /// There is no memory.
    pub fn new(device: &Arc<Device>, name: &str, desc: &ImageDesc) -> Result<Self> {
        let ImageDesc { size: [width, height], layers, format, samples, usage } = *desc;
        let (sharing, families) = sharing(&device.families);
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(1)
            .array_layers(layers)
            .samples(samples)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(usage)
            .sharing_mode(sharing)
            .queue_family_indices(families);
        // SAFETY: the device is alive (Device::borrow); the size is within its limits, and every device has the formats
        // for these usages, or caps say so (checked by the callers).
        let raw = unsafe { device.raw.create_image(&info, None) }.map_err(Error::vulkan("vkCreateImage"))?;
        device.name(raw, || name.to_owned());
        // From here on, dropping `image` destroys the objects made so far.
        let mut image = Self { device: device.clone(), raw, desc: *desc, memory: None, views: vec![] };
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
    ///
    /// # Errors
    /// There is no memory.
    pub fn view(&mut self, layers: Range<u32>, is_array: bool) -> Result<vk::ImageView> {
        let depth = self.desc.usage.contains(vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT);
        let range = vk::ImageSubresourceRange {
            aspect_mask: if depth { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR },
            level_count: 1,
            base_array_layer: layers.start,
            layer_count: layers.end - layers.start,
            ..Default::default()
        };
        let kind = if is_array { vk::ImageViewType::TYPE_2D_ARRAY } else { vk::ImageViewType::TYPE_2D };
        let info = vk::ImageViewCreateInfo::default()
            .image(self.raw)
            .view_type(kind)
            .format(self.desc.format)
            .subresource_range(range);
        // SAFETY: the image is ours and has memory; the layers are its own.
        let view =
            unsafe { self.device.raw.create_image_view(&info, None) }.map_err(Error::vulkan("vkCreateImageView"))?;
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
        if let Some(memory) = self.memory.take() {
            self.device.free(memory);
        }
    }
}

/// Makes a render pass of one subpass.
///
/// # Errors
/// There is no memory.
pub fn render_pass(
    device: &Device,
    attachments: &[vk::AttachmentDescription],
    subpass: &vk::SubpassDescription<'_>,
    dependencies: &[vk::SubpassDependency],
) -> Result<vk::RenderPass> {
    let info = vk::RenderPassCreateInfo::default().attachments(attachments).subpasses(from_ref(subpass));
    // SAFETY: the device is alive; everything referred to is in `info`.
    let made = unsafe { device.raw.create_render_pass(&info.dependencies(dependencies), None) };
    made.map_err(Error::vulkan("vkCreateRenderPass"))
}

/// Makes a framebuffer of these views.
///
/// # Errors
/// There is no memory.
///
/// # Safety
/// Pass and views are the device's and alive; the views match the pass, and are of this size.
pub unsafe fn framebuffer(
    device: &Device,
    pass: vk::RenderPass,
    views: &[vk::ImageView],
    [width, height]: [u32; 2],
) -> Result<vk::Framebuffer> {
    let info = vk::FramebufferCreateInfo::default().render_pass(pass).attachments(views).layers(1);
    // SAFETY: the caller's obligations.
    let made = unsafe { device.raw.create_framebuffer(&info.width(width).height(height), None) };
    made.map_err(Error::vulkan("vkCreateFramebuffer"))
}
