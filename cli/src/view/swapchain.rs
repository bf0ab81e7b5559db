//! The images of the window, and the objects to draw into each.

use super::device::{Device, Surface, failed};
use crate::output::Failure;
use deltamorph::ash::vk;
use deltamorph_render::{Heads, Target};
use std::rc::Rc;
use std::slice::from_ref;

/// Shaders write linear colours, displayed as sRGB.
pub const FORMATS: [vk::Format; 2] = [vk::Format::B8G8R8A8_SRGB, vk::Format::R8G8B8A8_SRGB];

/// The images of the window at one size.
pub struct Swapchain {
    device: Rc<Device>,
    raw: vk::SwapchainKHR,
    pub extent: vk::Extent2D,
    pub images: Vec<Shown>,
    /// Whether pixels can be copied from the images.
    pub readable: bool,
}

/// An image of the window.
pub struct Shown {
    device: Rc<Device>,
    pub target: Target,
    pub image: vk::Image,
    view: vk::ImageView,
    /// Framebuffer of the pass that draws the panel over the instances.
    pub framebuffer: vk::Framebuffer,
    /// Signalled when the image is drawn. One per image: it is free again when the image is.
    pub drawn: vk::Semaphore,
    /// The frame in flight that was last drawn into the image.
    pub frame: Option<usize>,
}

/// The format of the window's images.
pub fn format(device: &Device) -> Result<vk::SurfaceFormatKHR, Failure> {
    let Surface { raw: surface, functions: surfaces, .. } = &device.surface;
    // SAFETY: the physical device was chosen for this surface.
    let formats = unsafe { surfaces.get_physical_device_surface_formats(device.physical(), *surface) };
    let formats = formats.map_err(failed("vkGetPhysicalDeviceSurfaceFormatsKHR"))?;
    let find = |wanted| formats.iter().copied().find(|format| format.format == wanted);
    FORMATS.into_iter().find_map(find).ok_or_else(|| {
        let name = &device.engine().caps().name;
        Failure::Failed(format!("{name}: windows have no 8-bit sRGB format here; `deltamorph render` needs no window"))
    })
}

impl Swapchain {
    /// Creates images for a window of this size; `None` if it has no area, as when minimised.
    pub fn new(
        device: &Rc<Device>,
        format: vk::SurfaceFormatKHR,
        heads: &Heads,
        overlay: vk::RenderPass,
        size: [u32; 2],
        old: Option<Self>,
    ) -> Result<Option<Self>, Failure> {
        let Surface { raw: surface, functions: surfaces, .. } = &device.surface;
        // SAFETY: the physical device was chosen for this surface.
        let can = unsafe { surfaces.get_physical_device_surface_capabilities(device.physical(), *surface) };
        let can = can.map_err(failed("vkGetPhysicalDeviceSurfaceCapabilitiesKHR"))?;
        let Some(extent) = extent(&can, size) else { return Ok(None) };
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        let readable = can.supported_usage_flags.contains(vk::ImageUsageFlags::TRANSFER_SRC);
        let copies = if readable { vk::ImageUsageFlags::TRANSFER_SRC } else { vk::ImageUsageFlags::empty() };
        let opaque = [vk::CompositeAlphaFlagsKHR::OPAQUE, vk::CompositeAlphaFlagsKHR::INHERIT];
        let opaque = opaque.into_iter().find(|mode| can.supported_composite_alpha.contains(*mode));
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(*surface)
            .min_image_count((can.min_image_count + 1).min(most))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT | copies)
            .pre_transform(can.current_transform)
            .composite_alpha(opaque.unwrap_or(vk::CompositeAlphaFlagsKHR::OPAQUE))
            .present_mode(vk::PresentModeKHR::FIFO)
            .clipped(true)
            .old_swapchain(old.as_ref().map_or(vk::SwapchainKHR::null(), |old| old.raw));
        // SAFETY: the surface supports the parameters; the caller waited until nothing uses the old one, which is
        // dropped here.
        let raw = unsafe { device.swapchains.create_swapchain(&info, None) }.map_err(failed("vkCreateSwapchainKHR"))?;
        drop(old);
        let mut this = Self { device: device.clone(), raw, extent, images: vec![], readable };
        // SAFETY: the swapchain is alive.
        let images = unsafe { device.swapchains.get_swapchain_images(raw) };
        for image in images.map_err(failed("vkGetSwapchainImagesKHR"))? {
            this.images.push(Shown::new(device, image, format.format, heads, overlay, extent)?);
        }
        Ok(Some(this))
    }

    /// The next image to draw into; `None` if the window has another size now.
    pub fn acquire(&self, signal: vk::Semaphore) -> Result<Option<usize>, Failure> {
        // SAFETY: the semaphore is unsignalled, and nothing waits for it: its frame has finished.
        let next = unsafe { self.device.swapchains.acquire_next_image(self.raw, u64::MAX, signal, vk::Fence::null()) };
        match next {
            Ok((index, _)) => Ok(Some(index as usize)),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(None),
            Err(other) => Err(failed("vkAcquireNextImageKHR")(other)),
        }
    }

    /// Presents an image that is being drawn; returns whether the window still has this size.
    pub fn present(&self, index: usize) -> Result<bool, Failure> {
        let at = index as u32;
        let waited = self.images[index].drawn;
        let info = vk::PresentInfoKHR::default().wait_semaphores(from_ref(&waited));
        let info = info.swapchains(from_ref(&self.raw)).image_indices(from_ref(&at));
        // SAFETY: the image was acquired, and the work that signals the semaphore was submitted.
        match unsafe { self.device.swapchains.queue_present(self.device.headless.queue().0, &info) } {
            Ok(outgrown) => Ok(!outgrown),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(false),
            Err(other) => Err(failed("vkQueuePresentKHR")(other)),
        }
    }
}

