//! A crowd that is updated, timed, drawn and read back step by step.

mod after;
mod read;

use super::Headless;
use super::draw::{Draws, PoseDraw};
use super::submit::Readback;
use crate::plan::schedule::Entry;
use deltamorph::ash::vk;
use deltamorph::{
    AnimationDesc, Crowd, CrowdDesc, Error, GpuMesh, PackedMesh, Playback, PoseReadback, Result, Ticket, Update,
};
use std::collections::VecDeque;
use std::ops::Range;
use std::slice::from_ref;
use std::time::Instant;

/// The times of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The recorded update.
    pub update: Update,
    /// Device time of the update in milliseconds, if the device has timestamps.
    pub gpu_ms: Option<f64>,
    /// Device time in milliseconds of the draws after the update, if the device has timestamps; `None` without draws.
    pub draw_ms: Option<f64>,
    /// Round trip from weights to fence, in milliseconds.
    pub cpu_ms: f64,
}

/// A recorded update of a [`HeadlessCrowd`], for one call of [`HeadlessCrowd::submit`] of the same crowd.
pub struct Recorded {
    cmd: vk::CommandBuffer,
    ticket: Ticket,
}

/// A mesh and a crowd on a [`Headless`] device.
pub struct HeadlessCrowd<'a> {
    headless: &'a Headless,
    mesh: GpuMesh,
    crowd: Crowd,
    draw: PoseDraw,
    readback: Readback,
    poses: PoseReadback,
    /// Updates recorded and not yet submitted, in order. Later updates may have overwritten their lists.
    waiting: VecDeque<Ticket>,
}

impl<'a> HeadlessCrowd<'a> {
    /// Uploads `mesh` and makes a crowd.
    ///
    /// # Errors
    /// Those of [`upload`](deltamorph::MorphEngine::upload) and
    /// [`create_crowd`](deltamorph::MorphEngine::create_crowd).
    pub fn new(headless: &'a Headless, mesh: &PackedMesh, desc: &CrowdDesc) -> Result<Self> {
        let engine = &headless.engine;
        // SAFETY: the submitter hands out a recording buffer of the engine's device; it waits for the device.
        let mesh = headless.upload(|cmd| unsafe { engine.upload_for(cmd, mesh, desc.update.path) })?;
        let crowd = engine.create_crowd(&mesh, desc)?;
        Self::with(headless, mesh, crowd)
    }

    /// Makes another crowd of the same mesh, which is not uploaded again.
    ///
    /// # Errors
    /// Those of [`create_crowd`](deltamorph::MorphEngine::create_crowd).
    pub fn another(&self, desc: &CrowdDesc) -> Result<Self> {
        let crowd = self.headless.engine.create_crowd(&self.mesh, desc)?;
        Self::with(self.headless, self.mesh.shared(), crowd)
    }

    /// Uploads `mesh` and makes a crowd that is animated on the GPU. [`step`](Self::step), called without weights,
    /// advances it to the time last set.
    ///
    /// # Errors
    /// Those of [`upload`](deltamorph::MorphEngine::upload) and
    /// [`create_animated_crowd`](deltamorph::MorphEngine::create_animated_crowd).
    pub fn animated(
        headless: &'a Headless,
        mesh: &PackedMesh,
        desc: &CrowdDesc,
        animation: &AnimationDesc<'_>,
    ) -> Result<Self> {
        let (engine, submitter) = (&headless.engine, &headless.submitter);
        // SAFETY: the submitter hands out a recording buffer of the engine's device; it waits for the device.
        let mesh = headless.upload(|cmd| unsafe { engine.upload(cmd, mesh) })?;
        // SAFETY: as above.
        let mut crowd = submitter.run(|cmd| unsafe { engine.create_animated_crowd(cmd, &mesh, desc, animation) })?;
        crowd.release_staging();
        Self::with(headless, mesh, crowd)
    }

