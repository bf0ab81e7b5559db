//! Updates: planned first, then recorded as they were planned.

use super::MorphEngine;
use super::base::{AnyCrowd, DeviceCrowd, Update};
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::caps::DeviceCaps;
use crate::plan::schedule::{Entry, Schedule};
use ash::vk;

impl MorphEngine {
    /// Record the update of all instances of `crowd` to the weights requested.
    ///
    /// This records: nothing when no weight changed; otherwise the passes of the plan with the barriers they need.
    /// First stages: those of the [consumers](crate::CrowdDesc::consumers) (reads of earlier poses) and the path's own;
    /// last: the consumers' (none, where all are on another queue), by default VERTEX_INPUT with VERTEX_ATTRIBUTE_READ
    /// and VERTEX_SHADER with SHADER_READ, so that draws recorded next may read [`Crowd::pose`](super::Crowd::pose) and
    /// [`Crowd::previous_pose`](super::Crowd::previous_pose) as vertex attributes or storage buffers.
    ///
    /// It binds over: the compute pipeline, its set 0 and push constants (`compute`, `blocks`, `scatter`, and
    /// [what follows the pose](crate::after)); the graphics pipeline, vertex bindings from 0 on, push constants and
    /// transform-feedback binding 0 (`feedback`), or set 0 (`vertex-store`).
    ///
    /// The direct paths record nothing: their update is a list of weights for their draws.
    ///
    /// The caller is responsible for: submitting `cmd` exactly once, after all earlier updates of the crowd,
    /// or calling [`Crowd::discard`](super::Crowd::discard) with the ticket; having at most
    /// [`CrowdDesc::frames_in_flight`](crate::CrowdDesc::frames_in_flight) updates unfinished, this one included;
    /// binding its own state anew; barriers of its own where other stages than those named read or have read poses.
    ///
    /// # Errors
    /// A crowd that another engine made. Nothing is recorded then.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering (the state of the crowd takes the update as done), on a queue of the
    ///   family that [`CrowdDesc::queue_family`](field@crate::CrowdDesc::queue_family) names, or else with graphics and
    ///   compute.
    /// - It runs exactly once, after the upload of the mesh and all earlier updates of the crowd, and before later
    ///   ones; or it never runs, and [`Crowd::discard`](super::Crowd::discard) is called with the ticket before any
    ///   later update is recorded.
    /// - A ticket is discarded only if neither its update nor any later one of the crowd runs: the next update takes
    ///   over the memory of their lists.
    /// - With this one, at most [`CrowdDesc::frames_in_flight`](crate::CrowdDesc::frames_in_flight) updates of the
    ///   crowd are recorded and not yet finished.
    /// - After an error or a panic nothing of the update counts as done; `cmd` may hold some of its commands after a
    ///   panic, and is not run then.
    /// - Engine, mesh and crowd live until the device has finished.
    pub unsafe fn record_update(&self, cmd: vk::CommandBuffer, crowd: &mut (impl AnyCrowd + ?Sized)) -> Result<Update> {
        let (mut crowds, mut update) = ([crowd.base_mut()], None);
        let planned = self.plan(&mut crowds, |planned| update = Some(planned))?;
        // SAFETY: the caller's obligations.
        unsafe { planned.record(&self.device.raw, cmd) };
        update.ok_or_else(|| Error::invalid("an update of an empty list of crowds", "pass at least one"))
    }

    /// Record the updates of several crowds, of either kind, as [`record_update`](Self::record_update) does for one.
    /// They share their barriers: one before all, one after all, and between only those that the longest of them needs.
    /// Returns the updates in the order of `crowds`.
    ///
    /// # Errors
    /// As [`record_update`](Self::record_update); crowds that are made for queues of different
    /// [families](field@crate::CrowdDesc::queue_family). Nothing is recorded then, and no update is taken as done:
    /// poses of crowds that were planned before the one that failed are written anew by their next update.
    ///
    /// # Safety
    /// As [`record_update`](Self::record_update), for each crowd.
    pub unsafe fn record_updates(
        &self,
        cmd: vk::CommandBuffer,
        crowds: &mut [&mut dyn AnyCrowd],
    ) -> Result<Vec<Update>> {
        let mut crowds: Vec<&mut DeviceCrowd> = crowds.iter_mut().map(|crowd| crowd.base_mut()).collect();
        let mut updates = Vec::with_capacity(crowds.len());
        let planned = self.plan(&mut crowds, |update| updates.push(update))?;
        // SAFETY: the caller's obligations.
        unsafe { planned.record(&self.device.raw, cmd) };
        Ok(updates)
    }

    /// Plan an update of every crowd, and in which order all are recorded.
    pub(super) fn plan<'a, 'b>(
        &self,
        crowds: &'a mut [&'b mut DeviceCrowd],
        mut update: impl FnMut(Update),
    ) -> Result<Planned<'a, 'b>> {
        crowds.iter().try_for_each(|crowd| crowd.check_device(&self.device))?;
        check_families(&self.device.caps, crowds.iter().map(|crowd| crowd.desc().queue_family))?;
        // Scratch space is kept from update to update.
        let schedule = crowds.first_mut().map(|crowd| std::mem::take(&mut crowd.kind.schedule)).unwrap_or_default();
        let mut planned = Planned { crowds, begun: 0, schedule };
        for i in 0..planned.crowds.len() {
            planned.begun = i + 1;
            update(planned.crowds[i].plan()?);
        }
        planned.schedule.fill(planned.crowds.iter().map(|crowd| &crowd.kind.steps));
        Ok(planned)
    }
}

/// Refuse crowds whose updates cannot run on the queue of one command buffer. Those that name no family are for one
/// with graphics and compute.
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
    Err(Error::invalid(text, "record those of each family into a command buffer of its own"))
}

/// Updates that are planned and not yet recorded: all are taken back when planning or recording fails or panics.
pub(super) struct Planned<'a, 'b> {
    pub(super) crowds: &'a mut [&'b mut DeviceCrowd],
    /// Crowds of which an update is planned, or was begun to be.
    begun: usize,
    pub(super) schedule: Schedule,
}

impl Planned<'_, '_> {
    /// Record what was planned.
    ///
    /// # Safety
    /// As [`MorphEngine::record_updates`].
    pub(super) unsafe fn record(mut self, device: &ash::Device, cmd: vk::CommandBuffer) {
        for entry in &self.schedule.entries {
            match entry {
                // SAFETY: the caller's obligations; techniques use only stages that their device has.
                Entry::Barrier(barrier) => unsafe { barriers::record(device, cmd, barrier) },
                Entry::Work { crowd, work, .. } => {
                    // SAFETY: the caller's obligations.
                    unsafe { self.crowds[*crowd as usize].record(cmd, work) };
                }
            }
        }
        self.begun = 0;
    }
}

impl Drop for Planned<'_, '_> {
    fn drop(&mut self) {
        self.crowds[..self.begun].iter_mut().for_each(|crowd| crowd.discard_last());
        if let Some(first) = self.crowds.first_mut() {
            first.kind.schedule = std::mem::take(&mut self.schedule);
        }
    }
}
