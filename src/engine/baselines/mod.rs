//! What a crowd on one of the baselines has of its own: `scatter`, and the direct paths. (`vertex-store` is a dense path.)

mod direct;
mod scatter;

use super::crowd::{Crowd, CrowdDesc, PoseView};
use super::{GpuMesh, MeshBuffers, MorphEngine};
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::baselines::Baseline;
use crate::gpu::baselines::attributes::{Attributes, AttributesDraw, CaptureTarget};
use crate::gpu::baselines::scatter::Records;
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::mesh::packed::blocks::ExactGrid;
use crate::mesh::packed::{POSE_STRIDE, PackedMesh};
use crate::plan::commands::{CommandList, Hazard};
use crate::plan::{BatchSize, Plan, PoseState, UpdateDesc, UpdatePath, UpdateStats};
use crate::weights::delta::{Coefficient, active_targets};
use ash::vk;
use direct::DirectCrowd;
use scatter::ScatterCrowd;
use std::sync::Arc;

pub(super) struct BaselineCrowd {
    kernel: Arc<Baseline>,
    mesh: Arc<MeshBuffers>,
    kind: Kind,
    /// What is known to be applied; each plan is one pass from base, or none.
    pub(super) states: Vec<PoseState>,
    pub(super) plans: Vec<Plan>,
    /// The commands of `scatter`; direct paths have none.
    pub(super) list: CommandList,
}

enum Kind {
    Scatter(ScatterCrowd),
    Direct(DirectCrowd),
    /// The active targets of each instance.
    Attributes(Vec<Vec<Coefficient>>, CaptureTarget),
}

impl BaselineCrowd {
    pub(super) fn new(
        device: &Arc<Device>,
        mesh: &Arc<MeshBuffers>,
        kernel: Arc<Baseline>,
        desc: &CrowdDesc,
        poses: &Buffer,
    ) -> Result<Self> {
        let instances = desc.instances as usize;
        let kind = match &*kernel {
            Baseline::Scatter(scatter) => Kind::Scatter(ScatterCrowd::new(device, mesh, scatter, desc, poses)?),
            Baseline::Direct(direct) => Kind::Direct(DirectCrowd::new(device, mesh, direct, desc, poses)?),
            Baseline::Attributes(attributes) => {
                let target = attributes.capture_target(&mesh.layout, poses.raw)?;
                Kind::Attributes(vec![vec![]; instances], target)
            }
            Baseline::VertexStore(_) => {
                return Err(Error::invalid("'vertex-store' among paths without passes", "report this: it is a bug"));
            }
        };
        // One pass to a pose, whatever number of targets a draw takes.
        let batch = match desc.update.path.takes_all_targets() {
            true => BatchSize::All,
            false => BatchSize::Targets(u32::MAX),
        };
        let update = UpdateDesc { batch, ..desc.update };
        Ok(Self {
            kernel,
            mesh: mesh.clone(),
            kind,
            states: vec![PoseState::new(update)?; instances],
            plans: vec![Plan::default(); instances],
            list: CommandList::new(desc.update.path),
        })
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
        let Baseline::Attributes(attributes) = &*self.kernel else { return Ok(()) };
        let (active, most) = (weights.iter().filter(|w| **w != 0.0).count(), attributes.most());
        if active <= most as usize {
            return Ok(());
        }
        Err(Error::invalid(
            format!("{active} active targets through 'direct-attributes', whose draw has vertex attributes for {most}"),
            "set other weights to zero, use a larger batch size where the device has one, or the path 'direct'",
        ))
    }

    pub(super) fn plan(&mut self, weights: &[Vec<f32>], update: u64) -> UpdateStats {
        for ((state, weights), plan) in self.states.iter_mut().zip(weights).zip(&mut self.plans) {
            state.plan(weights, update, plan);
        }
        match &mut self.kind {
            Kind::Scatter(scatter) => {
                self.list.fill_scatter(&self.plans);
                scatter.stats(&self.mesh, &self.list, &self.plans)
            }
            Kind::Direct(_) => {
                let mut stats = self.draw_stats(weights);
                stats.bytes_moved += weights.iter().map(|weights| direct::bytes_read(weights)).sum::<u64>();
                stats
            }
            Kind::Attributes(lists, _) => {
                for (list, weights) in lists.iter_mut().zip(weights) {
                    list.clear();
                    active_targets(weights, list);
                }
                self.draw_stats(weights)
            }
        }
    }

