//! Draws the panel over the picture.

use super::device::{Device, failed, failure};
use crate::output::{Failure, Result};
use deltamorph::ash::vk;
use deltamorph_headless::{framebuffer, render_pass};
use deltamorph_render::Target;
use egui::{ClippedPrimitive, FullOutput, TextureId};
use egui_ash_renderer::allocator::DefaultAllocator;
use egui_ash_renderer::{Options, RenderMode, Renderer};
use std::rc::Rc;
use vk::{AccessFlags as Access, PipelineStageFlags as Stage};

/// Draws egui's output over a target. One frame is drawn at a time.
pub struct Painter {
    renderer: Option<Renderer<DefaultAllocator>>,
    pass: vk::RenderPass,
    pool: vk::CommandPool,
    framebuffer: vk::Framebuffer,
    extent: vk::Extent2D,
    /// The next frame.
    primitives: Vec<ClippedPrimitive>,
    pixels_per_point: f32,
    /// Textures that are not needed after it.
    free: Vec<TextureId>,
    device: Rc<Device>,
}

fn not_drawn(error: impl std::fmt::Display) -> Failure {
    Failure::Failed(format!("the panel cannot be drawn: {error}; update the driver, or use `deltamorph render`"))
}

impl Painter {
    pub fn new(device: &Rc<Device>) -> Result<Self> {
        let mut this = Self {
            renderer: None,
            pass: vk::RenderPass::null(),
            pool: vk::CommandPool::null(),
            framebuffer: vk::Framebuffer::null(),
            extent: vk::Extent2D::default(),
            primitives: vec![],
            pixels_per_point: 1.0,
            free: vec![],
            device: device.clone(),
        };
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(device.headless.queue().1);
        // SAFETY: the device has this queue family; `drop` destroys the pool.
        let pool = unsafe { device.raw().create_command_pool(&info, None) };
        this.pool = pool.map_err(failed("vkCreateCommandPool"))?;
        this.make_pass()?;
        let options = Options { in_flight_frames: 1, srgb_framebuffer: true, ..Options::default() };
        let (instance, physical, raw) = device.headless.handles();
        let mode = RenderMode::RenderPass(this.pass);
        let made = Renderer::with_default_allocator(instance, physical, raw.clone(), mode, options);
        this.renderer = Some(made.map_err(not_drawn)?);
        Ok(this)
    }

    /// Makes the pass over a picture, which is ready for copies before and after.
    fn make_pass(&mut self) -> Result<()> {
        let copied = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        let attachments = [vk::AttachmentDescription::default()
            .format(Target::FORMAT)
            .samples(vk::SampleCountFlags::TYPE_1)
            .load_op(vk::AttachmentLoadOp::LOAD)
            .store_op(vk::AttachmentStoreOp::STORE)
            .initial_layout(copied)
            .final_layout(copied)];
        let layout = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
        let colour = [vk::AttachmentReference { attachment: 0, layout }];
        let subpass = vk::SubpassDescription::default().color_attachments(&colour);
        let written = vk::SubpassDependency::default()
            .src_stage_mask(Stage::COLOR_ATTACHMENT_OUTPUT)
            .src_access_mask(Access::COLOR_ATTACHMENT_WRITE);
        let dependencies = [
            written
                .src_subpass(vk::SUBPASS_EXTERNAL)
                .dst_stage_mask(Stage::COLOR_ATTACHMENT_OUTPUT)
                .dst_access_mask(Access::COLOR_ATTACHMENT_READ | Access::COLOR_ATTACHMENT_WRITE),
            written
                .dst_subpass(vk::SUBPASS_EXTERNAL)
                .dst_stage_mask(Stage::TRANSFER)
                .dst_access_mask(Access::TRANSFER_READ),
        ];
        let device = self.device.headless.engine().device();
        self.pass = render_pass(device, &attachments, &subpass, &dependencies).map_err(failure)?;
        Ok(())
    }

    /// Draws over `target` from now on.
    pub fn set_target(&mut self, target: &Target) -> Result<()> {
        let [width, height] = target.size();
        self.extent = vk::Extent2D { width, height };
        let device = self.device.headless.engine().device();
        // SAFETY: the view is alive, and of the pass's format; no frame is being drawn into the old framebuffer.
        unsafe {
            device.raw.destroy_framebuffer(std::mem::take(&mut self.framebuffer), None);
            self.framebuffer = framebuffer(device, self.pass, &[target.image().1], [width, height]).map_err(failure)?;
        }
        Ok(())
    }

    /// Takes egui's output for the next frame, and uploads its textures. The frame before has been drawn.
    pub fn take(&mut self, context: &egui::Context, output: FullOutput) -> Result<()> {
        let FullOutput { shapes, pixels_per_point, mut textures_delta, .. } = output;
        (self.primitives, self.pixels_per_point) = (context.tessellate(shapes, pixels_per_point), pixels_per_point);
        let Some(renderer) = &mut self.renderer else { return Ok(()) };
        for id in std::mem::replace(&mut self.free, textures_delta.free.drain().collect()) {
            renderer.free_texture(id).map_err(not_drawn)?;
        }
        let queue = self.device.headless.queue().0;
        for (id, deltas) in textures_delta.set.drain() {
            for delta in deltas {
                renderer.set_texture(queue, self.pool, id, &delta).map_err(not_drawn)?;
            }
        }
        Ok(())
    }

    /// Records the pass.
    ///
    /// # Safety
    /// `cmd` is recording, outside a render pass; the target is alive, and a picture has been drawn into it.
    pub unsafe fn record(&mut self, cmd: vk::CommandBuffer) -> Result<()> {
        let device = self.device.raw();
        let area = vk::Rect2D { extent: self.extent, ..Default::default() };
        let begin = vk::RenderPassBeginInfo::default().render_pass(self.pass).framebuffer(self.framebuffer);
        // SAFETY: the caller's obligations.
        unsafe { device.cmd_begin_render_pass(cmd, &begin.render_area(area), vk::SubpassContents::INLINE) };
        let drawn = self.renderer.as_mut().map_or(Ok(()), |renderer| {
            renderer.cmd_draw(cmd, self.extent, self.pixels_per_point, &self.primitives).map_err(not_drawn)
        });
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
        drawn
    }
}

impl Drop for Painter {
    fn drop(&mut self) {
        self.renderer = None;
        let device = self.device.raw();
        // SAFETY: ours, destroyed once; no frame is being drawn.
        unsafe {
            device.destroy_framebuffer(self.framebuffer, None);
            device.destroy_render_pass(self.pass, None);
            device.destroy_command_pool(self.pool, None);
        }
    }
}
