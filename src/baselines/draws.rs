//! What the direct paths have in common: draws that evaluate the pose, and the capture of what they evaluate.

use crate::error::{Error, Result};
use crate::gpu::device::Device;
use crate::pack::{BASE_STRIDE, PackedLayout};
use crate::plan::instances::Instances;
use crate::plan::schedule::Schedule;
use crate::plan::steps::{Access, Resource, Stage, Steps, Use, Work};
use crate::plan::{BatchSize, Consumers, CrowdDesc, UpdateDesc, UpdatePath, UpdateStats};
use crate::update::dense::DensePlanner;
use ash::vk;

/// A technique whose draws evaluate the pose.
pub(super) trait Draws {
    /// Record the draws of these instances.
    ///
    /// # Safety
    /// As [`record_draws`](crate::engine::MorphEngine::record_draws).
    unsafe fn record_draws(&self, cmd: vk::CommandBuffer, instances: &mut dyn Iterator<Item = u32>);

    /// How a pose is captured.
    ///
    /// # Errors
    /// The device has no way to do it.
    fn capture(&self) -> Result<Capture>;

    /// Record the draw of an instance, captured.
    ///
    /// # Safety
    /// As [`record_capture`](crate::engine::MorphEngine::record_capture); barriers are recorded around it.
    unsafe fn record_capture(&self, cmd: vk::CommandBuffer, instance: u32);
}

/// How a device captures what a draw evaluates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Capture {
    Feedback,
    Store,
}

impl Capture {
    /// The way that a device has.
    pub(super) fn of(device: &Device) -> Option<Self> {
        match device.caps.check_path(UpdatePath::Feedback).is_ok() {
            true => Some(Self::Feedback),
            false => device.caps.vertex_stores.then_some(Self::Store),
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

/// The refusal to capture a pose that only draws evaluate, on a device that cannot.
pub(super) fn no_capture(device: &Device, path: UpdatePath) -> Error {
    Error::Unsupported {
        path: path.name(),
        device: device.caps.name.clone(),
        reason: "its draws evaluate the pose, and to capture it the device needs VK_EXT_transform_feedback or the \
                 feature vertexPipelineStoresAndAtomics, enabled"
            .into(),
        remedy: "draw it, or use a path with pose buffers, such as 'compute'".into(),
    }
}

/// A planner of which each plan is one pass from base, or none, whatever number of targets a draw takes.
pub(super) fn one_pass(desc: &CrowdDesc) -> Result<DensePlanner> {
    let batch = match desc.update.path.takes_all_targets() {
        true => BatchSize::All,
        false => BatchSize::Targets(u32::MAX),
    };
    DensePlanner::new(UpdateDesc { batch, ..desc.update }, desc.instances as usize)
}

/// What one draw of every instance that is shown loads: draws evaluate whether weights have changed or not.
pub(super) fn draw_stats(layout: &PackedLayout, planner: &DensePlanner, instances: &Instances) -> UpdateStats {
    let active: usize = instances.requested().flatten().flatten().filter(|w| **w != 0.0).count();
    let loaded = BASE_STRIDE * instances.requested().flatten().count() + active * layout.format.stride();
    let floor = (layout.padded_vertices() * loaded) as u64;
    UpdateStats {
        coefficients: active,
        rebuilt: planner.plans().iter().filter(|plan| !plan.passes.is_empty()).count(),
        bytes_moved: floor,
        bytes_floor: floor,
        ..UpdateStats::default()
    }
}

#[cfg(test)]
mod tests {
    use super::Capture;
    use crate::plan::hazards::{Accesses, Event, HazardChecker, Memory, trace};
    use crate::plan::steps::{Access, Stage, Use};

    /// Two captures with a draw between them: each barrier is needed.
    #[test]
    fn captures_are_ordered() {
        for (capture, stage, access) in [
            (Capture::Feedback, Stage::TransformFeedback, Access::FeedbackWrite),
            (Capture::Store, Stage::VertexShader, Access::ShaderWrite),
        ] {
            let write = Use::new(Memory::Pose { instance: 0, slot: 0 }, stage, access);
            let accesses = Accesses { uses: vec![write], ..Accesses::default() };
            let events = trace(&capture.schedule().entries, |_, _| vec![accesses.clone()]);
            for dropped in [None, Some(0), Some(2)] {
                let mut checker = HazardChecker::new();
                checker.update(&events);
                checker.draw(0, 0, 0);
                let mut second = events.clone();
                if let Some(at) = dropped {
                    assert!(matches!(second.remove(at), Event::Barrier(_)));
                }
                checker.update(&second);
                checker.draw(0, 0, 0);
                assert_eq!(checker.finish().is_err(), dropped.is_some(), "{capture:?}, {dropped:?}");
            }
        }
    }
}
