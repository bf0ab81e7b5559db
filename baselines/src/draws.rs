//! The common part of the direct paths: draws that evaluate the pose, and its capture.

use crate::abi::modules::Kernel;
use crate::gpu::barriers;
use crate::gpu::device::Device;
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::pipelines::Objects;
use crate::pack::{BASE_STRIDE, DeltaFormat, PoseFormat};
use crate::plan::instances::{InstanceState, Instances};
use crate::plan::schedule::{Entry, Schedule};
use crate::plan::steps::{Access, Resource, Stage, Steps, Use, Work};
use crate::plan::{BatchSize, Consumers, UpdatePath, UpdateStats};
use crate::update::crowd::CrowdDesc;
use crate::update::dense::DensePlanner;
use crate::update::technique::{Context, PoseDraws, Technique, UpdateId};
use deltamorph::UpdateDesc;
use deltamorph::ash::vk;
use deltamorph::{Error, Result};
use std::sync::Arc;

/// Draws that evaluate the pose from weights.
pub trait Draws: Send + Sync + 'static {
    /// Makes the arguments for a crowd's draws.
    fn new(context: Context<'_>) -> Result<Self>
    where
        Self: Sized;

    /// Writes the weights of all instances for the draws to read; none for an instance without a pose. Draws of a
    /// hidden instance keep its weights, even if others are requested meanwhile.
    fn write(&mut self, planner: &DensePlanner, frame: u64) -> Result<()>;

    /// See [`InstanceState::check_weights`].
    fn check_weights(&self, _weights: &[f32]) -> Result<()> {
        Ok(())
    }

    /// Bytes that a draw with these weights loads besides the base pose and the deltas of the active targets.
    fn weight_bytes(&self, _weights: &[f32]) -> u64 {
        0
    }

    /// Records the draws of these instances, captured if requested.
    ///
    /// # Safety
    /// Those of [`PoseDraws::record`]; captures have barriers around them.
    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>, captured: bool);
}

/// A crowd on a direct path: an update writes weights, and there are no works.
pub struct DrawTechnique<D> {
    draws: D,
    device: Arc<Device>,
    path: UpdatePath,
    mesh: Arc<MeshBuffers>,
    planner: DensePlanner,
    /// The last update that wrote weights.
    written: u64,
    /// The update `written` never ran, so the next one takes its part of the ring.
    stale: bool,
}

impl<D: Draws> DrawTechnique<D> {
    pub fn new(context: Context<'_>) -> Result<Self> {
        let (device, path) = (context.device.clone(), context.desc.update.path);
        let (mesh, planner) = (context.mesh.clone(), one_pass(context.desc)?);
        Ok(Self { draws: D::new(context)?, device, path, mesh, planner, written: 0, stale: false })
    }
}

impl<D: Draws> InstanceState for DrawTechnique<D> {
    fn check_weights(&self, weights: &[f32]) -> Result<()> {
        self.draws.check_weights(weights)
    }
}

impl<D: Draws> Technique for DrawTechnique<D> {
    fn state(&mut self) -> &mut dyn InstanceState {
        self
    }

    /// A step without works: draws read the weights from where the host wrote them. Bytes are those of one draw of
    /// every shown instance, since draws evaluate even unchanged weights.
    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        self.planner.plan(instances, id.update);
        if has_changed(&self.planner) || self.stale {
            (self.written, self.stale) = (id.update, false);
            self.draws.write(&self.planner, id.frame)?;
            steps.step(&[]);
        }
        let (layout, shown) = (&self.mesh.layout, || instances.requested().flatten());
        let active = shown().flatten().filter(|w| **w != 0.0).count();
        let loaded = BASE_STRIDE * shown().count() + active * layout.format.stride();
        let floor = (layout.padded_vertices() * loaded) as u64;
        let mut stats = UpdateStats::default();
        stats.coefficients = active;
        stats.rebuilt = self.planner.plans().iter().filter(|plan| !plan.passes.is_empty()).count();
        stats.bytes_moved = floor + shown().map(|weights| self.draws.weight_bytes(weights)).sum::<u64>();
        stats.bytes_floor = floor;
        Ok(stats)
    }

    unsafe fn record(&self, _cmd: vk::CommandBuffer, _frame: u64, _work: &Work) {}

    fn discard_from(&mut self, id: UpdateId) {
        self.stale |= self.written >= id.update;
    }

    fn draws(&self, group: usize) -> Option<&dyn PoseDraws> {
        (group == 0).then_some(self as &dyn PoseDraws)
    }
}

impl<D: Draws> PoseDraws for DrawTechnique<D> {
    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>) {
        // SAFETY: the caller's obligations.
        unsafe { self.draws.record(cmd, instances, false) };
    }

    unsafe fn capture(&self, cmd: vk::CommandBuffer, instance: u32) -> Result<()> {
        let capture = Capture::of(&self.device, self.path)?;
        // SAFETY: the caller's obligations.
        unsafe { capture.record(&self.device, cmd, || self.draws.record(cmd, &mut [instance].into_iter(), true)) };
        Ok(())
    }
}

