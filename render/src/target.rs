//! What a frame is drawn into.

use crate::memory::{Buffer, Gpu, Image, ImageDesc, failed};
use crate::passes::{SAMPLES, SHADOW_EDGE, SHADOW_FORMAT};
use crate::renderer::Renderer;
use crate::scene::{Head, HeadScene, Scene};
use bytemuck::bytes_of;
use deltamorph::ash::vk;
use deltamorph::{Error, Result};
use std::slice::from_ref;
use std::sync::Arc;

/// An image view of the host's, and what else a frame takes: samples, depth, a shadow map, and what shaders are told. One for
/// each frame in flight, or for each image of a swapchain.
pub struct Target {
    gpu: Arc<Gpu>,
    pub(crate) extent: vk::Extent2D,
    pub(crate) framebuffer: vk::Framebuffer,
    pub(crate) shadow_framebuffer: vk::Framebuffer,
    pub(crate) set: vk::DescriptorSet,
    pool: vk::DescriptorPool,
    heads: usize,
    /// Bytes from what is told of a head to the next.
    stride: usize,
    scenes: Buffer,
    _images: [Image; 3],
}

impl Target {
    /// To draw up to `heads` heads into `view`, an image of `extent` in the renderer's format that may be drawn into.
    ///
    /// # Errors
    /// No memory.
    ///
    /// # Safety
    /// The view is alive, on the renderer's device, and as described.
    pub unsafe fn new(renderer: &Renderer, view: vk::ImageView, extent: vk::Extent2D, heads: u32) -> Result<Self> {
        use vk::ImageUsageFlags as Usage;
        let (gpu, heads) = (renderer.gpu.clone(), heads.max(1) as usize);
        let of = |extent, format, samples, usage, aspect| {
            Image::new(&gpu, &ImageDesc { extent, format, samples, usage, aspect })
        };
        let (depth, passing) = (Usage::DEPTH_STENCIL_ATTACHMENT, Usage::TRANSIENT_ATTACHMENT);
        let (format, one) = (renderer.desc.format, vk::SampleCountFlags::TYPE_1);
        let (coloured, deep) = (vk::ImageAspectFlags::COLOR, vk::ImageAspectFlags::DEPTH);
        let edge = vk::Extent2D { width: SHADOW_EDGE, height: SHADOW_EDGE };
        let images = [
            of(extent, format, SAMPLES, Usage::COLOR_ATTACHMENT | passing, coloured)?,
            of(extent, renderer.depth_format, SAMPLES, depth | passing, deep)?,
            of(edge, SHADOW_FORMAT, one, depth | Usage::SAMPLED, deep)?,
        ];
        let alignment = gpu.limits.min_uniform_buffer_offset_alignment as usize;
        let stride = size_of::<HeadScene>().next_multiple_of(alignment.max(1));
        let scenes = Buffer::new(&gpu, stride * heads, vk::BufferUsageFlags::UNIFORM_BUFFER, false)?;
        let (framebuffer, set, pool) = (vk::Framebuffer::null(), vk::DescriptorSet::null(), vk::DescriptorPool::null());
        let shadow_framebuffer = framebuffer;
        let mut this =
            Self { gpu, extent, framebuffer, shadow_framebuffer, set, pool, heads, stride, scenes, _images: images };
        let views = [this._images[0].view, this._images[1].view, view];
        this.framebuffer = this.framebuffer(renderer.pass, &views, extent)?;
        this.shadow_framebuffer = this.framebuffer(renderer.shadow_pass, &[this._images[2].view], edge)?;
        this.make_set(renderer)?;
        Ok(this)
    }

    fn framebuffer(
        &self,
        pass: vk::RenderPass,
        views: &[vk::ImageView],
        extent: vk::Extent2D,
    ) -> Result<vk::Framebuffer> {
        let info = vk::FramebufferCreateInfo::default().render_pass(pass).attachments(views).layers(1);
        // SAFETY: the device is alive as long as `gpu`; the views are what the pass was made for.
        let made = unsafe { self.gpu.device.create_framebuffer(&info.width(extent.width).height(extent.height), None) };
        made.map_err(failed("vkCreateFramebuffer"))
    }

    fn make_set(&mut self, renderer: &Renderer) -> Result<()> {
        let device = &self.gpu.device;
        let kinds = [vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC, vk::DescriptorType::COMBINED_IMAGE_SAMPLER];
        let sizes = kinds.map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: 1 });
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: as in `framebuffer`; the set is of the pool, and goes with it.
        unsafe {
            self.pool = device.create_descriptor_pool(&info, None).map_err(failed("vkCreateDescriptorPool"))?;
            let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pool);
            let sets = device.allocate_descriptor_sets(&info.set_layouts(from_ref(&renderer.set_layout)));
            self.set = sets.map_err(failed("vkAllocateDescriptorSets"))?[0];
        }
        let told = [vk::DescriptorBufferInfo::default().buffer(self.scenes.raw).range(size_of::<HeadScene>() as u64)];
        let map = [vk::DescriptorImageInfo::default()
            .image_view(self._images[2].view)
            .image_layout(vk::ImageLayout::DEPTH_STENCIL_READ_ONLY_OPTIMAL)
            .sampler(renderer.sampler)];
        let write = |binding: u32| {
            let kind = kinds[binding as usize];
            vk::WriteDescriptorSet::default().dst_set(self.set).dst_binding(binding).descriptor_type(kind)
        };
        // SAFETY: the set is new; buffer, image and sampler are alive.
        unsafe { device.update_descriptor_sets(&[write(0).buffer_info(&told), write(1).image_info(&map)], &[]) };
        Ok(())
    }

    /// Tell the shaders of the scene. Nothing recorded with the target before is still to run.
    pub(crate) fn write(&mut self, scene: &Scene, heads: &[Head]) -> Result<()> {
        if heads.len() > self.heads {
            return Err(Error::Invalid {
                what: format!("{} heads in a target of {}", heads.len(), self.heads),
                remedy: "make the target for as many".into(),
            });
        }
        for (i, head) in heads.iter().enumerate() {
            let told = scene.head(&head.place, 1.0 / SHADOW_EDGE as f32);
            self.scenes.write(i * self.stride, bytes_of(&told));
        }
        Ok(())
    }

    /// Where what is told of a head begins.
    pub(crate) fn offset_of(&self, head: usize) -> u32 {
        (head * self.stride) as u32
    }
}

impl Drop for Target {
    fn drop(&mut self) {
        // SAFETY: ours, destroyed once, and not in use: see `Renderer::new`.
        unsafe {
            self.gpu.device.destroy_descriptor_pool(self.pool, None);
            self.gpu.device.destroy_framebuffer(self.framebuffer, None);
            self.gpu.device.destroy_framebuffer(self.shadow_framebuffer, None);
        }
    }
}
