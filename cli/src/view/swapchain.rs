//! The images of the window, which pictures are copied to.

use super::device::{Device, Surface, failed};
use crate::output::{Failure, Result};
use deltamorph::ash::vk;
use std::rc::Rc;
use std::slice::from_ref;
use vk::{AccessFlags as Access, ImageLayout as Layout, PipelineStageFlags as Stage};

/// Pictures are in sRGB, and copies convert between these two alone.
const FORMATS: [vk::Format; 2] = [vk::Format::B8G8R8A8_SRGB, vk::Format::R8G8B8A8_SRGB];

/// The images of the window at one size.
pub struct Swapchain {
    device: Rc<Device>,
    raw: vk::SwapchainKHR,
    /// Signalled when an image is acquired.
    acquired: vk::Fence,
    images: Vec<vk::Image>,
    pub size: [u32; 2],
}

impl Swapchain {
    /// Creates images for a window of this size; `None` if it has no area, as when minimised.
    pub fn new(device: &Rc<Device>, size: [u32; 2]) -> Result<Option<Self>> {
        let Surface { raw: surface, functions: surfaces, .. } = &device.surface;
        let physical = device.headless.handles().1;
        // SAFETY: the physical device was chosen for this surface.
        let can = unsafe { surfaces.get_physical_device_surface_capabilities(physical, *surface) };
        let can = can.map_err(failed("vkGetPhysicalDeviceSurfaceCapabilitiesKHR"))?;
        let Some(extent) = extent(&can, size) else { return Ok(None) };
        // SAFETY: as above.
        let formats = unsafe { surfaces.get_physical_device_surface_formats(physical, *surface) };
        let formats = formats.map_err(failed("vkGetPhysicalDeviceSurfaceFormatsKHR"))?;
        let find = |wanted| formats.iter().find(|format| format.format == wanted);
        let format = FORMATS.into_iter().find_map(find);
        let Some(format) = format.filter(|_| can.supported_usage_flags.contains(vk::ImageUsageFlags::TRANSFER_DST))
        else {
            let name = &device.headless.caps().name;
            let what = "windows have no 8-bit sRGB images that can be copied to";
            return Err(Failure::Failed(format!("{name}: {what}; `deltamorph render` needs no window")));
        };
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        let opaque = [vk::CompositeAlphaFlagsKHR::OPAQUE, vk::CompositeAlphaFlagsKHR::INHERIT];
        let opaque = opaque.into_iter().find(|mode| can.supported_composite_alpha.contains(*mode));
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(*surface)
            .min_image_count((can.min_image_count + 1).min(most))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST)
            .pre_transform(can.current_transform)
            .composite_alpha(opaque.unwrap_or(vk::CompositeAlphaFlagsKHR::OPAQUE))
            .present_mode(vk::PresentModeKHR::FIFO)
            .clipped(true);
        // SAFETY: the surface supports the parameters, and has no other swapchain; `drop` destroys everything.
        unsafe {
            let raw = device.swapchains.create_swapchain(&info, None).map_err(failed("vkCreateSwapchainKHR"))?;
            let size = [extent.width, extent.height];
            let acquired = vk::Fence::null();
            let mut this = Self { device: device.clone(), raw, acquired, images: vec![], size };
            let fence = device.raw().create_fence(&vk::FenceCreateInfo::default(), None);
            this.acquired = fence.map_err(failed("vkCreateFence"))?;
            let images = device.swapchains.get_swapchain_images(raw);
            this.images = images.map_err(failed("vkGetSwapchainImagesKHR"))?;
            Ok(Some(this))
        }
    }

    /// Waits for the next image to copy to, and returns its number; `None` if the window has another size now.
    pub fn acquire(&self) -> Result<Option<u32>> {
        let raw = self.device.raw();
        // SAFETY: the fence is unsignalled, and nothing else signals it.
        unsafe {
            let none = vk::Semaphore::null();
            match self.device.swapchains.acquire_next_image(self.raw, u64::MAX, none, self.acquired) {
                Ok((index, _)) => {
                    raw.wait_for_fences(&[self.acquired], true, u64::MAX).map_err(failed("vkWaitForFences"))?;
                    raw.reset_fences(&[self.acquired]).map_err(failed("vkResetFences"))?;
                    Ok(Some(index))
                }
                Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(None),
                Err(other) => Err(failed("vkAcquireNextImageKHR")(other)),
            }
        }
    }

    /// Records a copy of a picture to an image, which can be presented then.
    ///
    /// # Safety
    /// `cmd` is recording, outside a render pass; the image was acquired; the picture is of its size and ready for
    /// copies.
    pub unsafe fn record(&self, cmd: vk::CommandBuffer, index: u32, picture: vk::Image) {
        let image = self.images[index as usize];
        let range = vk::ImageSubresourceRange::default().aspect_mask(vk::ImageAspectFlags::COLOR);
        let change = |from, to| {
            let change = vk::ImageMemoryBarrier::default().image(image).old_layout(from).new_layout(to);
            let change = change.src_access_mask(Access::TRANSFER_WRITE).dst_access_mask(Access::TRANSFER_WRITE);
            let change = change.subresource_range(range.level_count(1).layer_count(1));
            change.src_queue_family_index(vk::QUEUE_FAMILY_IGNORED).dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        };
        let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let corner = vk::Offset3D { x: self.size[0] as i32, y: self.size[1] as i32, z: 1 };
        let whole = [vk::Offset3D::default(), corner];
        let blit = vk::ImageBlit::default().src_subresource(layers).dst_subresource(layers);
        let blit = [blit.src_offsets(whole).dst_offsets(whole)];
        let [from, to, shown] = [Layout::TRANSFER_SRC_OPTIMAL, Layout::TRANSFER_DST_OPTIMAL, Layout::PRESENT_SRC_KHR];
        let begin = [change(Layout::UNDEFINED, to)];
        let end = [change(to, shown)];
        let none = vk::DependencyFlags::empty();
        let raw = self.device.raw();
        // SAFETY: the caller's obligations. Both formats can be copied between on any device.
        unsafe {
            raw.cmd_pipeline_barrier(cmd, Stage::TRANSFER, Stage::TRANSFER, none, &[], &[], &begin);
            raw.cmd_blit_image(cmd, picture, from, image, to, &blit, vk::Filter::NEAREST);
            raw.cmd_pipeline_barrier(cmd, Stage::TRANSFER, Stage::TRANSFER, none, &[], &[], &end);
        }
    }

    /// Presents an image that has been copied to; returns whether the window still has this size.
    pub fn present(&self, index: u32) -> Result<bool> {
        let info = vk::PresentInfoKHR::default().swapchains(from_ref(&self.raw)).image_indices(from_ref(&index));
        // SAFETY: the image was acquired; the copy was waited for, so there is no semaphore.
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
        self.device.wait_idle();
        // SAFETY: ours, destroyed once; nothing uses them after the wait.
        unsafe {
            self.device.swapchains.destroy_swapchain(self.raw, None);
            self.device.raw().destroy_fence(self.acquired, None);
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
