//! What a frame is drawn into.

use crate::glow::Glow;
use crate::memory::{Buffer, Gpu, Image, ImageDesc, failed};
use crate::model::Model;
use crate::passes::{SAMPLES, SHADOW_EDGE, SHADOW_FORMAT};
use crate::renderer::Renderer;
use crate::scene::{Head, HeadScene, Scene, Show};
use bytemuck::{bytes_of, cast_slice};
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
    /// What shaders are told of each head beside the scene: how bright its pieces are, `[head][piece]`; a single number while
    /// there is nothing.
    told: Buffer,
    /// Numbers of a head; 0 while there are none.
    numbers: usize,
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
        let told = Buffer::new(&gpu, 4, vk::BufferUsageFlags::STORAGE_BUFFER, false)?;
        let (framebuffer, set, pool) = (vk::Framebuffer::null(), vk::DescriptorSet::null(), vk::DescriptorPool::null());
        let shadow_framebuffer = framebuffer;
        let mut this = Self {
            gpu,
            extent,
            framebuffer,
            shadow_framebuffer,
            set,
            pool,
            heads,
            stride,
            scenes,
            told,
            numbers: 0,
            _images: images,
        };
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
        let kinds = [
            vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC,
            vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            vk::DescriptorType::STORAGE_BUFFER,
        ];
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
        self.bind_told();
        Ok(())
    }

    fn bind_told(&self) {
        let told = [vk::DescriptorBufferInfo::default().buffer(self.told.raw).range(vk::WHOLE_SIZE)];
        let write = vk::WriteDescriptorSet::default().dst_set(self.set).dst_binding(2).buffer_info(&told);
        let write = write.descriptor_type(vk::DescriptorType::STORAGE_BUFFER);
        // SAFETY: the set is in no use: it is new, or nothing that was recorded with the target is still to run.
        unsafe { self.gpu.device.update_descriptor_sets(&[write], &[]) };
    }

    /// Say how bright the pieces of a head are, for [`Show::Blocks`](crate::Show::Blocks), from the next draw on. All heads
    /// that are drawn need one.
    ///
    /// # Errors
    /// A head that the target has no place for; no memory.
    ///
    /// # Safety
    /// Nothing recorded with the target before is still to run.
    pub unsafe fn set_glow(&mut self, head: usize, glow: &Glow) -> Result<()> {
        let numbers = glow.pieces();
        self.check_heads(head + 1)?;
        if self.numbers != numbers.len() {
            let bytes = (4 * numbers.len() * self.heads).max(4);
            self.told = Buffer::new(&self.gpu, bytes, vk::BufferUsageFlags::STORAGE_BUFFER, false)?;
            self.numbers = numbers.len();
            self.bind_told();
        }
        self.told.write(4 * head * numbers.len(), cast_slice(numbers));
        Ok(())
    }

    /// Numbers that are told of a head.
    pub(crate) fn told(&self) -> usize {
        self.numbers
    }

    /// Refuse to show what nothing was told of.
    pub(crate) fn check_told(&self, model: &Model, show: Show) -> Result<()> {
        if show != Show::Blocks || self.numbers == model.pieces {
            return Ok(());
        }
        let what = format!("{} pieces that glow, where the mesh has {}", self.numbers, model.pieces);
        Err(Error::Invalid { what, remedy: "hand a Glow of the mesh to Target::set_glow first".into() })
    }

    fn check_heads(&self, heads: usize) -> Result<()> {
        if heads <= self.heads {
            return Ok(());
        }
        Err(Error::Invalid {
            what: format!("{heads} heads in a target of {}", self.heads),
            remedy: "make the target for as many".into(),
        })
    }

    /// Tell the shaders of the scene. Nothing recorded with the target before is still to run.
    pub(crate) fn write(&mut self, scene: &Scene, model: &Model, heads: &[Head]) -> Result<()> {
        self.check_heads(heads.len())?;
        for (i, head) in heads.iter().enumerate() {
            let told = scene.head(&head.place, model.middle, 1.0 / SHADOW_EDGE as f32);
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
