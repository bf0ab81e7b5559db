//! Updates: planned first, then recorded.

use super::MorphEngine;
use super::base::{Crowd, Update};
use crate::error::{Error, Result, refuse};
use crate::gpu::barriers;
use crate::gpu::caps::DeviceCaps;
use crate::gpu::device::Device;
use crate::plan::schedule::{Entry, Schedule};
use ash::vk;

impl MorphEngine {
    /// Records the update of all instances of `crowd` to the requested weights.
    ///
    /// Records: nothing if no weight changed; otherwise the passes of the plan with the barriers they need. First
    /// stages: those of the [consumers](crate::CrowdDesc::consumers) (reads of earlier poses) and the path's own. Last
    /// stages: the consumers' (none, if all are on another queue), by default VERTEX_INPUT with VERTEX_ATTRIBUTE_READ
    /// and VERTEX_SHADER with SHADER_READ, so that draws recorded next may read [`Crowd::pose`](super::Crowd::pose) and
    /// [`Crowd::previous_pose`](super::Crowd::previous_pose) as vertex attributes or storage buffers.
    ///
    /// It overwrites these bindings: the compute pipeline, its set 0 and push constants (`compute`, `blocks`,
    /// `scatter`, and [post-morph passes](crate::after)); the graphics pipeline, vertex bindings from 0 on, push
    /// constants and transform-feedback binding 0 (`feedback`), or set 0 (`vertex-store`).
    ///
    /// The direct paths record nothing: their update is a list of weights for their draws.
    ///
    /// The caller is responsible for: submitting `cmd` exactly once, after all earlier updates of the crowd, or calling
    /// [`Crowd::discard`](super::Crowd::discard) with the ticket; having at most
    /// [`CrowdDesc::frames_in_flight`](crate::CrowdDesc::frames_in_flight) updates unfinished, including this one (see
    /// Safety); restoring its own bindings; barriers of its own if other stages than the consumers' read poses.
    ///
    /// # Errors
    /// A crowd of another engine; fewer [queries](crate::Crowd::set_queries) than timestamps. Nothing is recorded
    /// then.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering (the crowd counts the update as executed), on a queue of family
    ///   [`CrowdDesc::queue_family`](crate::CrowdDesc::queue_family) or, if that is `None`, with graphics and compute.
    /// - It runs exactly once, after the upload of the mesh and all earlier updates of the crowd, and before later
    ///   ones; or it never runs, and [`Crowd::discard`](super::Crowd::discard) is called with the ticket before any
    ///   later update of the crowd is submitted. Updates recorded after it are discarded with it, and never run either:
    ///   the next update reuses the memory of their lists.
    /// - Including this one, at most [`CrowdDesc::frames_in_flight`](crate::CrowdDesc::frames_in_flight) updates of the
    ///   crowd are recorded but unfinished; of one that plays clips without [post-morph
    ///   passes](crate::after), any number.
    /// - After an error or a panic the update does not count as recorded; after a panic `cmd` may contain some of its
    ///   commands, and must not be submitted.
    /// - Engine, mesh and crowd live until the device has finished.
    pub unsafe fn record_update(&self, cmd: vk::CommandBuffer, crowd: &mut Crowd) -> Result<Update> {
        let (mut crowds, mut update) = ([crowd], None);
        let planned = self.plan(&mut crowds, |planned| update = Some(planned))?;
        // SAFETY: the caller's obligations.
        unsafe { planned.record(&self.device, cmd) };
        update.ok_or_else(|| Error::invalid("an update of an empty list of crowds", "pass at least one"))
    }

    /// Records the updates of several crowds, like [`record_update`](Self::record_update) for each.
    /// They share barriers: one before all, one after all, and in between only those that the longest update needs.
    /// Returns the updates in the order of `crowds`.
    ///
    /// # Errors
    /// Those of [`record_update`](Self::record_update); crowds for queues of different
    /// [families](crate::CrowdDesc::queue_family). Nothing is recorded then, and no update takes effect: crowds
    /// planned before the one that failed rewrite their poses in their next update.
    ///
    /// # Safety
    /// See [`record_update`](Self::record_update), for each crowd.
    pub unsafe fn record_updates(&self, cmd: vk::CommandBuffer, crowds: &mut [&mut Crowd]) -> Result<Vec<Update>> {
        let mut updates = Vec::with_capacity(crowds.len());
        let planned = self.plan(crowds, |update| updates.push(update))?;
        // SAFETY: the caller's obligations.
        unsafe { planned.record(&self.device, cmd) };
        Ok(updates)
    }

