//! What a crowd on one of the baselines has of its own: `scatter`, and the direct paths. (`vertex-store` is a dense path.)

mod direct;
mod face;
mod scatter;

use super::MeshBuffers;
use super::crowd::CrowdDesc;
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::baselines::Baseline;
use crate::gpu::baselines::attributes::{Attributes, AttributesDraw, CaptureTarget};
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::pack::POSE_STRIDE;
use crate::pack::blocks::ExactGrid;
use crate::plan::commands::{CommandList, Hazard};
use crate::plan::heads::Heads;
use crate::plan::{BatchSize, Plan, PoseState, UpdateDesc, UpdateStats};
use crate::weights::delta::{Coefficient, active_targets};
use ash::vk;
use direct::DirectCrowd;
use scatter::ScatterCrowd;
use std::sync::Arc;

pub(super) struct BaselineCrowd {
    mesh: Arc<MeshBuffers>,
    kind: Kind,
    /// What is known to be applied; each plan is one pass from base, or none.
    pub(super) states: Vec<PoseState>,
    pub(super) plans: Vec<Plan>,
    /// The commands of `scatter`; direct paths have none.
    pub(super) list: CommandList,
    /// The update that was planned last, and the last one that wrote weights for draws.
    planned: u64,
    written: u64,
    /// The latter never ran, and its part of the ring is the next one's.
    stale: bool,
}

/// Instances of a crowd that keeps no poses: each takes memory of the host and draws of its own.
const ATTRIBUTES_INSTANCES: u32 = 1 << 20;

enum Kind {
    Scatter(ScatterCrowd),
    Direct(DirectCrowd),
    Attributes(AttributesCrowd),
}

impl BaselineCrowd {
    /// `None` for `vertex-store`, whose passes are those of dense paths.
    pub(super) fn new(
        device: &Arc<Device>,
        mesh: &Arc<MeshBuffers>,
        kernel: &Baseline,
        desc: &CrowdDesc,
        poses: &Buffer,
    ) -> Result<Option<Self>> {
        let instances = desc.instances as usize;
        let kind = match kernel {
            Baseline::VertexStore(_) => return Ok(None),
            Baseline::Scatter(kernel) => Kind::Scatter(ScatterCrowd::new(device, mesh, kernel, desc, poses)?),
            Baseline::Direct(kernel) => Kind::Direct(DirectCrowd::new(device, mesh, kernel, desc, poses)?),
            Baseline::Attributes(_) if desc.instances > ATTRIBUTES_INSTANCES => {
                return Err(Error::invalid(
                    format!("{} instances through 'direct-attributes'", desc.instances),
                    format!("make several crowds of at most {ATTRIBUTES_INSTANCES}"),
                ));
            }
            Baseline::Attributes(kernel) => {
                let target = kernel.capture_target(&mesh.layout, poses.raw)?;
                Kind::Attributes(AttributesCrowd { kernel: kernel.clone(), active: vec![vec![]; instances], target })
            }
        };
        // One pass to a pose, whatever number of targets a draw takes.
        let batch = match desc.update.path.takes_all_targets() {
            true => BatchSize::All,
            false => BatchSize::Targets(u32::MAX),
        };
        let update = UpdateDesc { batch, ..desc.update };
        Ok(Some(Self {
            mesh: mesh.clone(),
            kind,
            states: vec![PoseState::new(update)?; instances],
            plans: vec![Plan::default(); instances],
            list: CommandList::new(desc.update.path),
            planned: 0,
            written: 0,
            stale: false,
        }))
    }

    /// The grid of the weights of `scatter`.
    pub(super) fn exact(&self) -> Option<ExactGrid> {
        match &self.kind {
            Kind::Scatter(scatter) => Some(scatter.grid),
            _ => None,
        }
    }