    /// See [`Crowd::play`].
    pub fn play(&mut self, instance: u32, playback: &Playback) -> Result<()> {
        self.crowd.play(instance, playback)
    }

    /// See [`Crowd::set_level`].
    pub fn set_level(&mut self, instance: u32, level: f32) -> Result<()> {
        self.crowd.set_level(instance, level)
    }

    /// See [`Crowd::set_time`].
    pub fn set_time(&mut self, seconds: f64) -> Result<()> {
        self.crowd.set_time(seconds)
    }

    fn with(headless: &'a Headless, mesh: GpuMesh, crowd: Crowd) -> Result<Self> {
        let device = headless.engine.device();
        let pose = crowd.view(0, 0, 0);
        let draw = PoseDraw::new(device, pose.format)?;
        let readback = Readback::new(device, mesh.layout().base_bytes())?;
        let poses = headless.engine.readback();
        Ok(Self { headless, mesh, crowd, draw, readback, poses, waiting: VecDeque::new() })
    }

    /// Returns the crowd, read-only: only the methods here change it, so no crowd of another device can replace it.
    pub fn crowd(&self) -> &Crowd {
        &self.crowd
    }

    /// Returns the mesh.
    pub fn mesh(&self) -> &GpuMesh {
        &self.mesh
    }

    /// See [`Crowd::begin_at`].
    #[doc(hidden)]
    pub fn begin_at(&mut self, updates: u64) {
        self.crowd.begin_at(updates);
    }

