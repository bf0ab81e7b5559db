//! The commands of a draw.

use crate::model::{Drawn, Model};
use crate::parts::Material;
use crate::passes::SHADOW_EDGE;
use crate::renderer::{MASK_BINDING, Renderer};
use crate::scene::{Head, PartPush, Scene, Show};
use crate::target::Target;
use bytemuck::bytes_of;
use deltamorph::ash::vk;
use deltamorph::{Error, Result};
use glam::Vec4;
use std::ops::Range;
use std::slice::from_ref;

/// The material number of edges: `WIRE` in glsl/scene.glsl, which also has the numbers of
/// [`Material`](crate::Material).
const WIRE: u32 = 4;

impl Renderer {
    /// Records draws of heads of `model` into `target`, in front of `background` (linear red, green, blue, and
    /// opacity).
    ///
    /// There are two passes: one into the target's shadow map, and one into its image, which ends in the layout of
    /// [`RendererDesc::layout`](crate::RendererDesc), ready for copies (`TRANSFER`) and for draws over it
    /// (`COLOR_ATTACHMENT_OUTPUT`). Earlier bindings of the command buffer are lost.
    ///
    /// A pass skips heads whose [bounds](Head::bounds) are outside its picture, which changes no pixel. Returns the
    /// numbers of recorded and of skipped draws.
    ///
    /// # Errors
    /// [`Error::Invalid`] if there are more heads than the target was made for, or wrinkles are to be shown, and the
    /// renderer or a head has no masks.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer that is recording on the renderer's device, outside a render pass, on a
    ///   queue with graphics.
    /// - Model and target were made with this renderer; no commands recorded with the target before are still to run.
    ///   Its image view is alive.
    /// - The poses are of the renderer's format and of the model's mesh, tightly packed, ready for vertex-attribute
    ///   reads, and alive until the commands have run.
    pub unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        target: &mut Target,
        model: &Model,
        heads: &[Head],
        scene: &Scene,
        background: [f32; 4],
    ) -> Result<[usize; 2]> {
        let (seen, mut draws) = (target.write(scene, model, heads)?, [0; 2]);
        target.check_glow(model, scene.show)?;
        self.check_masks(heads, scene.show)?;
        let device = &self.gpu.device;
        let far = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: 1.0, stencil: 0 } };
        let behind = vk::ClearValue { color: vk::ClearColorValue { float32: background } };
        let edge = vk::Extent2D { width: SHADOW_EDGE, height: SHADOW_EDGE };
        let ([front, back], [plain_front, plain_back]) = (self.shaded, self.plain);
        let pictured = match scene.show {
            Show::Shaded => {
                vec![(plain_front, What::Rest), (front, What::Eyes), (plain_back, What::Rest), (back, What::Eyes)]
            }
            Show::Motion(_) => self.motion.map(|pipeline| (pipeline, What::Faces)).to_vec(),
            Show::Wire => vec![(front, What::Faces), (back, What::Faces), (self.lines, What::Edges)],
            Show::Wrinkles => self.wrinkled.map(|pipeline| (pipeline, What::Faces)).to_vec(),
            Show::Blocks | Show::Checker(_) | Show::Distance(_) | Show::Values(_) | Show::Normals => {
                vec![(front, What::Faces), (back, What::Faces)]
            }
        };
        let shadows = vec![(self.shadow, What::Shadows)];
        let passes = [
            (self.shadow_pass, target.shadow_framebuffer, edge, &[far][..], shadows),
            (self.pass, target.framebuffer, target.extent, &[behind, far], pictured),
        ];
        for (number, (pass, framebuffer, extent, clear, pictured)) in passes.into_iter().enumerate() {
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
                device.cmd_set_viewport(cmd, 0, from_ref(&viewport));
                device.cmd_set_scissor(cmd, 0, from_ref(&area));
            }
            for (pipeline, what) in pictured {
                // SAFETY: as above.
                unsafe { device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline) };
                for (i, head) in heads.iter().enumerate() {
                    draws[usize::from(!seen[i][number])] += what.drawn(model).count();
                    if seen[i][number] {
                        // SAFETY: as above; the target has room for the data of this number of heads, and the poses are
                        // those of the mesh.
                        unsafe { self.record_head(cmd, target, model, head, i, what) };
                    }
                }
            }
            // SAFETY: begun above.
            unsafe { device.cmd_end_render_pass(cmd) };
        }
        Ok(draws)
    }

    /// Checks that wrinkles are only shown with masks.
    fn check_masks(&self, heads: &[Head], show: Show) -> Result<()> {
        if show != Show::Wrinkles || self.desc.masks && heads.iter().all(|head| head.masks.is_some()) {
            return Ok(());
        }
        let what = match self.desc.masks {
            true => "wrinkles of heads without masks",
            false => "wrinkles, which the renderer was not made for",
        };
        let remedy = "add masks to the mesh with wrinkles::add before it is packed, and name them in \
                      RendererDesc::masks and Head::masks";
        Err(Error::Invalid { what: what.into(), remedy: remedy.into() })
    }

    /// # Safety
    /// Those of [`record`](Self::record), with `cmd` inside a pass whose pipeline is bound; the target has data of more
    /// than `number` heads.
    unsafe fn record_head(
        &self,
        cmd: vk::CommandBuffer,
        target: &Target,
        model: &Model,
        head: &Head,
        number: usize,
        what: What,
    ) {
        let device = &self.gpu.device;
        let (base, both) = (&model.base, vk::ShaderStageFlags::VERTEX | vk::ShaderStageFlags::FRAGMENT);
        let masks = head.masks.map_or((head.buffer, head.offset), |masks| (masks.buffer, masks.offset));
        let buffers = [head.buffer, base.0, model.texcoords.raw, model.values.raw, head.previous.0, masks.0];
        let offsets = [head.offset, base.1, 0, 0, head.previous.1, masks.1];
        let bound = match what {
            What::Shadows => self.desc.pose.vertex_input(false).0.len(),
            _ if head.masks.is_none() => MASK_BINDING as usize,
            _ => buffers.len(),
        };
        let indices = if what == What::Edges { &model.edges.0 } else { &model.indices };
        // SAFETY: the caller's obligations; model and target are alive.
        unsafe {
            let (point, dynamic) = (vk::PipelineBindPoint::GRAPHICS, target.offset_of(number));
            device.cmd_bind_descriptor_sets(cmd, point, self.layout, 0, &[target.set], &[dynamic]);
            device.cmd_bind_vertex_buffers(cmd, 0, &buffers[..bound], &offsets[..bound]);
            device.cmd_bind_index_buffer(cmd, indices.raw, 0, vk::IndexType::UINT32);
        }
        for (indices, material, ball) in what.drawn(model) {
            let first_told = (number * target.glow_numbers()) as u32;
            let (ball, units, block) = (ball.to_array(), head.units, model.block);
            let mask_units = head.masks.map_or([1.0; 2], |masks| masks.units);
            let push = PartPush { ball, units, mask_units, material, first_told, block };
            // SAFETY: as above; the indices are in the buffer.
            unsafe {
                device.cmd_push_constants(cmd, self.layout, both, 0, bytes_of(&push));
                device.cmd_draw_indexed(cmd, indices.len() as u32, 1, indices.start, 0, 0);
            }
        }
    }
}

/// The part of a head that is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum What {
    Shadows,
    Faces,
    /// Faces of eyeballs.
    Eyes,
    /// Other faces.
    Rest,
    Edges,
}

impl What {
    /// Returns the draws of a head: indices, material number, and an eyeball.
    fn drawn(self, model: &Model) -> impl Iterator<Item = (Range<u32>, u32, Vec4)> {
        let edges = (self == Self::Edges).then_some((0..model.edges.1, WIRE, Vec4::ZERO));
        let is_drawn = move |part: &&Drawn| match self {
            Self::Eyes => part.material == Material::Eye,
            Self::Rest => part.material != Material::Eye,
            Self::Shadows | Self::Faces => true,
            Self::Edges => false,
        };
        let part = |part: &Drawn| (part.indices.clone(), part.material as u32, part.ball.unwrap_or_default());
        edges.into_iter().chain(model.parts.iter().filter(is_drawn).map(part))
    }
}
