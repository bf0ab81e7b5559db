//! The commands of a draw.

use crate::model::Model;
use crate::passes::SHADOW_EDGE;
use crate::renderer::Renderer;
use crate::scene::{Head, PartPush, Scene};
use crate::target::Target;
use bytemuck::bytes_of;
use deltamorph::Result;
use deltamorph::ash::vk;
use std::slice::from_ref;

impl Renderer {
    /// Draw heads of `model` into `target`, in front of `background` (linear red, green, blue, and opacity).
    ///
    /// This records: a pass into the target's shadow map, and a pass into its image, which ends in the layout of
    /// [`RendererDesc::layout`](crate::RendererDesc), ready for copies (`TRANSFER`) and for draws over it (`COLOR_ATTACHMENT_OUTPUT`). What was
    /// bound before is bound no longer.
    ///
    /// # Errors
    /// More heads than the target was made for.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer that is recording on the renderer's device, outside a render pass, on a queue
    ///   with graphics.
    /// - Model and target were made with this renderer; nothing recorded with the target before is still to run. Its image
    ///   view is alive.
    /// - The poses are of the renderer's format and of the model's mesh, tightly packed, ready for vertex-attribute reads,
    ///   and alive until this has run.
    pub unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        target: &mut Target,
        model: &Model,
        heads: &[Head],
        scene: &Scene,
        background: [f32; 4],
    ) -> Result<()> {
        target.write(scene, heads)?;
        let device = &self.gpu.device;
        let far = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: 1.0, stencil: 0 } };
        let behind = vk::ClearValue { color: vk::ClearColorValue { float32: background } };
        let edge = vk::Extent2D { width: SHADOW_EDGE, height: SHADOW_EDGE };
        let passes = [
            (self.shadow_pass, target.shadow_framebuffer, edge, &[far][..], self.shadow),
            (self.pass, target.framebuffer, target.extent, &[behind, far], self.shaded),
        ];
        for (pass, framebuffer, extent, clear, pipeline) in passes {
            let area = vk::Rect2D { extent, ..Default::default() };
            let begin = vk::RenderPassBeginInfo::default().render_pass(pass).framebuffer(framebuffer);
            let begin = begin.render_area(area).clear_values(clear);
            let viewport = vk::Viewport {
                width: extent.width as f32,
                height: extent.height as f32,
                max_depth: 1.0,
                ..Default::default()
            };
            // SAFETY: `cmd` is recording (the caller's obligations); passes, framebuffers and pipelines go together.
            unsafe {
                device.cmd_begin_render_pass(cmd, &begin, vk::SubpassContents::INLINE);
                device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
                device.cmd_set_viewport(cmd, 0, from_ref(&viewport));
                device.cmd_set_scissor(cmd, 0, from_ref(&area));
            }
            for (i, head) in heads.iter().enumerate() {
                // SAFETY: as above; the target has room for what is told of so many heads, and the poses are those of the
                // mesh.
                unsafe { self.record_head(cmd, target, model, head, i, pass == self.pass) };
            }
            // SAFETY: begun above.
            unsafe { device.cmd_end_render_pass(cmd) };
        }
        Ok(())
    }

    /// # Safety
    /// As [`record`](Self::record), with `cmd` inside a pass whose pipeline is bound; the target knows of `number` heads
    /// and one more.
    unsafe fn record_head(
        &self,
        cmd: vk::CommandBuffer,
        target: &Target,
        model: &Model,
        head: &Head,
        number: usize,
        colours: bool,
    ) {
        let device = &self.gpu.device;
        let (base, both) = (&model.base, vk::ShaderStageFlags::VERTEX | vk::ShaderStageFlags::FRAGMENT);
        let buffers = [head.buffer, base.0, model.texcoords.raw, model.values.raw];
        let offsets = [head.offset, base.1, 0, 0];
        let bound = if colours { 4 } else { self.desc.pose.vertex_input(false).0.len() };
        // SAFETY: the caller's obligations; model and target are alive.
        unsafe {
            let (point, dynamic) = (vk::PipelineBindPoint::GRAPHICS, target.offset_of(number));
            device.cmd_bind_descriptor_sets(cmd, point, self.layout, 0, &[target.set], &[dynamic]);
            device.cmd_bind_vertex_buffers(cmd, 0, &buffers[..bound], &offsets[..bound]);
            device.cmd_bind_index_buffer(cmd, model.indices.raw, 0, vk::IndexType::UINT32);
        }
        for part in &model.parts {
            let push = PartPush {
                ball: part.ball.unwrap_or_default().to_array(),
                units: head.units,
                material: part.material as u32,
            };
            // SAFETY: as above; the part's indices are in the buffer.
            unsafe {
                device.cmd_push_constants(cmd, self.layout, both, 0, bytes_of(&push));
                device.cmd_draw_indexed(cmd, part.indices.len() as u32, 1, part.indices.start, 0, 0);
            }
        }
    }
}
