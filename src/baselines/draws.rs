//! What the direct paths have in common: draws that evaluate the pose, and the capture of what they evaluate.

use crate::error::{Error, Result};
use crate::gpu::device::Device;
use crate::gpu::mesh::MeshBuffers;
use crate::pack::BASE_STRIDE;
use crate::plan::instances::Instances;
use crate::plan::schedule::Schedule;
use crate::plan::steps::{Access, Resource, Stage, Steps, Use, Work};
use crate::plan::{BatchSize, Consumers, UpdateDesc, UpdatePath, UpdateStats};
use crate::update::crowd::CrowdDesc;
use crate::update::dense::DensePlanner;
use crate::update::technique::{Context, Technique, UpdateId};
use ash::vk;
use std::sync::Arc;

/// What records draws that evaluate the pose.
pub(crate) trait Draw {
    /// Record the draws of these instances, captured in the way that the device has, if requested.
    ///
    /// # Safety
    /// As [`record_draws`](crate::engine::MorphEngine::record_draws); an update has written what they read; captures have
    /// barriers around them.
    unsafe fn record(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>, captured: bool);
}

/// Draws that evaluate the pose from weights.
pub(crate) trait Draws: Draw + Send + Sync + 'static {
    /// What a crowd's draws take.
    fn new(context: Context<'_>) -> Result<Self>
    where
        Self: Sized;

    /// Write the weights of all instances for the draws to read, none for one that has no pose. A hidden instance's draws
    /// stay as they were, whatever is requested of it meanwhile.
    fn write(&mut self, planner: &DensePlanner, frame: u64) -> Result<()>;

    /// As [`Technique::check_weights`].
    fn check_weights(&self, _weights: &[f32]) -> Result<()> {
        Ok(())
    }

    /// Bytes that a draw of these weights loads beside the base pose and the deltas of the active targets.
    fn weight_bytes(&self, _weights: &[f32]) -> u64 {
        0
    }
}

/// A crowd on a direct path: an update writes weights, and there are no works.
pub(crate) struct DrawTechnique<D> {
    pub(super) draws: D,
    mesh: Arc<MeshBuffers>,
    planner: DensePlanner,
    /// The last update that wrote weights.
    written: u64,
    /// It never ran, and its part of the ring is the next one's.
    stale: bool,
}

impl<D: Draws> DrawTechnique<D> {
    pub(crate) fn new(context: Context<'_>) -> Result<Self> {
        let (mesh, planner) = (context.mesh.clone(), one_pass(context.desc)?);
        Ok(Self { draws: D::new(context)?, mesh, planner, written: 0, stale: false })
    }
}

impl<D: Draws> Technique for DrawTechnique<D> {
    /// A step without works: the draws find the weights where they were written. Bytes are what one draw of every
    /// instance that is shown loads: draws evaluate whether weights have changed or not.
    fn plan(&mut self, instances: &mut Instances, id: UpdateId, steps: &mut Steps) -> Result<UpdateStats> {
        self.planner.plan(instances, id.update);
        if self.planner.has_changed() || self.stale {
            (self.written, self.stale) = (id.update, false);
            self.draws.write(&self.planner, id.frame)?;
            steps.step(&[]);
        }
        let (layout, shown) = (&self.mesh.layout, || instances.requested().flatten());
        let active = shown().flatten().filter(|w| **w != 0.0).count();
        let loaded = BASE_STRIDE * shown().count() + active * layout.format.stride();
        let floor = (layout.padded_vertices() * loaded) as u64;
        Ok(UpdateStats {
            coefficients: active,
            rebuilt: self.planner.plans().iter().filter(|plan| !plan.passes.is_empty()).count(),
            bytes_moved: floor + shown().map(|weights| self.draws.weight_bytes(weights)).sum::<u64>(),
            bytes_floor: floor,
            ..UpdateStats::default()
        })
    }

    unsafe fn record(&self, _cmd: vk::CommandBuffer, _frame: u64, _work: &Work) {}

    fn discard_from(&mut self, id: UpdateId) {
        self.stale |= self.written >= id.update;
    }

    fn check_weights(&self, weights: &[f32]) -> Result<()> {
        self.draws.check_weights(weights)
    }

    fn has_poses(&self) -> bool {
        false
    }

    #[cfg(any(test, feature = "internals"))]
    fn accesses(&self, _works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        vec![]
    }
}

/// How a device captures what a draw evaluates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Capture {
    Feedback,
    Store,
}

impl Capture {
    /// The way that a device has, if any, to capture a pose that only the draws of `path` evaluate.
    pub(super) fn of(device: &Device, path: UpdatePath) -> Result<Self> {
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

    /// What a capture records: a work, with the barriers around it.
    pub(super) fn schedule(self) -> Schedule {
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

/// A planner of which each plan is one pass from base, or none, whatever number of targets a draw takes.
pub(super) fn one_pass(desc: &CrowdDesc) -> Result<DensePlanner> {
    let batch = match desc.update.path.takes_all_targets() {
        true => BatchSize::All,
        false => BatchSize::Targets(u32::MAX),
    };
    DensePlanner::new(UpdateDesc { batch, ..desc.update }, None, desc.instances as usize)
}

#[cfg(test)]
mod tests {
    use super::Capture;
    use crate::plan::hazards::{Accesses, Memory, trace};
    use crate::plan::steps::{Access, Stage, Use};
    use crate::plan::tests::assert_barriers_needed;

    /// Captures with draws between them: each barrier is needed.
    #[test]
    fn captures_are_ordered() {
        for (capture, stage, access) in [
            (Capture::Feedback, Stage::TransformFeedback, Access::FeedbackWrite),
            (Capture::Store, Stage::VertexShader, Access::ShaderWrite),
        ] {
            let write = Use::new(Memory::Pose { instance: 0, slot: 0 }, stage, access);
            let accesses = Accesses { uses: vec![write], ..Accesses::default() };
            let events = trace(&capture.schedule().entries, |_, _| vec![accesses.clone()]);
            assert_barriers_needed(&vec![(events, [Some(0), None]); 5], 2, &format!("{capture:?}"));
        }
    }
}