    /// The integer sums of an instance: buffer and offset.
    #[cfg(feature = "headless")]
    pub(super) fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        match &self.kind {
            Kind::Scatter(scatter) => Some(scatter.sums(instance, self.mesh.layout.pose_bytes())),
            _ => None,
        }
    }

    /// Refuse more active targets than a draw has attributes for.
    pub(super) fn check_weights(&self, weights: &[f32]) -> Result<()> {
        let Kind::Attributes(attributes) = &self.kind else { return Ok(()) };
        let (active, most) = (weights.iter().filter(|w| **w != 0.0).count(), attributes.kernel.most());
        if active <= most as usize {
            return Ok(());
        }
        Err(Error::invalid(
            format!("{active} active targets through 'direct-attributes', whose draw has vertex attributes for {most}"),
            "set other weights to zero, use a larger batch size where the device has one, or the path 'direct'",
        ))
    }

    pub(super) fn plan(&mut self, heads: &Heads, update: u64) -> UpdateStats {
        for ((state, asked), plan) in self.states.iter_mut().zip(heads.asked()).zip(&mut self.plans) {
            match asked {
                Some(weights) => state.plan(weights, update, plan),
                None => plan.clear(),
            }
        }
        self.planned = update;
        match &mut self.kind {
            Kind::Scatter(scatter) => {
                self.list.fill_scatter(&self.plans);
                scatter.stats(&self.mesh, &self.list, &self.plans)
            }
            Kind::Direct(_) => {
                let mut stats = self.draw_stats(heads);
                stats.bytes_moved += heads.asked().flatten().map(direct::bytes_read).sum::<u64>();
                stats
            }
            Kind::Attributes(attributes) => {
                for (active, state) in attributes.active.iter_mut().zip(&self.states) {
                    active.clear();
                    active_targets(state.applied().unwrap_or_default(), active);
                }
                self.draw_stats(heads)
            }
        }
    }

    /// What one draw of every head that is shown loads: draws evaluate whether weights have changed or not.
    fn draw_stats(&self, heads: &Heads) -> UpdateStats {
        let layout = &self.mesh.layout;
        let active: usize = heads.asked().flatten().flatten().filter(|w| **w != 0.0).count();
        let loaded = POSE_STRIDE * heads.asked().flatten().count() + active * layout.format.stride();
        let floor = (layout.padded_vertices() * loaded) as u64;
        UpdateStats {
            coefficients: active,
            rebuilt: self.plans.iter().filter(|plan| !plan.passes.is_empty()).count(),
            bytes_moved: floor,
            bytes_floor: floor,
            ..UpdateStats::default()
        }
    }

    /// Whether the update that was planned last has something to write.
    pub(super) fn has_changed(&self) -> bool {
        self.stale || self.plans.iter().any(|plan| !plan.passes.is_empty())
    }

    /// The update numbered `first` and all later ones will never run.
    pub(super) fn discard_from(&mut self, first: u64) {
        self.states.iter_mut().for_each(|state| state.discard_from(first));
        self.stale |= self.written >= first;
    }

    /// Write the planned commands, or the weights for the draws.
    ///
    /// # Safety
    /// As [`super::MorphEngine::record_update`].
    pub(super) unsafe fn record(&mut self, device: &Device, cmd: vk::CommandBuffer, frame: u64) -> Result<()> {
        let changed = self.has_changed();
        match &mut self.kind {
            Kind::Scatter(scatter) => {
                // SAFETY: the caller's obligations; the list is that of this crowd.
                unsafe { scatter.record(device, cmd, &self.mesh, &self.list) };
                Ok(())
            }
            Kind::Direct(direct) if changed => {
                (self.written, self.stale) = (self.planned, false);
                // A hidden head's draws go on as they were, whatever it is asked for meanwhile.
                let applied = self.states.iter().map(|state| state.applied().unwrap_or_default());
                direct.write(&self.mesh.layout, applied, frame)
            }
            Kind::Direct(_) | Kind::Attributes(_) => Ok(()),
        }
    }

    /// # Safety
    /// As [`super::MorphEngine::record_draws`].
    pub(super) unsafe fn record_draws(&self, cmd: vk::CommandBuffer, shown: impl Iterator<Item = u32>) {
        match &self.kind {
            Kind::Scatter(_) => {}
            // SAFETY: the caller's obligations.
            Kind::Direct(direct) => unsafe { direct.record(cmd, &self.mesh, shown, false) },
            // SAFETY: the caller's obligations; `check_weights` has seen to the length of each list.
            Kind::Attributes(a) => unsafe {
                let lists = shown.map(|i| &a.active[i as usize][..]);
                a.kernel.record_draws(cmd, &attributes_draw(&self.mesh), lists);
            },
        }
    }

    /// # Safety
    /// As [`super::MorphEngine::record_capture`].
    pub(super) unsafe fn record_capture(&self, device: &Device, cmd: vk::CommandBuffer, instance: u32) -> Result<()> {
        let feedback = match &self.kind {
            Kind::Scatter(_) => return Ok(()),
            Kind::Direct(direct) => direct.kernel.captures_by_feedback(),
            Kind::Attributes(attributes) => attributes.kernel.captures_by_feedback(),
        }?;
        let [before, after] = match feedback {
            true => [Hazard::PoseReadToFeedbackUpdate, Hazard::FeedbackWriteToPoseRead],
            false => [Hazard::PoseReadToVertexStoreUpdate, Hazard::VertexStoreWriteToPoseRead],
        };
        // SAFETY: the caller's obligations; the device has what the pipelines were made for; sets, lists and the pose
        // are this crowd's.
        unsafe {
            barriers::record(&device.raw, cmd, before);
            match &self.kind {
                Kind::Scatter(_) => {}
                Kind::Direct(direct) => direct.record(cmd, &self.mesh, [instance].into_iter(), true),
                Kind::Attributes(attributes) => {
                    let AttributesCrowd { kernel, active, target } = attributes;
                    kernel.record_capture(cmd, &attributes_draw(&self.mesh), &active[instance as usize], target);
                }
            }
            barriers::record(&device.raw, cmd, after);
        }
        Ok(())
    }
}

/// A crowd on the path `direct-attributes`: the active targets of each instance.
struct AttributesCrowd {
    kernel: Arc<Attributes>,
    active: Vec<Vec<Coefficient>>,
    target: CaptureTarget,
}

fn attributes_draw(mesh: &MeshBuffers) -> AttributesDraw<'_> {
    AttributesDraw { layout: &mesh.layout, base: mesh.base.raw, deltas: mesh.deltas.raw }
}