/// The size of images: the surface's, or the window's if the surface leaves it open.
fn extent(can: &vk::SurfaceCapabilitiesKHR, [width, height]: [u32; 2]) -> Option<vk::Extent2D> {
    let low = can.min_image_extent;
    let high = can.max_image_extent;
    let extent = if can.current_extent.width != u32::MAX {
        can.current_extent
    } else if width == 0 || height == 0 {
        return None;
    } else {
        vk::Extent2D { width: width.max(low.width).min(high.width), height: height.max(low.height).min(high.height) }
    };
    (extent.width > 0 && extent.height > 0).then_some(extent)
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        self.images.clear();
        // SAFETY: ours, destroyed once; the owner waited until nothing uses it.
        unsafe { self.device.swapchains.destroy_swapchain(self.raw, None) };
    }
}

impl Shown {
    fn new(
        device: &Rc<Device>,
        image: vk::Image,
        format: vk::Format,
        heads: &Heads,
        overlay: vk::RenderPass,
        extent: vk::Extent2D,
    ) -> Result<Self, Failure> {
        let range = vk::ImageSubresourceRange::default().aspect_mask(vk::ImageAspectFlags::COLOR);
        let info = vk::ImageViewCreateInfo::default().image(image).format(format).view_type(vk::ImageViewType::TYPE_2D);
        let info = info.subresource_range(range.level_count(1).layer_count(1));
        // SAFETY: the image belongs to the swapchain, and the pass has its format; `drop` destroys what is created.
        unsafe {
            let raw = device.raw();
            let view = raw.create_image_view(&info, None).map_err(failed("vkCreateImageView"))?;
            let target = heads.target(view, extent).inspect_err(|_| raw.destroy_image_view(view, None))?;
            let framebuffer = vk::Framebuffer::null();
            let drawn = vk::Semaphore::null();
            let mut this = Self { device: device.clone(), target, image, view, framebuffer, drawn, frame: None };
            let info = vk::FramebufferCreateInfo::default().render_pass(overlay).attachments(from_ref(&view));
            let info = info.width(extent.width).height(extent.height).layers(1);
            this.framebuffer = raw.create_framebuffer(&info, None).map_err(failed("vkCreateFramebuffer"))?;
            let drawn = raw.create_semaphore(&vk::SemaphoreCreateInfo::default(), None);
            this.drawn = drawn.map_err(failed("vkCreateSemaphore"))?;
            Ok(this)
        }
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        let device = self.device.raw();
        // SAFETY: ours, destroyed once, not in use: see `Swapchain`.
        unsafe {
            device.destroy_framebuffer(self.framebuffer, None);
            device.destroy_image_view(self.view, None);
            device.destroy_semaphore(self.drawn, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_without_an_area_has_no_images() {
        let sized = |width, height| vk::SurfaceCapabilitiesKHR {
            current_extent: vk::Extent2D { width, height },
            min_image_extent: vk::Extent2D { width: 1, height: 1 },
            max_image_extent: vk::Extent2D { width: 4096, height: 4096 },
            ..Default::default()
        };
        assert_eq!(extent(&sized(0, 0), [640, 480]), None); // minimised, as on Windows
        assert_eq!(extent(&sized(640, 0), [640, 480]), None);
        let known = sized(640, 480);
        let open = sized(u32::MAX, u32::MAX);
        assert_eq!(extent(&known, [1, 1]).map(|e| [e.width, e.height]), Some([640, 480]));
        assert_eq!(extent(&open, [0, 480]), None);
        assert_eq!(extent(&open, [9000, 480]).map(|e| [e.width, e.height]), Some([4096, 480]));
    }
}
