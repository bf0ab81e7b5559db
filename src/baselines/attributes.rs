//! The `direct-attributes` path (Gerdelan): the draw itself has the active targets as vertex attributes, next to the
//! base pose, and their weights as push constants. As many targets can be active as the device has attributes for.

use super::draws::{Capture, Draws, draw_stats, no_capture, one_pass};
use super::vertex_store::{StoreSets, VertexStore};
use crate::abi::modules::DIRECT_ATTRIBUTES;
use crate::abi::push::attribute_push_bytes;
use crate::error::{Error, Result};
use crate::gpu::device::Device;
use crate::gpu::kernels::Kernel;
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::pipelines::Objects;
use crate::pack::{DeltaFormat, PoseFormat};
use crate::plan::instances::Instances;
use crate::plan::steps::{Steps, Work};
use crate::plan::{UpdatePath, UpdateStats};
use crate::update::dense::DensePlanner;
use crate::update::dense::feedback::{Feedback, push_constants, vertex_batch, vertex_buffers, vertex_input};
use crate::update::dense::technique::DensePass;
use crate::update::technique::{Context, Technique, UpdateId};
use crate::weights::delta::{Coefficient, active_targets};
use ash::vk;
use std::sync::Arc;

/// Pipelines for 0 active targets to the most.
struct Attributes {
    draw: Objects,
    key: (DeltaFormat, u32),
}

impl Kernel for Attributes {
    type Key = (DeltaFormat, u32);

    fn new(device: &Arc<Device>, key: Self::Key) -> Result<Self> {
        let (format, most) = key;
        let mut draw = Objects::none(device);
        draw.add_layout(&[DIRECT_ATTRIBUTES.row], attribute_push_bytes(format, most))?;
        draw.add_empty_render_pass()?;
        for b in 0..=most {
            let (bindings, attributes) = vertex_input(format, b);
            draw.add_discarding_vertex(
                DIRECT_ATTRIBUTES.module(format, PoseFormat::Float32, b)?,
                &bindings,
                &attributes,
            )?;
        }
        Ok(Self { draw, key })
    }

    fn key(&self) -> Self::Key {
        self.key
    }
}

/// Instances of a crowd that keeps no poses: each takes memory of the host and draws of its own.
const INSTANCES_MAX: u32 = 1 << 20;

/// How a pose is captured: by a pass from the base pose of a path that evaluates the same (`attributes.glsl`).
enum Capturer {
    Feedback(Arc<Feedback>),
    Store(Arc<VertexStore>, StoreSets),
}

/// A crowd on the path `direct-attributes`: the active targets of each instance.
pub(crate) struct AttributesTechnique {
    kernel: Arc<Attributes>,
    capturer: Option<Capturer>,
    mesh: Arc<MeshBuffers>,
    planner: DensePlanner,
    active: Vec<Vec<Coefficient>>,
    /// One pose to capture into.
    pose: vk::Buffer,
}

impl AttributesTechnique {
    pub(crate) fn new(context: Context<'_>) -> Result<Self> {
        let (layout, pose, instances) = (context.layout(), context.poses.buffer, context.desc.instances);
        if instances > INSTANCES_MAX {
            return Err(Error::invalid(
                format!("{instances} instances through 'direct-attributes'"),
                format!("make several crowds of at most {INSTANCES_MAX}"),
            ));
        }
        let key = (layout.format, vertex_batch(&context));
        let capturer = match Capture::of(context.device) {
            Some(Capture::Feedback) => Some(Capturer::Feedback(context.kernels.get(key)?)),
            Some(Capture::Store) => {
                let store = context.kernels.get::<VertexStore>(key)?;
                let sets = StoreSets::new(&store, layout, pose, 1)?;
                Some(Capturer::Store(store, sets))
            }
            None => None,
        };
        Ok(Self {
            kernel: context.kernels.get(key)?,
            capturer,
            mesh: context.mesh.clone(),
            planner: one_pass(context.desc)?,
            active: vec![vec![]; context.desc.instances as usize],
            pose,
        })
    }
}

impl Technique for AttributesTechnique {
    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        self.planner.plan(instances, id.update);
        for (i, active) in self.active.iter_mut().enumerate() {
            active.clear();
            active_targets(self.planner.applied(i), active);
        }
        if self.planner.has_changed() {
            steps.step(&[]);
        }
        Ok(draw_stats(&self.mesh.layout, &self.planner, instances))
    }

    unsafe fn record(&self, _cmd: vk::CommandBuffer, _frame: u64, _work: &Work) {}

    /// Refuse more active targets than a draw has attributes for.
    fn check_weights(&self, weights: &[f32]) -> Result<()> {
        let (active, most) = (weights.iter().filter(|w| **w != 0.0).count(), self.kernel.key.1);
        if active <= most as usize {
            return Ok(());
        }
        Err(Error::invalid(
            format!("{active} active targets through 'direct-attributes', whose draw has vertex attributes for {most}"),
            "set other weights to zero, use a larger batch size where the device has one, or the path 'direct'",
        ))
    }

    fn has_poses(&self) -> bool {
        false
    }

    #[cfg(any(test, feature = "internals"))]
    fn accesses(&self, _works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        vec![]
    }
}

impl Draws for AttributesTechnique {
    unsafe fn record_draws(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>) {
        let (draw, layout) = (&self.kernel.draw, &self.mesh.layout);
        let (device, base) = (&draw.device.raw, (self.mesh.base.raw, 0));
        // SAFETY: the caller's obligations; the render pass is ours.
        unsafe { draw.begin_render_pass(cmd) };
        for active in instances.map(|i| &self.active[i as usize][..]) {
            let push = push_constants(layout, active);
            // SAFETY: as above; pipeline and layout are ours, and the push constants within the layout's range:
            // `check_weights` has seen to the length of each list.
            unsafe {
                device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, draw.pipelines[active.len()]);
                if !push.is_empty() {
                    let bytes = bytemuck::cast_slice(&push);
                    device.cmd_push_constants(cmd, draw.layout, vk::ShaderStageFlags::VERTEX, 0, bytes);
                }
            }
            for chunk in layout.chunks() {
                let (buffers, offsets) = vertex_buffers(layout, chunk, base, self.mesh.deltas.raw, active);
                // SAFETY: as above; each binding reads the chunk's vertices within its buffer.
                unsafe {
                    device.cmd_bind_vertex_buffers(cmd, 0, &buffers, &offsets);
                    device.cmd_draw(cmd, chunk.1 as u32, 1, 0, 0);
                }
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }

    fn capture(&self) -> Result<Capture> {
        match &self.capturer {
            Some(Capturer::Feedback(_)) => Ok(Capture::Feedback),
            Some(Capturer::Store(..)) => Ok(Capture::Store),
            None => Err(no_capture(&self.kernel.draw.device, UpdatePath::DirectAttributes)),
        }
    }

    unsafe fn record_capture(&self, cmd: vk::CommandBuffer, instance: u32) {
        let pass = DensePass {
            layout: &self.mesh.layout,
            deltas: self.mesh.deltas.raw,
            source: (self.mesh.base.raw, 0),
            destination: (self.pose, 0),
            coefficients: &self.active[instance as usize],
        };
        match &self.capturer {
            // SAFETY: the caller's obligations; the base pose is another buffer than the one written.
            Some(Capturer::Feedback(feedback)) => unsafe { feedback.record(cmd, &pass) },
            // SAFETY: as above.
            Some(Capturer::Store(store, sets)) => unsafe { store.record(cmd, &pass, sets.of(0)) },
            None => {}
        }
    }
}
