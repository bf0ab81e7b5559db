//! The panel, drawn over the instances.

use super::device::Device;
use super::heads::IN_FLIGHT;
use crate::output::Failure;
use deltamorph::ash::vk;
use egui::epaint::ImageDelta;
use egui::{ClippedPrimitive, FullOutput, TextureId};
use egui_ash_renderer::allocator::DefaultAllocator;
use egui_ash_renderer::{Options, RenderMode, Renderer};
use std::rc::Rc;
use vk::{AccessFlags as Access, PipelineStageFlags as Stage};

/// egui's output for a frame.
pub struct Picture {
    pub primitives: Vec<ClippedPrimitive>,
    /// New or changed textures, in order, and those to free after the frame.
    pub set: Vec<(TextureId, ImageDelta)>,
    pub free: Vec<TextureId>,
    pub pixels_per_point: f32,
}

impl Picture {
    /// Tessellates a frame of egui.
    pub fn new(context: &egui::Context, output: FullOutput) -> Self {
        let FullOutput { shapes, pixels_per_point, mut textures_delta, .. } = output;
        let set = textures_delta.set.drain();
        let set = set.flat_map(|(id, deltas)| deltas.into_iter().map(move |delta| (id, delta))).collect();
        let free = textures_delta.free.drain().collect();
        Self { primitives: context.tessellate(shapes, pixels_per_point), set, free, pixels_per_point }
    }
}

/// Draws egui's output over images.
pub struct Painter {
    renderer: Option<Renderer<DefaultAllocator>>,
    pub pass: vk::RenderPass,
    device: Rc<Device>,
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::Failed(format!("the panel cannot be drawn: {error}; look at the driver, or use `deltamorph render`"))
}

impl Painter {
    /// A painter for images of this format, which are presented next.
    pub fn new(device: &Rc<Device>, format: vk::Format) -> Result<Self, Failure> {
        let drawn = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
        let attachments = [vk::AttachmentDescription::default()
            .format(format)
            .samples(vk::SampleCountFlags::TYPE_1)
            .load_op(vk::AttachmentLoadOp::LOAD)
            .store_op(vk::AttachmentStoreOp::STORE)
            .initial_layout(drawn)
            .final_layout(vk::ImageLayout::PRESENT_SRC_KHR)];
        let colour = [vk::AttachmentReference { attachment: 0, layout: drawn }];
        let subpasses = [vk::SubpassDescription::default().color_attachments(&colour)];
        // After earlier drawing, and before copying to a file. Presenting waits for a semaphore.
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
        let info = vk::RenderPassCreateInfo::default().attachments(&attachments).subpasses(&subpasses);
        // SAFETY: the device is alive; destroyed by `drop`.
        let pass = unsafe { device.raw().create_render_pass(&info.dependencies(&dependencies), None) };
        let pass = pass.map_err(super::device::failed("vkCreateRenderPass"))?;
        let mut this = Self { renderer: None, pass, device: device.clone() };
        let options = Options { in_flight_frames: IN_FLIGHT, srgb_framebuffer: true, ..Options::default() };
        let instance = device.instance();
        let raw = device.raw().clone();
        let mode = RenderMode::RenderPass(this.pass);
        let made = Renderer::with_default_allocator(instance, device.physical(), raw, mode, options);
        this.renderer = Some(made.map_err(failed)?);
        Ok(this)
    }

    /// Uploads new or changed textures, before the frame is recorded. Waits for the queue if there are any.
    pub fn set_textures(&mut self, pool: vk::CommandPool, picture: &Picture) -> Result<(), Failure> {
        let Some(renderer) = &mut self.renderer else { return Ok(()) };
        let mut set = picture.set.iter();
        set.try_for_each(|(id, delta)| {
            renderer.set_texture(self.device.headless.queue().0, pool, *id, delta).map_err(failed)
        })
    }

    /// Frees textures that no frame uses any longer.
    pub fn free_textures(&mut self, ids: &[TextureId]) -> Result<(), Failure> {
        let Some(renderer) = &mut self.renderer else { return Ok(()) };
        ids.iter().try_for_each(|id| renderer.free_texture(*id).map_err(failed))
    }

    /// Records the pass over an image.
    ///
    /// # Safety
    /// `cmd` is recording, outside a render pass; the framebuffer matches this pass and extent.
    pub unsafe fn record(
        &mut self,
        cmd: vk::CommandBuffer,
        framebuffer: vk::Framebuffer,
        extent: vk::Extent2D,
        picture: &Picture,
    ) -> Result<(), Failure> {
        let device = self.device.raw();
        let area = vk::Rect2D { extent, ..Default::default() };
        let begin = vk::RenderPassBeginInfo::default().render_pass(self.pass).framebuffer(framebuffer);
        // SAFETY: the caller's obligations.
        unsafe { device.cmd_begin_render_pass(cmd, &begin.render_area(area), vk::SubpassContents::INLINE) };
        let drawn = self.renderer.as_mut().map_or(Ok(()), |renderer| {
            renderer.cmd_draw(cmd, extent, picture.pixels_per_point, &picture.primitives).map_err(failed)
        });
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
        drawn
    }
}

impl Drop for Painter {
    fn drop(&mut self) {
        self.renderer = None;
        // SAFETY: ours, destroyed once; the owner waited until nothing uses it.
        unsafe { self.device.raw().destroy_render_pass(self.pass, None) };
    }
}
