//! The commands of a draw.

use crate::model::{Drawn, Model};
use crate::parts::Material;
use crate::passes::SHADOW_EDGE;
use crate::renderer::{MASK_BINDING, Renderer};
use crate::scene::{Head, PartPush, Scene, Show};
use crate::target::Target;
use bytemuck::bytes_of;
use deltamorph::Result;
use deltamorph::ash::vk;
use std::ops::Range;
use std::slice::from_ref;

/// The material number of edges: `WIRE` in glsl/scene.glsl, which also has the numbers of
/// [`Material`](crate::Material). That of a painted part is one more if it has two sides.
const WIRE: u32 = 4;

impl Renderer {
    /// Records draws of heads of `model` into `target`, in front of `background` (linear red, green, blue, and
    /// opacity).
    ///
    /// There are two passes: one into the target's shadow map, and one into its image, which ends in
    /// `TRANSFER_SRC_OPTIMAL`, ready for copies (`TRANSFER`) and for draws over it
    /// (`COLOR_ATTACHMENT_OUTPUT`). Earlier bindings of the command buffer are lost.
    ///
    /// A pass skips heads whose [bounds](Head::bounds) are outside its picture, which changes no pixel. Returns the
    /// numbers of recorded and of skipped draws.
    ///
    /// # Errors
    /// The device has not mapped the target's buffers.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer that is recording on the renderer's device, outside a render pass, on a
    ///   queue with graphics.
    /// - Model and target were made with this renderer, the target for as many heads, which have masks if wrinkles are
    ///   shown; no commands recorded with the target before are still to run.
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
        let seen = target.write(scene, model, heads)?;
        let mut draws = [0; 2];
        let device = &self.gpu.raw;
        let far = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: 1.0, stencil: 0 } };
        let behind = vk::ClearValue { color: vk::ClearColorValue { float32: background } };
        let edge = vk::Extent2D { width: SHADOW_EDGE, height: SHADOW_EDGE };
        // Front faces, then back faces.
        let sides = |pipelines: [vk::Pipeline; 2], what| {
            pipelines
                .into_iter()
                .zip([What::is_front as fn(&Drawn) -> bool, What::is_back])
                .map(move |(pipeline, side)| (pipeline, what, side))
        };
        let any: fn(&Drawn) -> bool = |_| true;
        let pictured: Vec<Draw> = match scene.show {
            Show::Shaded => {
                let rest = sides(self.plain, What::Rest);
                let eyes = sides(self.shaded, What::Eyes);
                rest.zip(eyes).flat_map(|(rest, eyes)| [rest, eyes]).collect()
            }
            Show::Motion => sides(self.motion, What::Faces).collect(),
            Show::Wire => sides(self.shaded, What::Faces).chain([(self.lines, What::Edges, any)]).collect(),
            Show::Wrinkles => sides(self.wrinkled, What::Faces).collect(),
            Show::Blocks | Show::Heat | Show::Normals => sides(self.shaded, What::Faces).collect(),
        };
        let shadows: Vec<Draw> = vec![(self.shadow, What::Shadows, any)];
        let models: Vec<&Model> = std::iter::once(model).chain(model.still.as_deref()).collect();
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
            for (pipeline, what, side) in pictured {
                // SAFETY: as above.
                unsafe { device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline) };
                for (i, (head, model)) in
                    heads.iter().enumerate().flat_map(|(i, head)| models.iter().map(move |model| (i, (head, *model))))
                {
                    let parts: Vec<Part> = what.drawn(model, side).collect();
                    draws[usize::from(!seen[i][number])] += parts.len();
                    if seen[i][number] && !parts.is_empty() {
                        // SAFETY: as above; the target has room for the data of this number of heads, and the poses are
                        // those of the mesh.
                        unsafe { self.record_head(cmd, target, model, head, (i, what, parts)) };
                    }
                }
            }
            // SAFETY: begun above.
            unsafe { device.cmd_end_render_pass(cmd) };
        }
        Ok(draws)
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
        (number, what, parts): (usize, What, Vec<Part>),
    ) {
        let device = &self.gpu.raw;
        let standing = model.standing(head);
        let head = standing.as_ref().unwrap_or(head);
        let both = vk::ShaderStageFlags::VERTEX | vk::ShaderStageFlags::FRAGMENT;
        let masks = head.masks.map_or((head.buffer, head.offset), |masks| (masks.buffer, masks.offset));
        let buffers = [head.buffer, model.rest.raw, head.previous.0, masks.0];
        let offsets = [head.offset, 0, head.previous.1, masks.1];
        let bound = match what {
            What::Shadows => 1,
            _ if head.masks.is_none() => MASK_BINDING as usize,
            _ => buffers.len(),
        };
        let indices = if what == What::Edges { &model.edges.0 } else { &model.indices };
        // SAFETY: the caller's obligations; model and target are alive.
        unsafe {
            let point = vk::PipelineBindPoint::GRAPHICS;
            let dynamic = target.offset_of(number);
            device.cmd_bind_descriptor_sets(cmd, point, self.layout, 0, &[target.set], &[dynamic]);
            device.cmd_bind_vertex_buffers(cmd, 0, &buffers[..bound], &offsets[..bound]);
            device.cmd_bind_index_buffer(cmd, indices.raw, 0, vk::IndexType::UINT32);
        }
        let [x, y, z, normal, ..] = head.scale.scale;
        let [a, b, c, ..] = head.scale.offsets;
        for (indices, material, part) in parts {
            let [red, green, blue] = part.map_or([1.0; 3], |part| part.colour);
            let push = PartPush {
                ball: part.and_then(|part| part.ball).unwrap_or_default().to_array(),
                colour: [red, green, blue, 1.0],
                scale: [x, y, z, normal],
                offset: [a, b, c, 0.0],
                mask_scale: head.masks.map_or([1.0; 4], |masks| masks.scale),
                material,
                first_told: if standing.is_some() { u32::MAX } else { (number * target.glow_numbers()) as u32 },
                block: model.block,
                unused: 0,
            };
            // SAFETY: as above; the indices are in the buffer.
            unsafe {
                device.cmd_push_constants(cmd, self.layout, both, 0, bytes_of(&push));
                device.cmd_draw_indexed(cmd, indices.len() as u32, 1, indices.start, 0, 0);
            }
        }
    }
}

