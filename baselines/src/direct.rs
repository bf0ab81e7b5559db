//! The `direct` path: the vertex shader evaluates all active targets in every draw, from deltas in a storage buffer
//! (Costigan et al., Algorithm 1; Bevy, three.js and Filament use textures instead of buffers).

use crate::abi::modules::{DIRECT, DIRECT_FEEDBACK, DIRECT_STORE};
use crate::draws::{Capture, Draws, add_draws};
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::memory::Ring;
use crate::gpu::mesh::{MeshBuffers, delta_range};
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines};
use crate::pack::{BASE_STRIDE, DeltaFormat};
use crate::update::dense::DensePlanner;
use crate::update::dense::feedback::vertex_input;
use crate::update::technique::Context;
use bytemuck::bytes_of;
use deltamorph::Result;
use deltamorph::ash::vk;
use deltamorph::shader_structure;
use std::sync::Arc;

shader_structure! {
    /// Push constants of `baselines/direct.vert`.
    DirectPush {
        /// Vertices of the chunk: the length of a target's row.
        chunk_vertices: u32,
        /// Targets of the mesh.
        target_count: u32,
        /// Number of active targets.
        active_targets: u32,
        /// First vertex of the chunk.
        first_vertex: u32,
    }
}

/// Bytes of a target's weight: coefficients of positions and of normals.
const WEIGHT_BYTES: usize = 8;

/// The draw's pipeline, then the capturing one if the device can capture.
#[derive(Clone, Copy, PartialEq)]
struct Direct {
    format: DeltaFormat,
    capture: Option<Capture>,
}

/// Inputs of one instance's draw.
#[derive(Clone, Copy, Default)]
struct DirectDraw {
    /// Dynamic offset of its weights.
    weights: u32,
    /// Its active targets.
    active: u32,
}

impl PipelineKey for Direct {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self { format, capture } = self;
        let kernels = [&DIRECT, &DIRECT_FEEDBACK, &DIRECT_STORE];
        add_draws(objects, kernels, capture, format, &vertex_input(format, 0))
    }
}

/// The draws of a crowd on the path `direct`, which read weights from a ring of host-visible memory.
pub struct DirectDraws {
    kernel: Arc<Pipelines<Direct>>,
    mesh: Arc<MeshBuffers>,
    ring: Ring,
    /// Bytes of one instance's weights.
    stride: u64,
    sets: Sets,
    /// The weights of each instance, as last written.
    draws: Vec<DirectDraw>,
    /// A buffer for one captured pose.
    pose: vk::Buffer,
}

impl Draws for DirectDraws {
    fn new(context: Context<'_>) -> Result<Self> {
        let (mesh, desc, pose) = (context.mesh, context.desc, context.poses);
        let stride = Ring::part_bytes((mesh.layout.targets.len() * WEIGHT_BYTES) as u64);
        let (part, frames) = (stride.saturating_mul(desc.instances.into()), desc.frames_in_flight);
        let bytes = part.saturating_mul(frames.into());
        context.check_offsets("weights", bytes, "make several crowds, or use fewer frames in flight")?;
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let ring = Ring::new(context.device, "deltamorph weights", part, frames, usage)?;
        let capture = Capture::of(context.device, crate::DIRECT).ok();
        let kernel = context.kernels.get(Direct { format: mesh.layout.format, capture })?;
        let mut bound = vec![
            BufferRange::new(mesh.deltas.raw, 0, delta_range(&mesh.layout)),
            BufferRange::new(ring.range(0).buffer, 0, stride),
        ];
        if capture == Some(Capture::Store) {
            bound.push(BufferRange::new(pose.buffer, 0, pose.bytes));
        }
        Ok(Self {
            sets: kernel.objects.sets(&[bound])?,
            kernel,
            mesh: mesh.clone(),
            ring,
            stride,
            draws: vec![DirectDraw::default(); desc.instances as usize],
            pose: pose.buffer,
        })
    }

    fn write(&mut self, planner: &DensePlanner, frame: u64) -> Result<()> {
        let words = self.ring.words(frame)?;
        let (stride, targets) = (self.stride as usize / 4, &self.mesh.layout.targets);
        let first = frame as usize * words.len() * 4;
        for (i, out) in words.chunks_exact_mut(stride).enumerate() {
            let weights = &planner.plans()[i].applied;
            for ((weight, target), out) in weights.iter().zip(targets).zip(out.chunks_exact_mut(WEIGHT_BYTES / 4)) {
                let coefficient = weight * target.position_step;
                out.copy_from_slice(&[coefficient, coefficient * target.normal_ratio()].map(f32::to_bits));
            }
            let active = weights.iter().filter(|w| **w != 0.0).count() as u32;
            // Fits 32 bits: checked in `new`.
            self.draws[i] = DirectDraw { weights: (first + i * stride * 4) as u32, active };
        }
        Ok(())
    }

    /// Bytes of the weights up to the last active target.
    fn weight_bytes(&self, weights: &[f32]) -> u64 {
        weights.iter().rposition(|w| *w != 0.0).map_or(0, |last| (WEIGHT_BYTES * (last + 1)) as u64)
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>, captured: bool) {
        let (objects, capture) = (&self.kernel.objects, self.kernel.key.capture.filter(|_| captured));
        let (device, mesh) = (&objects.device.raw, &self.mesh.layout);
        let (point, layout) = (vk::PipelineBindPoint::GRAPHICS, objects.layout);
        let pipeline = usize::from(capture.is_some());
        // SAFETY: the caller's obligations; pipeline and render pass are ours.
        unsafe {
            objects.begin_render_pass(cmd);
            device.cmd_bind_pipeline(cmd, point, objects.pipelines[pipeline]);
        }
        let draws = instances.map(|i| self.draws[i as usize]);
        for (draw, (first, vertices)) in draws.flat_map(|draw| mesh.chunks().map(move |chunk| (draw, chunk))) {
            let at = (first * BASE_STRIDE) as u64;
            let row = (mesh.row_start(0, first, vertices) * 4) as u32;
            let push = DirectPush {
                chunk_vertices: vertices as u32,
                target_count: mesh.targets.len() as u32,
                active_targets: draw.active,
                first_vertex: first as u32,
            };
            // SAFETY: as above; vertices and rows are within their buffers, dynamic offsets are multiples of 64 × 12
            // bytes and of a list's 256; the push constants fill the layout's range; the capture fits the pose.
            unsafe {
                device.cmd_bind_vertex_buffers(cmd, 0, &[self.mesh.base.raw], &[at]);
                device.cmd_bind_descriptor_sets(cmd, point, layout, 0, &[self.sets.get(0)], &[row, draw.weights]);
                device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, bytes_of(&push));
                objects.draw(cmd, vertices, (capture == Some(Capture::Feedback)).then_some((self.pose, at)));
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }
}
