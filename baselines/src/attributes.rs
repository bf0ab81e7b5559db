//! The `direct-attributes` path (Gerdelan): draws read the active targets as vertex attributes, next to the base pose,
//! and their weights as push constants. The device's attributes limit the number of active targets.

use crate::abi::modules::{DIRECT_ATTRIBUTES, FEEDBACK, VERTEX_STORE};
use crate::draws::{Capture, Draws};
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::pipelines::Pipelines;
use crate::update::dense::DensePlanner;
use crate::update::dense::feedback::VertexPasses;
use crate::update::dense::technique::{ChunkSets, DensePass};
use crate::update::technique::Context;
use crate::vertex_store::store_sets;
use crate::weights::delta::{Coefficient, active_targets};
use deltamorph::ash::vk;
use deltamorph::{Error, Result};
use std::sync::Arc;

/// Most instances of a crowd without pose buffers: each takes host memory and its own draws.
const INSTANCES_MAX: u32 = 1 << 20;

/// The draws of a crowd on the path `direct-attributes`: the active targets of each instance.
pub struct AttributeDraws {
    kernel: Arc<Pipelines<VertexPasses>>,
    /// Captures poses: a pass from the base pose of a path with the same evaluation (`attributes.glsl`), and descriptor
    /// sets if the pass stores.
    capturer: Option<(Arc<Pipelines<VertexPasses>>, Option<ChunkSets>)>,
    mesh: Arc<MeshBuffers>,
    active: Vec<Vec<Coefficient>>,
    /// A buffer for one captured pose.
    pose: vk::Buffer,
}

impl AttributeDraws {
    fn pass(&self, instance: u32) -> DensePass<'_> {
        DensePass {
            layout: &self.mesh.layout,
            deltas: self.mesh.deltas.raw,
            source: (self.mesh.base.raw, 0),
            destination: (self.pose, 0),
            coefficients: &self.active[instance as usize],
        }
    }
}

impl Draws for AttributeDraws {
    fn new(context: Context<'_>) -> Result<Self> {
        let (layout, pose, instances) = (context.layout(), context.poses.buffer, context.desc.instances);
        if instances > INSTANCES_MAX {
            return Err(Error::invalid(
                format!("{instances} instances through 'direct-attributes'"),
                format!("make several crowds of at most {INSTANCES_MAX}"),
            ));
        }
        let capturer = match Capture::of(context.device, crate::DIRECT_ATTRIBUTES) {
            Ok(Capture::Feedback) => Some((VertexPasses::of(&context, &FEEDBACK)?, None)),
            Ok(Capture::Store) => {
                let store = VertexPasses::of(&context, &VERTEX_STORE)?;
                let sets = store_sets(&store.objects, layout, pose, 1)?;
                Some((store, Some(sets)))
            }
            Err(_) => None,
        };
        let kernel = VertexPasses::of(&context, &DIRECT_ATTRIBUTES)?;
        let active = vec![vec![]; instances as usize];
        Ok(Self { kernel, capturer, mesh: context.mesh.clone(), active, pose })
    }

    fn write(&mut self, planner: &DensePlanner, _frame: u64) -> Result<()> {
        for (i, active) in self.active.iter_mut().enumerate() {
            active.clear();
            active_targets(&planner.plans()[i].applied, active);
        }
        Ok(())
    }

    /// Refuses more active targets than a draw has attributes for.
    fn check_weights(&self, weights: &[f32]) -> Result<()> {
        let (active, most) = (weights.iter().filter(|w| **w != 0.0).count(), self.kernel.key.most);
        if active <= most as usize {
            return Ok(());
        }
        Err(Error::invalid(
            format!("{active} active targets through 'direct-attributes', whose draw has vertex attributes for {most}"),
            "set other weights to zero, use a larger batch size where the device has one, or the path 'direct'",
        ))
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>, captured: bool) {
        let passes = instances.map(|instance| self.pass(instance));
        let (pipelines, stores) = match &self.capturer {
            Some((capturer, stores)) if captured => (capturer, stores.as_ref()),
            Some(_) | None => (&self.kernel, None),
        };
        let stores = stores.map_or(&[][..], |stores| stores.get(0));
        // SAFETY: the caller's obligations; the base pose and the written buffer differ, and `check_weights` has
        // checked the length of each list.
        unsafe { pipelines.record(cmd, passes, stores) };
    }
}