    /// What one draw of every head loads: draws evaluate whether weights have changed or not.
    fn draw_stats(&self, weights: &[Vec<f32>]) -> UpdateStats {
        let layout = &self.mesh.layout;
        let active: usize = weights.iter().flatten().filter(|w| **w != 0.0).count();
        let loaded = POSE_STRIDE * weights.len() + active * layout.format.stride();
        let floor = (layout.padded_vertices() * loaded) as u64;
        UpdateStats {
            coefficients: active,
            rebuilt: self.plans.iter().filter(|plan| !plan.passes.is_empty()).count(),
            bytes_moved: floor,
            bytes_floor: floor,
            ..UpdateStats::default()
        }
    }

    /// Whether any weight of the update that was planned last differs from what was applied.
    pub(super) fn has_changed(&self) -> bool {
        self.plans.iter().any(|plan| !plan.passes.is_empty())
    }

    /// Write the planned commands, or the weights for the draws.
    ///
    /// # Safety
    /// As [`super::MorphEngine::record_update`].
    pub(super) unsafe fn record(
        &mut self,
        device: &Device,
        cmd: vk::CommandBuffer,
        weights: &[Vec<f32>],
        frame: u64,
    ) -> Result<()> {
        let changed = self.has_changed();
        match (&mut self.kind, &*self.kernel) {
            (Kind::Scatter(scatter), Baseline::Scatter(kernel)) => {
                // SAFETY: the caller's obligations; sets and buffers are this crowd's.
                unsafe { scatter.record(device, cmd, kernel, &self.mesh, &self.list) };
                Ok(())
            }
            (Kind::Direct(direct), _) if changed => direct.write(&self.mesh.layout, weights, frame),
            _ => Ok(()),
        }
    }

    fn attributes_draw(&self) -> AttributesDraw<'_> {
        AttributesDraw { layout: &self.mesh.layout, base: self.mesh.base.raw, deltas: self.mesh.deltas.raw }
    }

    /// # Safety
    /// As [`super::MorphEngine::record_draws`].
    pub(super) unsafe fn record_draws(&self, cmd: vk::CommandBuffer) {
        match (&self.kind, &*self.kernel) {
            // SAFETY: the caller's obligations; sets and lists are this crowd's.
            (Kind::Direct(direct), Baseline::Direct(kernel)) => unsafe { direct.record(cmd, kernel, &self.mesh, None) },
            (Kind::Attributes(lists, _), Baseline::Attributes(kernel)) => {
                // SAFETY: as above; `check_weights` has seen to the length of each list.
                unsafe { kernel.record_draws(cmd, &self.attributes_draw(), lists) };
            }
            _ => {}
        }
    }

    /// # Safety
    /// As [`super::MorphEngine::record_capture`].
    pub(super) unsafe fn record_capture(&self, device: &Device, cmd: vk::CommandBuffer, instance: u32) -> Result<()> {
        let feedback = match &*self.kernel {
            Baseline::Direct(kernel) => kernel.captures_by_feedback(),
            Baseline::Attributes(kernel) => Attributes::captures_by_feedback(kernel),
            Baseline::Scatter(_) | Baseline::VertexStore(_) => return Ok(()),
        }?;
        let [before, after] = match feedback {
            true => [Hazard::PoseReadToFeedbackUpdate, Hazard::FeedbackWriteToPoseRead],
            false => [Hazard::PoseReadToVertexStoreUpdate, Hazard::VertexStoreWriteToPoseRead],
        };
        // SAFETY: the caller's obligations; the device has what the pipelines were made for; sets, lists and the pose
        // are this crowd's.
        unsafe {
            barriers::record(&device.raw, cmd, before);
            match (&self.kind, &*self.kernel) {
                (Kind::Direct(direct), Baseline::Direct(kernel)) => {
                    direct.record(cmd, kernel, &self.mesh, Some(instance));
                }
                (Kind::Attributes(lists, target), Baseline::Attributes(kernel)) => {
                    kernel.record_capture(cmd, &self.attributes_draw(), &lists[instance as usize], target);
                }
                _ => {}
            }
            barriers::record(&device.raw, cmd, after);
        }
        Ok(())
    }
}