/// Ways to capture a pose that a draw evaluates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Capture {
    Feedback,
    Store,
}

impl Capture {
    /// Returns the device's way to capture poses that only the draws of `path` evaluate, if any.
    pub fn of(device: &Device, path: UpdatePath) -> Result<Self> {
        match device.caps.check_path(UpdatePath::Feedback) {
            Ok(()) => Ok(Self::Feedback),
            Err(_) if device.caps.vertex_stores => Ok(Self::Store),
            Err(_) => Err(Error::Unsupported {
                path: path.name(),
                device: device.caps.name.clone(),
                reason: "its draws evaluate the pose, and to capture it the device needs VK_EXT_transform_feedback or \
                         the feature vertexPipelineStoresAndAtomics, enabled"
                    .into(),
                remedy: "draw it, or use a path with pose buffers, such as 'compute'".into(),
            }),
        }
    }

    /// Records a capture by `draw`, with the barriers around it.
    ///
    /// # Safety
    /// `cmd` is in the recording state on the device, outside a render pass; the device supports this way of capturing.
    pub unsafe fn record(self, device: &Device, cmd: vk::CommandBuffer, draw: impl Fn()) {
        for entry in self.schedule().entries {
            match entry {
                // SAFETY: the caller's obligations.
                Entry::Barrier(barrier) => unsafe { barriers::record(&device.raw, cmd, &barrier) },
                Entry::Work { .. } => draw(),
            }
        }
    }

    /// Returns the commands of a capture: a work, with the barriers around it.
    fn schedule(self) -> Schedule {
        const FEEDBACK: &[Use] = &[Use::new(Resource::Poses, Stage::TransformFeedback, Access::FeedbackWrite)];
        const STORE: &[Use] = &[Use::new(Resource::Poses, Stage::VertexShader, Access::ShaderWrite)];
        let (mut steps, mut schedule) = (Steps::new(Consumers::default()), Schedule::default());
        steps.step(match self {
            Self::Feedback => FEEDBACK,
            Self::Store => STORE,
        });
        steps.push(Work::default());
        schedule.fill([&steps].into_iter());
        schedule
    }
}

/// Adds the pipelines of a draw, and of its captures by feedback or stores, if the device can capture.
pub fn add_draws(
    objects: &mut Objects,
    [draw, feedback, store]: [&'static Kernel; 3],
    capture: Option<Capture>,
    deltas: DeltaFormat,
    (bindings, attributes): &VertexInput,
) -> Result<()> {
    let capturing = capture.map(|capture| if capture == Capture::Feedback { feedback } else { store });
    let kernels: Vec<_> = std::iter::once(draw).chain(capturing).collect();
    objects.add_layout(&kernels.iter().map(|kernel| kernel.row).collect::<Vec<_>>(), 0)?;
    objects.add_empty_render_pass()?;
    let module = |kernel: &'static Kernel| kernel.module(deltas.row(), PoseFormat::Float32.row(), 0);
    kernels.into_iter().try_for_each(|kernel| objects.add_discarding_vertex(module(kernel)?, bindings, attributes))
}

/// Bindings and attributes.
type VertexInput = (Vec<vk::VertexInputBindingDescription>, Vec<vk::VertexInputAttributeDescription>);

/// Returns whether the last update changes a pose.
pub fn has_changed(planner: &DensePlanner) -> bool {
    planner.plans().iter().any(|plan| !plan.passes.is_empty())
}

/// Makes a planner whose plans are one pass from base, or none, regardless of how many targets a draw takes.
pub fn one_pass(desc: &CrowdDesc) -> Result<DensePlanner> {
    let batch = if desc.update.path.takes_all_targets() { BatchSize::All } else { BatchSize::Targets(u32::MAX) };
    DensePlanner::new(UpdateDesc { batch, ..desc.update }, desc.instances as usize)
}

#[cfg(test)]
mod tests {
    use super::Capture;
    use crate::hazards::{Accesses, Event, HazardChecker, Memory, barriers_needed, trace};
    use crate::plan::schedule::asset_uploaded;
    use crate::plan::steps::{Access, Stage, Use};

    /// Captures with draws between them need each barrier.
    #[test]
    fn captures_are_ordered() {
        for (capture, stage, access) in [
            (Capture::Feedback, Stage::TransformFeedback, Access::FeedbackWrite),
            (Capture::Store, Stage::VertexShader, Access::ShaderWrite),
        ] {
            let write = Use::new(Memory::Pose { instance: 0, slot: 0 }, stage, access);
            let accesses = Accesses { uses: vec![write], ..Accesses::default() };
            let events = trace(&capture.schedule().entries, |_, _| vec![accesses.clone()]);
            assert_eq!(events.len(), 3, "{capture:?}: a barrier before, one after");
            let is_right = |updates: &[Vec<Event>]| {
                let mut checker = HazardChecker::default();
                checker.upload(asset_uploaded());
                for events in updates {
                    checker.update(events);
                    checker.draw(0, 0, 0);
                }
                checker.finish().is_ok()
            };
            assert_eq!(barriers_needed(&vec![events; 5], [3], is_right), 2, "{capture:?}");
        }
    }
}