/// A pipeline, what it draws, and which of those parts.
type Draw = (vk::Pipeline, What, fn(&Drawn) -> bool);

/// A draw of a head: indices, material number, and what is drawn, but for edges.
type Part<'a> = (Range<u32>, u32, Option<&'a Drawn>);

/// The part of a head that is drawn.
#[derive(Clone, Copy, PartialEq)]
enum What {
    Shadows,
    Faces,
    Eyes,
    /// All but eyes.
    Rest,
    Edges,
}

impl What {
    fn is_front(_: &Drawn) -> bool {
        true
    }

    /// Whether the part has a back.
    fn is_back(part: &Drawn) -> bool {
        part.double_sided
    }

    /// Returns the draws of a head.
    fn drawn(self, model: &Model, side: fn(&Drawn) -> bool) -> impl Iterator<Item = Part<'_>> {
        let edges = (self == Self::Edges).then_some((0..model.edges.1, WIRE, None));
        let is_drawn = move |part: &&Drawn| {
            side(part)
                && match self {
                    Self::Eyes => part.material == Material::Eye,
                    Self::Rest => part.material != Material::Eye,
                    Self::Shadows | Self::Faces => true,
                    Self::Edges => false,
                }
        };
        fn part(part: &Drawn) -> Part<'_> {
            let Drawn { indices, material, double_sided, .. } = part;
            let sides = u32::from(*material == Material::Painted && *double_sided);
            (indices.clone(), *material as u32 + sides, Some(part))
        }
        edges.into_iter().chain(model.parts.iter().filter(is_drawn).map(part))
    }
}
