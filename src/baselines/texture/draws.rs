//! The draws of `texture`, which fetch displacements.

use super::{Textures, words_of};
use crate::abi::modules::{Kernel, TEXTURED, TEXTURED_FEEDBACK, TEXTURED_STORE};
use crate::abi::push::TexturedPush;
use crate::baselines::draws::{Capture, Draw};
use crate::error::Result;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines};
use crate::pack::{DeltaFormat, PoseFormat};
use crate::plan::UpdatePath;
use crate::update::technique::Context;
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// Binding of the displacement textures.
const DISPLACEMENTS: u32 = 2;

/// The draw's pipeline, then, where the device can, the one that captures.
#[derive(Clone, Copy, PartialEq)]
struct Textured {
    capture: Option<Capture>,
}

impl PipelineKey for Textured {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let kernels = match self.capture {
            None => &[&TEXTURED][..],
            Some(Capture::Feedback) => &[&TEXTURED, &TEXTURED_FEEDBACK],
            Some(Capture::Store) => &[&TEXTURED, &TEXTURED_STORE],
        };
        let rows: Vec<_> = kernels.iter().map(|kernel| kernel.row).collect();
        objects.add_layout(&rows, 0)?;
        objects.add_empty_render_pass()?;
        let (bindings, attributes) = PoseFormat::Float32.vertex_input(false);
        // They read no deltas.
        let module = |kernel: &'static Kernel| kernel.module(DeltaFormat::Float32.row(), PoseFormat::Float32.row(), 0);
        kernels.iter().try_for_each(|kernel| objects.add_discarding_vertex(module(kernel)?, &bindings, &attributes))
    }
}

/// What a crowd's draws take.
pub(crate) struct TextureDraws {
    kernel: Arc<Pipelines<Textured>>,
    mesh: Arc<MeshBuffers>,
    /// By instance.
    sets: Sets,
    /// One pose to capture into.
    pose: vk::Buffer,
}

impl TextureDraws {
    /// Draws that fetch these displacement textures, by instance.
    pub(super) fn new(context: Context<'_>, displacements: Vec<vk::ImageView>) -> Result<Self> {
        let (mesh, pose) = (context.mesh, context.poses);
        let capture = Capture::of(context.device, UpdatePath::Texture).ok();
        let kernel = context.kernels.get(Textured { capture })?;
        let mut bound = vec![words_of(mesh)];
        if capture == Some(Capture::Store) {
            bound.push(BufferRange::new(pose.buffer, 0, pose.bytes));
        }
        let mut sets = kernel.objects.sets(&vec![bound; displacements.len()])?;
        displacements.iter().enumerate().for_each(|(set, view)| sets.write_image(set, DISPLACEMENTS, *view));
        Ok(Self { kernel, mesh: mesh.clone(), sets, pose: pose.buffer })
    }
}

impl Draw for TextureDraws {
    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>, captured: bool) {
        let (objects, capture) = (&self.kernel.objects, self.kernel.key.capture.filter(|_| captured));
        let (device, textures) = (&objects.device.raw, Textures::of(&self.mesh));
        let (point, layout) = (vk::PipelineBindPoint::GRAPHICS, objects.layout);
        let pipeline = usize::from(capture.is_some());
        let push = TexturedPush { texels_at: textures.texels_at(), row: textures.size()[0] };
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
            // SAFETY: as above; there is a texel for each vertex; as much is captured as the pose has room for.
            unsafe {
                device.cmd_bind_descriptor_sets(cmd, point, layout, 0, &[set], &[]);
                objects.draw(cmd, vertices, (capture == Some(Capture::Feedback)).then_some((self.pose, 0)));
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }
}
