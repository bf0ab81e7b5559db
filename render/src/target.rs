//! The images and buffers that a frame is drawn into.

use crate::cull::is_outside;
use crate::glow::Glow;
use crate::memory::{Buffer, buffer, image, write};
use crate::model::Model;
use crate::passes::{FORMAT, SAMPLES, SHADOW_EDGE, SHADOW_FORMAT};
use crate::renderer::Renderer;
use crate::scene::{Head, HeadScene, Scene};
use bytemuck::{bytes_of, cast_slice};
use deltamorph::ash::vk;
use deltamorph::internals::gpu::device::Device;
use deltamorph::{Error, Result};
use deltamorph_headless::{Image, framebuffer};
use glam::{Mat4, Vec3};
use std::slice::from_ref;
use std::sync::Arc;

/// A picture: red, green, blue and opacity of each pixel in sRGB, row by row from the top. Colours are multiplied by
/// the opacity before encoding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width and height, in pixels.
    pub size: [u32; 2],
    /// Four bytes per pixel.
    pub rgba: Vec<u8>,
}

/// An image to draw into, with the other resources of a frame: samples, depth, a shadow map, data for shaders, and a
/// buffer for pixels.
pub struct Target {
    gpu: Arc<Device>,
    pub(crate) extent: vk::Extent2D,
    pub(crate) framebuffer: vk::Framebuffer,
    pub(crate) shadow_framebuffer: vk::Framebuffer,
    pub(crate) set: vk::DescriptorSet,
    pool: vk::DescriptorPool,
    heads: usize,
    /// Bytes from the data of one head to that of the next.
    stride: usize,
    scenes: Buffer,
    /// Shader data of each head besides the scene: the brightness of its pieces, `[head][piece]`; a single number
    /// before any is set.
    glow: Buffer,
    /// Numbers per head; 0 before any are set.
    numbers: usize,
    pixels: Buffer,
    image: Image,
    samples: Image,
    depth: Image,
    shadow_map: Image,
}

impl Target {
    /// The format of its image.
    pub const FORMAT: vk::Format = FORMAT;

    /// Makes a target of this width and height for up to `heads` heads.
    ///
    /// # Errors
    /// It has no pixels, or more than the device draws; there is no memory.
    pub(crate) fn new(renderer: &Renderer, size: [u32; 2], heads: u32) -> Result<Self> {
        use vk::ImageUsageFlags as Usage;
        let gpu = renderer.gpu.clone();
        let heads = heads.max(1) as usize;
        let most = renderer.limits.max_image_dimension2_d.min(renderer.limits.max_framebuffer_width);
        let [width, height] = size;
        if width == 0 || height == 0 || width.max(height) > most {
            return Err(Error::invalid(
                format!("a picture of {width} × {height} pixels"),
                format!("the device draws 1 to {most} pixels across and down"),
            ));
        }
        let extent = vk::Extent2D { width, height };
        let depth = Usage::DEPTH_STENCIL_ATTACHMENT;
        let passing = Usage::TRANSIENT_ATTACHMENT;
        let one = vk::SampleCountFlags::TYPE_1;
        let edge = vk::Extent2D { width: SHADOW_EDGE, height: SHADOW_EDGE };
        let samples = image(&gpu, extent, FORMAT, SAMPLES, Usage::COLOR_ATTACHMENT | passing)?;
        let shadow_map = image(&gpu, edge, SHADOW_FORMAT, one, depth | Usage::SAMPLED)?;
        let depth = image(&gpu, extent, renderer.depth_format, SAMPLES, depth | passing)?;
        let image = image(&gpu, extent, FORMAT, one, Usage::COLOR_ATTACHMENT | Usage::TRANSFER_SRC)?;
        let bytes = width as usize * height as usize * 4;
        let pixels = buffer(&gpu, bytes, vk::BufferUsageFlags::TRANSFER_DST)?;
        let alignment = renderer.limits.min_uniform_buffer_offset_alignment as usize;
        let stride = size_of::<HeadScene>().next_multiple_of(alignment.max(1));
        let scenes = buffer(&gpu, stride * heads, vk::BufferUsageFlags::UNIFORM_BUFFER)?;
        let glow = buffer(&gpu, 4, vk::BufferUsageFlags::STORAGE_BUFFER)?;
        let mut this = Self {
            gpu,
            extent,
            framebuffer: vk::Framebuffer::null(),
            shadow_framebuffer: vk::Framebuffer::null(),
            set: vk::DescriptorSet::null(),
            pool: vk::DescriptorPool::null(),
            heads,
            stride,
            scenes,
            glow,
            numbers: 0,
            pixels,
            image,
            samples,
            depth,
            shadow_map,
        };
        let views = [&this.samples, &this.depth, &this.image].map(|image| image.views[0]);
        let map = this.shadow_map.views[0];
        // SAFETY: the views are the target's, and match the passes of the renderer.
        unsafe {
            this.framebuffer = framebuffer(&this.gpu, renderer.pass, &views, size)?;
            this.shadow_framebuffer = framebuffer(&this.gpu, renderer.shadow_pass, &[map], [SHADOW_EDGE; 2])?;
        }
        this.make_set(renderer)?;
        Ok(this)
    }