    /// See [`Crowd::set_weights`].
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        self.crowd.set_weights(instance, weights)
    }

    /// See [`Crowd::changed`].
    pub fn changed(&mut self, instance: u32) -> Vec<Range<u32>> {
        self.crowd.changed(instance)
    }

    /// See [`Crowd::reset_history`].
    pub fn reset_history(&mut self, instance: u32) -> Result<()> {
        self.crowd.reset_history(instance)
    }

    /// See [`Crowd::set_hidden`].
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
        self.crowd.set_hidden(instance, hidden)
    }

    /// See [`Crowd::add`].
    pub fn add(&mut self) -> Result<u32> {
        self.crowd.add()
    }

    /// See [`Crowd::remove`].
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.crowd.remove(instance)
    }

    /// Discards the update of `ticket` and all recorded after it, which never run: see [`Crowd::discard`].
    /// [`submit`](Self::submit) refuses them afterwards.
    ///
    /// # Errors
    /// The ticket belongs to another crowd, or its update is not waiting to be submitted.
    pub fn discard(&mut self, ticket: Ticket) -> Result<()> {
        if let Some(first) = self.waiting.iter().position(|waiting| *waiting == ticket) {
            self.waiting.truncate(first);
        } else if !self.crowd.is_discarded(ticket)? {
            return Err(Error::invalid(
                "the update to discard is not waiting: it was submitted, or left behind by a step",
                "discard updates before others are recorded or run",
            ));
        }
        self.crowd.discard(ticket)
    }

    /// Requests `weights[i]` for instance `i`, updates, and waits. Updates recorded earlier and not yet submitted can
    /// no longer be submitted.
    ///
    /// # Errors
    /// Invalid weights; the device fails. The update then does not run, and the next one makes up for it.
    pub fn step(&mut self, weights: &[&[f32]]) -> Result<Step> {
        Self::step_together(std::slice::from_mut(self), weights, Draws::default())
    }

    /// Steps several crowds together ([`step`](Self::step)), then draws the poses of all instances, in one
    /// submission. `weights` and the counts refer to the instances of all crowds.
    ///
    /// # Errors
    /// Those of [`step`](Self::step); no crowds, crowds on several devices, or more weights than instances.
    pub fn step_together(crowds: &mut [Self], weights: &[&[f32]], draws: Draws) -> Result<Step> {
        Self::step_all(crowds, weights, draws, |headless, crowds, cmd| {
            // SAFETY: the buffer is recording on the engine's device, on a queue with graphics and compute; it is
            // submitted once, and waited for, before anything else happens.
            unsafe { headless.engine.record_updates(cmd, crowds) }
        })
    }

    /// [`step_together`](Self::step_together) with the recorded works changed by `tamper`, for tests that inject
    /// faults, or look at them.
    ///
    /// # Errors
    /// Those of [`step_together`](Self::step_together).
    ///
    /// # Safety
    /// The works stay within the existing slots, instances and coefficients.
    #[doc(hidden)]
    pub unsafe fn step_tampered(
        crowds: &mut [Self],
        weights: &[&[f32]],
        tamper: impl FnOnce(&mut Vec<Entry>),
    ) -> Result<Step> {
        Self::step_all(crowds, weights, Draws::default(), |headless, crowds, cmd| {
            // SAFETY: as in `step_together`; the caller answers for the tampering.
            unsafe { headless.engine.record_tampered(cmd, crowds, tamper) }
        })
    }

    fn step_all(
        crowds: &mut [Self],
        weights: &[&[f32]],
        draws: Draws,
        record: impl FnOnce(&Headless, &mut [&mut Crowd], vk::CommandBuffer) -> Result<Vec<Update>>,
    ) -> Result<Step> {
        let Some(headless) = crowds.first().map(|crowd| crowd.headless) else {
            return Err(Error::invalid("a step of an empty list of crowds", "pass at least one"));
        };
        if !crowds.iter().all(|crowd| std::ptr::eq(crowd.headless, headless)) {
            return Err(Error::invalid(
                "a step of crowds on several devices",
                "step those of each device by themselves",
            ));
        }
        let start = Instant::now();
        let mut rest = weights.iter();
        for this in &mut *crowds {
            for (instance, weights) in (0..this.crowd.desc().instances).zip(&mut rest) {
                this.set_weights(instance, weights)?;
            }
        }
        if rest.len() > 0 {
            return Err(Error::invalid(
                format!("weights for {} instances, {} too many", weights.len(), rest.len()),
                "give one list of weights per instance",
            ));
        }
        let mut tickets = vec![];
        let ran = headless.submitter.run_timed(|cmd, next_part| {
            crowds.iter_mut().for_each(|this| this.waiting.clear());
            let mut all: Vec<_> = crowds.iter_mut().map(|this| &mut this.crowd).collect();
            let updates = record(headless, &mut all, cmd)?;
            tickets.extend(updates.iter().map(|update| update.ticket));
            let mut sum = updates[0];
            updates[1..].iter().for_each(|update| sum.stats += update.stats);
            next_part();
            Self::record_draws(crowds, cmd, draws)?;
            Ok(sum)
        });
        if ran.is_err() {
            // Nothing ran, whatever has been recorded so far.
            crowds.iter_mut().zip(tickets).try_for_each(|(this, ticket)| this.crowd.discard(ticket))?;
        }
        let (update, [gpu_ms, draw_ms]) = ran?;
        let load_ms = headless.submitter.load.get().map_or(0.0, |load| load.ms.get());
        let cpu_ms = start.elapsed().as_secs_f64() * 1e3 - load_ms;
        Ok(Step { update, gpu_ms, draw_ms: draw_ms.filter(|_| draws.any()), cpu_ms })
    }

    /// Records an update that the caller runs later with [`submit`](Self::submit), so that tests can delay, drop and
    /// reorder submissions.
    ///
    /// # Errors
    /// Those of [`step`](Self::step); more waiting updates than [`CrowdDesc::frames_in_flight`].
    pub fn record(&mut self, weights: &[&[f32]]) -> Result<(Recorded, Update)> {
        let base = &self.crowd;
        let most = u64::from(base.desc().frames_in_flight);
        // Crowds animated on the GPU have no lists that could be overwritten.
        let has_lists = base.clips().is_none();
        if has_lists && self.waiting.front().is_some_and(|first| base.recorded_since(*first) >= most) {
            return Err(Error::invalid(
                format!("{most} updates wait to be submitted, as many as frames may be in flight"),
                "submit or discard some, or make the crowd with more frames in flight",
            ));
        }
        for (instance, weights) in weights.iter().enumerate() {
            self.set_weights(instance as u32, weights)?;
        }
        let (engine, submitter, crowd) = (&self.headless.engine, &self.headless.submitter, &mut self.crowd);
        let cmd = submitter.allocate()?;
        let mut ticket = None;
        let recorded = submitter.record(cmd, |cmd| {
            // SAFETY: the buffer is recording on the engine's device, on a queue with graphics and compute; `submit`
            // takes it once, in order, and only while its lists are unchanged.
            let update = unsafe { engine.record_update(cmd, crowd) }?;
            ticket = Some(update.ticket);
            Ok(update)
        });
        if let (Err(_), Some(ticket)) = (&recorded, ticket) {
            self.crowd.discard(ticket)?;
        }
        let update = recorded?;
        self.waiting.push_back(update.ticket);
        Ok((Recorded { cmd, ticket: update.ticket }, update))
    }

    /// Runs recorded updates of this crowd, which are the oldest waiting ones, in recording order, and waits.
    ///
    /// # Errors
    /// Updates of another crowd, out of order, discarded, or dropped by a [`step`](Self::step); nothing runs then. The
    /// device fails.
    pub fn submit(&mut self, recorded: Vec<Recorded>) -> Result<()> {
        let count = recorded.len();
        let fits =
            count <= self.waiting.len() && recorded.iter().map(|r| r.ticket).eq(self.waiting.range(..count).copied());
        if !fits {
            return Err(Error::invalid(
                "the updates to submit are not the oldest ones that wait in this crowd, in their order",
                "submit each update once, to the crowd that recorded it, before it is discarded or another step runs",
            ));
        }
        let cmds: Vec<vk::CommandBuffer> = recorded.iter().map(|r| r.cmd).collect();
        let ran = self.headless.submitter.submit(&cmds);
        match (&ran, recorded.first()) {
            (Err(_), Some(first)) => self.discard(first.ticket)?,
            _ => {
                self.waiting.drain(..count);
                self.headless.submitter.free(&cmds);
            }
        }
        ran
    }

    /// Draws the pose of every instance, discarding all primitives; returns device time in milliseconds. On a direct
    /// path each of these draws evaluates the pose, position and normal.
    ///
    /// # Errors
    /// No update recorded yet; the device fails.
    pub fn draw(&self, draws: Draws) -> Result<Option<f64>> {
        let submitter = &self.headless.submitter;
        let ((), [ms, _]) = submitter.run_timed(|cmd, _| Self::record_draws(from_ref(self), cmd, draws))?;
        Ok(ms)
    }

    fn record_draws(crowds: &[Self], cmd: vk::CommandBuffer, draws: Draws) -> Result<()> {
        for positions in draws.passes() {
            crowds.iter().try_for_each(|crowd| crowd.record_pass(cmd, draws.copies, positions))?;
        }
        Ok(())
    }

    fn record_pass(&self, cmd: vk::CommandBuffer, copies: u32, positions: bool) -> Result<()> {
        let (base, mut poses) = (&self.crowd, vec![]);
        if let Some(draws) = base.draws(0) {
            base.shown().try_for_each(|instance| base.slots_of(instance).map(drop))?;
            // SAFETY: as in `step_together`.
            (0..copies).for_each(|_| unsafe { draws.record(cmd, &mut base.shown()) });
            return Ok(());
        }
        for instance in base.shown() {
            let pose = base.group_pose(instance, 0)?;
            poses.extend(std::iter::repeat_n((pose.buffer, pose.offset), copies as usize));
        }
        self.draw.record(cmd, poses.into_iter(), self.mesh.layout().padded_vertices() as u32, positions);
        Ok(())
    }
}