    /// Plans an update of every crowd, and their common schedule.
    pub(super) fn plan<'a, 'b>(
        &self,
        crowds: &'a mut [&'b mut Crowd],
        mut update: impl FnMut(Update),
    ) -> Result<Planned<'a, 'b>> {
        crowds.iter().try_for_each(|crowd| crowd.check_device(&self.device))?;
        check_families(&self.device.caps, crowds.iter().map(|crowd| crowd.desc().queue_family))?;
        // The schedule's storage is reused.
        let schedule = crowds.first_mut().map(|crowd| std::mem::take(&mut crowd.schedule)).unwrap_or_default();
        let mut planned = Planned { crowds, begun: 0, schedule };
        for i in 0..planned.crowds.len() {
            planned.begun = i + 1;
            update(planned.crowds[i].plan()?);
        }
        planned.schedule.fill(planned.crowds.iter().map(|crowd| &crowd.steps));
        Ok(planned)
    }
}

/// Checks that all updates can run on the queue of one command buffer. Crowds without a family need graphics and
/// compute.
fn check_families(caps: &DeviceCaps, families: impl Iterator<Item = Option<u32>> + Clone) -> Result<()> {
    let Some(one) = families.clone().flatten().next() else { return Ok(()) };
    let default = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    let suits = |family| match family {
        Some(family) => family == one,
        None => caps.queue_flags(one).is_ok_and(|flags| flags.contains(default)),
    };
    let mut others = families.filter(|family| !suits(*family));
    let Some(other) = others.next() else { return Ok(()) };
    let other = other.map_or("of one with graphics and compute".into(), |other| format!("of family {other}"));
    let text = format!("updates on a queue of family {one} and {other}, recorded into one command buffer");
    refuse(text, "record those of each family into a command buffer of its own")
}

/// Planned updates that are not yet recorded; dropping it discards them.
pub(super) struct Planned<'a, 'b> {
    pub crowds: &'a mut [&'b mut Crowd],
    /// Crowds whose planning has begun.
    begun: usize,
    pub schedule: Schedule,
}

impl Planned<'_, '_> {
    /// Records what was planned.
    ///
    /// # Safety
    /// See [`MorphEngine::record_updates`].
    pub unsafe fn record(mut self, device: &Device, cmd: vk::CommandBuffer) {
        let Self { crowds, schedule, .. } = &mut self;
        // SAFETY: the caller's obligations; techniques use only stages that their device has; each label is ended.
        unsafe {
            if !schedule.entries.is_empty() {
                device.begin_label(cmd, "deltamorph update");
            }
            crowds.iter_mut().for_each(|crowd| crowd.write_timestamp(cmd));
            for run in schedule.entries.chunk_by(|a, b| a.step() == b.step()) {
                if let Entry::Work { crowd, work, .. } = &run[0] {
                    device.begin_label(cmd, crowds[*crowd as usize].step_name(work));
                }
                for entry in run {
                    match entry {
                        Entry::Barrier(barrier) => barriers::record(&device.raw, cmd, barrier),
                        Entry::Work { crowd, work, .. } => crowds[*crowd as usize].record(cmd, work),
                    }
                }
                if let Some((crowd, _)) = run[0].step() {
                    device.end_label(cmd);
                    crowds[crowd as usize].write_timestamp(cmd);
                }
            }
            if !schedule.entries.is_empty() {
                device.end_label(cmd);
            }
        }
        self.begun = 0;
    }
}

impl Drop for Planned<'_, '_> {
    fn drop(&mut self) {
        self.crowds[..self.begun].iter_mut().for_each(|crowd| crowd.discard_last());
        self.crowds.iter_mut().for_each(|crowd| crowd.queries = None);
        if let Some(first) = self.crowds.first_mut() {
            first.schedule = std::mem::take(&mut self.schedule);
        }
    }
}
