//! The draws of `texture`, which fetch texels of displacements.

use super::images::write_image;
use super::{Textures, words_of};
use crate::abi::modules::{TEXTURED, TEXTURED_FEEDBACK, TEXTURED_STORE};
use crate::draws::{Capture, add_draws};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines};
use crate::pack::{DeltaFormat, PoseFormat};
use crate::update::technique::{Context, PoseDraws};
use bytemuck::bytes_of;
use deltamorph::Result;
use deltamorph::ash::vk;
use deltamorph::shader_structure;
use std::sync::Arc;

shader_structure! {
    /// Push constants of `baselines/textured.vert`.
    TexturedPush {
        /// First word of the texels of vertices.
        texels_at: u32,
        /// Texels per row of the displacement textures.
        row: u32,
    }
}

/// Binding of the displacement textures.
const DISPLACEMENTS: u32 = 2;

/// The draw's pipeline, then the capturing one if the device can capture.
#[derive(Clone, Copy, PartialEq)]
struct Textured {
    capture: Option<Capture>,
}

impl PipelineKey for Textured {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let kernels = [&TEXTURED, &TEXTURED_FEEDBACK, &TEXTURED_STORE];
        // The draws read no deltas.
        let input = PoseFormat::Float32.vertex_input();
        add_draws(objects, kernels, self.capture, DeltaFormat::Float32, &input)
    }
}

/// The arguments for a crowd's draws.
pub struct TextureDraws {
    kernel: Arc<Pipelines<Textured>>,
    mesh: Arc<MeshBuffers>,
    /// By instance.
    sets: Sets,
    /// A buffer for one captured pose.
    pose: vk::Buffer,
}

impl TextureDraws {
    /// Makes draws that fetch these displacement textures, one per instance.
    pub fn new(context: Context<'_>, displacements: Vec<vk::ImageView>) -> Result<Self> {
        let (mesh, pose) = (context.mesh, context.poses);
        let capture = Capture::of(context.device, crate::TEXTURE).ok();
        let kernel = context.kernels.get(Textured { capture })?;
        let mut bound = vec![words_of(mesh)];
        if capture == Some(Capture::Store) {
            bound.push(BufferRange::new(pose.buffer, 0, pose.bytes));
        }
        let sets = kernel.objects.sets(&vec![bound; displacements.len()])?;
        for (set, view) in displacements.iter().enumerate() {
            write_image(context.device, sets.get(set), DISPLACEMENTS, *view);
        }
        Ok(Self { kernel, mesh: mesh.clone(), sets, pose: pose.buffer })
    }
}

impl PoseDraws for TextureDraws {
    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>) {
        // SAFETY: the caller's obligations.
        unsafe { self.record(cmd, instances, false) };
    }

    unsafe fn capture(&self, cmd: vk::CommandBuffer, instance: u32) -> Result<()> {
        let device = &self.kernel.objects.device;
        let capture = Capture::of(device, crate::TEXTURE)?;
        // SAFETY: the caller's obligations.
        unsafe { capture.record(device, cmd, || self.record(cmd, &mut [instance].into_iter(), true)) };
        Ok(())
    }
}

impl TextureDraws {
    /// Records the draws of these instances, captured if requested.
    ///
    /// # Safety
    /// Those of [`PoseDraws::record`]; captures have barriers around them.
    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>, captured: bool) {
        let (objects, capture) = (&self.kernel.objects, self.kernel.key.capture.filter(|_| captured));
        let (device, textures) = (&objects.device.raw, Textures::of(&self.mesh));
        let (point, layout) = (vk::PipelineBindPoint::GRAPHICS, objects.layout);
        let pipeline = usize::from(capture.is_some());
        let push = TexturedPush { texels_at: textures.texels_at(), row: textures.size[0] };
        // SAFETY: the caller's obligations; pipeline, render pass and base pose are ours; the push constants fill the
        // layout's range.
        unsafe {
            objects.begin_render_pass(cmd);
            device.cmd_bind_pipeline(cmd, point, objects.pipelines[pipeline]);
            device.cmd_bind_vertex_buffers(cmd, 0, &[self.mesh.base.raw], &[0]);
            device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, bytes_of(&push));
        }
        for instance in instances {
            let (set, vertices) = (self.sets.get(instance as usize), self.mesh.layout.padded_vertices());
            // SAFETY: as above; there is a texel for each vertex; the capture fits the pose.
            unsafe {
                device.cmd_bind_descriptor_sets(cmd, point, layout, 0, &[set], &[]);
                objects.draw(cmd, vertices, (capture == Some(Capture::Feedback)).then_some((self.pose, 0)));
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }
}