    /// Returns the image, and a view of it. After [`Heads::record`](crate::Heads::record) it is in
    /// `TRANSFER_SRC_OPTIMAL`.
    pub fn image(&self) -> (vk::Image, vk::ImageView) {
        (self.image.raw, self.image.views[0])
    }

    /// Returns width and height.
    pub fn size(&self) -> [u32; 2] {
        [self.extent.width, self.extent.height]
    }

    /// Records a copy of the image's pixels, for [`picture`](Self::picture).
    ///
    /// # Safety
    /// `cmd` is recording on the device, outside a render pass; the image is in `TRANSFER_SRC_OPTIMAL`, ready for
    /// copies.
    pub unsafe fn copy_pixels(&self, cmd: vk::CommandBuffer) {
        let layer = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let region = [vk::BufferImageCopy::default().image_subresource(layer).image_extent(self.extent.into())];
        let read = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
            .dst_access_mask(vk::AccessFlags::HOST_READ)];
        let device = &self.gpu.raw;
        let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        let [from, to] = [vk::PipelineStageFlags::TRANSFER, vk::PipelineStageFlags::HOST];
        // SAFETY: the caller's obligations; the buffer has room for the pixels of the image.
        unsafe {
            device.cmd_copy_image_to_buffer(cmd, self.image.raw, layout, self.pixels.raw, &region);
            device.cmd_pipeline_barrier(cmd, from, to, Default::default(), &read, &[], &[]);
        }
    }

    /// Returns the pixels of the last copy, which has run.
    ///
    /// # Errors
    /// The device has not mapped them.
    pub fn picture(&mut self) -> Result<Picture> {
        let [width, height] = self.size();
        let rgba = self.pixels.mapped()?[..width as usize * height as usize * 4].to_vec();
        Ok(Picture { size: [width, height], rgba })
    }

    fn make_set(&mut self, renderer: &Renderer) -> Result<()> {
        let device = &self.gpu.raw;
        let kinds = [
            vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC,
            vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            vk::DescriptorType::STORAGE_BUFFER,
        ];
        let sizes = kinds.map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: 1 });
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: the device is alive as long as `gpu`; the set is of the pool, and goes with it.
        unsafe {
            self.pool = device.create_descriptor_pool(&info, None).map_err(Error::vulkan("vkCreateDescriptorPool"))?;
            let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pool);
            let sets = device.allocate_descriptor_sets(&info.set_layouts(from_ref(&renderer.set_layout)));
            self.set = sets.map_err(Error::vulkan("vkAllocateDescriptorSets"))?[0];
        }
        let scenes = [vk::DescriptorBufferInfo::default().buffer(self.scenes.raw).range(size_of::<HeadScene>() as u64)];
        let map = [vk::DescriptorImageInfo::default()
            .image_view(self.shadow_map.views[0])
            .image_layout(vk::ImageLayout::DEPTH_STENCIL_READ_ONLY_OPTIMAL)
            .sampler(renderer.sampler)];
        let write = |binding: u32| {
            let kind = kinds[binding as usize];
            vk::WriteDescriptorSet::default().dst_set(self.set).dst_binding(binding).descriptor_type(kind)
        };
        // SAFETY: the set is new; buffer, image and sampler are alive.
        unsafe { device.update_descriptor_sets(&[write(0).buffer_info(&scenes), write(1).image_info(&map)], &[]) };
        self.bind_glow();
        Ok(())
    }

    fn bind_glow(&self) {
        let glow = [vk::DescriptorBufferInfo::default().buffer(self.glow.raw).range(vk::WHOLE_SIZE)];
        let write = vk::WriteDescriptorSet::default().dst_set(self.set).dst_binding(2).buffer_info(&glow);
        let write = write.descriptor_type(vk::DescriptorType::STORAGE_BUFFER);
        // SAFETY: the set is not in use: it is new, or no commands recorded with the target are still to run.
        unsafe { self.gpu.raw.update_descriptor_sets(&[write], &[]) };
    }

    /// Sets the brightness of the pieces of a head, for [`Show::Blocks`](crate::Show::Blocks), from the next draw on.
    /// All heads that are drawn need one.
    ///
    /// # Errors
    /// There is no memory.
    ///
    /// # Safety
    /// No commands recorded with the target before are still to run.
    pub(crate) unsafe fn set_glow(&mut self, head: usize, glow: &Glow) -> Result<()> {
        let numbers = glow.pieces();
        if self.numbers != numbers.len() {
            let bytes = 4 * numbers.len() * self.heads;
            self.glow = buffer(&self.gpu, bytes, vk::BufferUsageFlags::STORAGE_BUFFER)?;
            self.numbers = numbers.len();
            self.bind_glow();
        }
        write(&mut self.glow, 4 * head * numbers.len(), cast_slice(numbers))
    }

    /// Returns the number of brightness values per head.
    pub(crate) fn glow_numbers(&self) -> usize {
        self.numbers
    }

    /// Writes the scene for the shaders, and returns whether each head may be visible in the shadow map, and in the
    /// picture. No commands recorded with the target before are still to run.
    pub(crate) fn write(&mut self, scene: &Scene, model: &Model, heads: &[Head]) -> Result<Vec<[bool; 2]>> {
        let map = Mat4::from_translation(Vec3::new(-1.0, -1.0, 0.0)) * Mat4::from_scale(Vec3::new(2.0, 2.0, 1.0));
        let of_head = |(i, head): (usize, &Head)| {
            let data = scene.head(&head.place, model.middle, 1.0 / SHADOW_EDGE as f32);
            write(&mut self.scenes, i * self.stride, bytes_of(&data))?;
            // Still parts may reach beyond the pose.
            let bounds = head.bounds.filter(|_| model.still.is_none());
            Ok([map * data.shadow, data.clip].map(|clip| !bounds.is_some_and(|bounds| is_outside(&clip, &bounds))))
        };
        heads.iter().enumerate().map(of_head).collect()
    }

    /// Returns the offset of a head's scene data.
    pub(crate) fn offset_of(&self, head: usize) -> u32 {
        (head * self.stride) as u32
    }
}

impl Drop for Target {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, and not in use: see `Renderer::new`.
        unsafe {
            self.gpu.raw.destroy_descriptor_pool(self.pool, None);
            self.gpu.raw.destroy_framebuffer(self.framebuffer, None);
            self.gpu.raw.destroy_framebuffer(self.shadow_framebuffer, None);
        }
    }
}