impl MorphEngine {
    /// As [`upload`](Self::upload), for crowds on the path `scatter`, which reads records of a vertex and its delta, 16
    /// bytes each, and no blocks.
    ///
    /// # Errors
    /// As [`upload`](Self::upload); a format other than `small`; sums that could overflow.
    ///
    /// # Safety
    /// As [`upload`](Self::upload).
    pub unsafe fn upload_scatter(&self, cmd: vk::CommandBuffer, mesh: &PackedMesh) -> Result<GpuMesh> {
        let layout = mesh.layout().clone();
        let index = layout.blocks.clone().filter(|_| UpdatePath::Scatter.formats().contains(&layout.format));
        let Some(index) = index else {
            return Err(Error::invalid(
                format!("update path 'scatter' with {} deltas", layout.format.name()),
                "pack the mesh as small",
            ));
        };
        index.exact()?;
        let Records { words, first } = Records::new(mesh, &index);
        let bytes = (size_of_val(words.as_slice()) as u64).max(16);
        self.check_not_empty(&layout)?;
        for (what, bytes) in [("a pose takes", layout.pose_bytes()), ("the records of 'scatter' take", bytes)] {
            let range = self.device.caps.max_storage_range;
            self.check_limit(&layout, what, (bytes, "bytes", range), "use fewer targets, or split the mesh")?;
        }
        // SAFETY: the caller's obligations.
        unsafe { self.upload_words(cmd, layout, mesh.base(), (&words, bytes), Some(first)) }
    }

    /// Record the draws of a crowd on a direct path, one for each head, each of which evaluates its pose: in a render
    /// pass without attachments, with every primitive discarded. It is what such a path costs, for `bench`; an engine
    /// that wanted to show the result would do the same in its own vertex shader.
    ///
    /// The caller is responsible for: recording it after [`record_update`](Self::record_update), and having at most
    /// [`CrowdDesc::frames_in_flight`] frames with draws unfinished, whether weights have changed in them or not: draws
    /// read the weights where the update wrote them. It binds over the graphics pipeline, its set 0, push constants, and
    /// vertex bindings from 0 on.
    ///
    /// # Errors
    /// A crowd that another engine made, or whose path has pose buffers to draw from; no update recorded yet.
    ///
    /// # Safety
    /// As [`record_update`](Self::record_update).
    pub unsafe fn record_draws(&self, cmd: vk::CommandBuffer, crowd: &Crowd) -> Result<()> {
        self.check_direct(crowd)?;
        // SAFETY: the caller's obligations.
        unsafe { crowd.record_draws(cmd) }
    }

    /// Record the draw of one head as [`record_draws`](Self::record_draws) does, and capture the pose that it evaluates:
    /// by transform feedback, or else by stores of the vertex shader, as the device has it. The crowd has room for one
    /// pose. Barriers are recorded as for an update through `feedback` or `vertex-store`.
    ///
    /// # Errors
    /// As [`record_draws`](Self::record_draws); a device that has neither.
    ///
    /// # Safety
    /// As [`record_draws`](Self::record_draws).
    pub unsafe fn record_capture(&self, cmd: vk::CommandBuffer, crowd: &Crowd, instance: u32) -> Result<PoseView> {
        self.check_direct(crowd)?;
        // SAFETY: the caller's obligations.
        unsafe { crowd.record_capture(cmd, instance) }
    }

    fn check_direct(&self, crowd: &Crowd) -> Result<()> {
        let path = crowd.desc().update.path;
        match (crowd.is_on(&self.device), path.evaluates_in_draws()) {
            (false, _) => Err(Error::invalid(
                "the crowd belongs to another MorphEngine",
                "record it with the engine that created it",
            )),
            (true, false) => Err(Error::invalid(
                format!("a draw that evaluates, of a crowd on the path '{}'", path.name()),
                "draw from Crowd::pose: the path has pose buffers",
            )),
            (true, true) => Ok(()),
        }
    }
}
