//! A crowd that is updated, timed, drawn and read back one step at a time.

mod after;
mod read;

use super::Headless;
use super::draw::PoseDraw;
use super::submit::Readback;
use crate::engine::{AnimatedCrowd, AnyCrowd, Crowd, GpuMesh, PoseReadback, Ticket, Update};
use crate::error::{Error, Result};
use crate::lod::{Camera, Place};
use crate::pack::PackedMesh;
#[cfg(feature = "baselines")]
use crate::plan::UpdatePath;
#[cfg(feature = "internals")]
use crate::plan::hazards::Event;
#[cfg(feature = "internals")]
use crate::plan::schedule::Entry;
use crate::update::animated::{AnimationDesc, Playback};
use crate::update::crowd::CrowdDesc;
use ash::vk;
use std::any::Any;
use std::collections::VecDeque;
use std::time::Instant;

/// What a step took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// What was recorded.
    pub update: Update,
    /// Device time of the update in milliseconds, where the device has timestamps.
    pub gpu_ms: Option<f64>,
    /// Device time of the draws behind it, likewise; `None` where there were none.
    pub draw_ms: Option<f64>,
    /// Round trip from weights to fence, in milliseconds.
    pub cpu_ms: f64,
}

/// A recorded update of a [`HeadlessCrowd`], for [`HeadlessCrowd::submit`] of the same crowd, once or never.
pub struct Recorded {
    cmd: vk::CommandBuffer,
    ticket: Ticket,
}

/// A mesh and a crowd, of either kind, on a [`Headless`] device.
pub struct HeadlessCrowd<'a, C = Crowd> {
    headless: &'a Headless,
    mesh: GpuMesh,
    crowd: C,
    draw: PoseDraw,
    readback: Readback,
    poses: PoseReadback,
    /// Recorded and not yet submitted, in order. The lists of others may have been overwritten.
    waiting: VecDeque<Ticket>,
}

impl<'a> HeadlessCrowd<'a> {
    /// Upload `mesh` and make a crowd.
    ///
    /// # Errors
    /// As [`upload`](crate::MorphEngine::upload) and [`create_crowd`](crate::MorphEngine::create_crowd).
    pub fn new(headless: &'a Headless, mesh: &PackedMesh, desc: &CrowdDesc) -> Result<Self> {
        let engine = &headless.engine;
        let mesh = headless.upload(|cmd| {
            #[cfg(feature = "baselines")]
            if desc.update.path == UpdatePath::Scatter {
                // SAFETY: the submitter hands out a recording buffer of the engine's device; it waits for the device.
                return unsafe { engine.upload_scatter(cmd, mesh) };
            } else if desc.update.path == UpdatePath::Texture {
                // SAFETY: as above.
                return unsafe { engine.upload_texture(cmd, mesh) };
            }
            // SAFETY: as above.
            unsafe { engine.upload(cmd, mesh) }
        })?;
        let crowd = engine.create_crowd(&mesh, desc)?;
        Self::with(headless, mesh, crowd)
    }

    /// Another crowd of the same mesh, which is not uploaded again.
    ///
    /// # Errors
    /// As [`create_crowd`](crate::MorphEngine::create_crowd).
    pub fn another(&self, desc: &CrowdDesc) -> Result<Self> {
        let crowd = self.headless.engine.create_crowd(&self.mesh, desc)?;
        Self::with(self.headless, self.mesh.shared(), crowd)
    }
}

impl<'a> HeadlessCrowd<'a, AnimatedCrowd> {
    /// Upload `mesh` and make a crowd that is animated on the GPU. Each [`step`](Self::step), of no weights, goes to the
    /// time last set.
    ///
    /// # Errors
    /// As [`upload`](crate::MorphEngine::upload) and
    /// [`create_animated_crowd`](crate::MorphEngine::create_animated_crowd).
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
        // SAFETY: as above.
        unsafe { crowd.release_staging() };
        Self::with(headless, mesh, crowd)
    }

    /// See [`AnimatedCrowd::play`].
    pub fn play(&mut self, instance: u32, playback: &Playback) -> Result<()> {
        self.crowd.play(instance, playback)
    }

    /// See [`AnimatedCrowd::set_level`].
    pub fn set_level(&mut self, instance: u32, level: f32) -> Result<()> {
        self.crowd.set_level(instance, level)
    }

    /// See [`AnimatedCrowd::set_camera`].
    pub fn set_camera(&mut self, camera: &Camera) -> Result<()> {
        self.crowd.set_camera(camera)
    }

    /// See [`AnimatedCrowd::cut_camera`].
    pub fn cut_camera(&mut self) {
        self.crowd.cut_camera();
    }

    /// See [`AnimatedCrowd::set_place`].
    pub fn set_place(&mut self, instance: u32, place: &Place) -> Result<()> {
        self.crowd.set_place(instance, place)
    }

    /// See [`AnimatedCrowd::set_time`].
    pub fn set_time(&mut self, seconds: f64) -> Result<()> {
        self.crowd.set_time(seconds)
    }
}

impl<'a, C: AnyCrowd + 'static> HeadlessCrowd<'a, C> {
    fn with(headless: &'a Headless, mesh: GpuMesh, crowd: C) -> Result<Self> {
        let device = &headless.engine.device;
        let pose = crowd.base().view(0, 0, 0);
        let draw = PoseDraw::new(device, pose.format, pose.units, Some(mesh.groups[0].base_pose()))?;
        let readback = Readback::new(device, mesh.layout().base_bytes())?;
        let poses = headless.engine.readback();
        Ok(Self { headless, mesh, crowd, draw, readback, poses, waiting: VecDeque::new() })
    }

    /// The crowd. There is no way to change it but the methods here: a crowd of another device must not take its place.
    pub fn crowd(&self) -> &C {
        &self.crowd
    }

    /// The mesh.
    pub fn mesh(&self) -> &GpuMesh {
        &self.mesh
    }

    /// The crowd, if its weights are set.
    fn weighted(&self) -> Option<&Crowd> {
        let any: &dyn Any = &self.crowd;
        any.downcast_ref()
    }

    /// See [`Crowd::set_weights`]; refused by a crowd that is animated on the GPU.
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        let any: &mut dyn Any = &mut self.crowd;
        let Some(crowd) = any.downcast_mut::<Crowd>() else {
            let what = format!("weights of instance {instance}, which is animated on the GPU");
            return Err(Error::invalid(what, "play a clip, or make the crowd with create_crowd"));
        };
        crowd.set_weights(instance, weights)
    }

    /// See [`Crowd::cut`].
    pub fn cut(&mut self, instance: u32) -> Result<()> {
        self.crowd.base_mut().cut(instance)
    }

    /// See [`Crowd::set_hidden`].
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
        self.crowd.base_mut().set_hidden(instance, hidden)
    }

    /// See [`Crowd::add`].
    pub fn add(&mut self) -> Result<u32> {
        self.crowd.base_mut().add()
    }

    /// See [`Crowd::remove`].
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.crowd.base_mut().remove(instance)
    }

    /// The update of `ticket` and all recorded after it never run: see [`Crowd::discard`]. [`submit`](Self::submit)
    /// refuses them from now on.
    ///
    /// # Errors
    /// A ticket of another crowd, or of an update that is not waiting to be submitted.
    pub fn discard(&mut self, ticket: Ticket) -> Result<()> {
        if let Some(first) = self.waiting.iter().position(|waiting| *waiting == ticket) {
            self.waiting.truncate(first);
        } else if !self.crowd.base().is_discarded(ticket)? {
            return Err(Error::invalid(
                "the update to discard is not waiting: it was submitted, or left behind by a step",
                "discard updates before others are recorded or run",
            ));
        }
        self.crowd.base_mut().discard(ticket)
    }

    /// Ask instance `i` for `weights[i]`, update, wait. What was recorded and not submitted is left behind: it can no
    /// longer be submitted.
    ///
    /// # Errors
    /// Weights that are refused; a device that fails. The update does not run then, and the next makes up for it.
    pub fn step(&mut self, weights: &[&[f32]]) -> Result<Step> {
        Self::step_together(std::slice::from_mut(self), weights, 0)
    }

    /// As [`step`](Self::step), and then draw the pose of every instance `copies` times, all in one submission. Several
    /// crowds are updated together; `weights` and the counts speak of all their instances.
    ///
    /// # Errors
    /// As [`step`](Self::step); no crowd, crowds on several devices, or more weights than instances.
    pub fn step_together(crowds: &mut [Self], weights: &[&[f32]], copies: u32) -> Result<Step> {
        Self::step_all(crowds, weights, copies, |headless, crowds, cmd| {
            // SAFETY: the buffer is recording on the engine's device, on a queue with graphics and compute; it is
            // submitted once, and waited for, before anything else happens.
            unsafe { headless.engine.record_updates(cmd, crowds) }
        })
    }

    /// As [`step_together`](Self::step_together), with what is recorded changed before: lets tests plant faults. Returns
    /// what was recorded, too, as the hazard checker sees it.
    ///
    /// # Errors
    /// As [`step_together`](Self::step_together).
    ///
    /// # Safety
    /// The works stay within slots, instances and coefficients that there are.
    #[cfg(feature = "internals")]
    #[doc(hidden)]
    pub unsafe fn step_tampered(
        crowds: &mut [Self],
        weights: &[&[f32]],
        tamper: impl FnOnce(&mut Vec<Entry>),
    ) -> Result<(Step, Vec<Event>)> {
        let mut events = vec![];
        let step = Self::step_all(crowds, weights, 0, |headless, crowds, cmd| {
            // SAFETY: as in `step_together`; tampering is the caller's to answer for.
            let (updates, recorded) = unsafe { headless.engine.record_tampered(cmd, crowds, tamper) }?;
            events = recorded;
            Ok(updates)
        })?;
        Ok((step, events))
    }

    fn step_all(
        crowds: &mut [Self],
        weights: &[&[f32]],
        copies: u32,
        record: impl FnOnce(&Headless, &mut [&mut dyn AnyCrowd], vk::CommandBuffer) -> Result<Vec<Update>>,
    ) -> Result<Step> {
        let Some(headless) = crowds.first().map(|crowd| crowd.headless) else {
            return Err(Error::invalid("a step of no crowd", "name one or more"));
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
            for (instance, weights) in (0..this.crowd.base().desc().instances).zip(&mut rest) {
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
            let mut all: Vec<_> = crowds.iter_mut().map(|this| &mut this.crowd as &mut dyn AnyCrowd).collect();
            let updates = record(headless, &mut all, cmd)?;
            tickets.extend(updates.iter().map(|update| update.ticket));
            let mut sum = updates[0];
            updates[1..].iter().for_each(|update| sum.stats += update.stats);
            next_part();
            crowds.iter().try_for_each(|crowd| crowd.record_draws(cmd, copies))?;
            Ok(sum)
        });
        if ran.is_err() {
            // Nothing ran, whatever crowds had recorded by then.
            crowds.iter_mut().zip(tickets).try_for_each(|(this, ticket)| this.crowd.base_mut().discard(ticket))?;
        }
        let (update, [gpu_ms, draw_ms]) = ran?;
        let cpu_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(Step { update, gpu_ms, draw_ms: draw_ms.filter(|_| copies > 0), cpu_ms })
    }

    /// Record an update now and leave it to the caller when to run it: see [`submit`](Self::submit). Makes
    /// delayed, dropped and out-of-step submissions possible in tests.
    ///
    /// # Errors
    /// As [`step`](Self::step); more updates that wait than [`CrowdDesc::frames_in_flight`].
    pub fn record(&mut self, weights: &[&[f32]]) -> Result<(Recorded, Update)> {
        let base = self.crowd.base();
        let most = u64::from(base.desc().frames_in_flight);
        // Crowds that are animated on the GPU have no lists to overwrite.
        let has_lists = self.weighted().is_some();
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
            // SAFETY: the buffer is recording on the engine's device, on a queue with graphics and compute; `submit` takes
            // it once, in order, and only while its lists are what they were.
            let update = unsafe { engine.record_update(cmd, crowd) }?;
            ticket = Some(update.ticket);
            Ok(update)
        });
        if let (Err(_), Some(ticket)) = (&recorded, ticket) {
            self.crowd.base_mut().discard(ticket)?;
        }
        let update = recorded?;
        self.waiting.push_back(update.ticket);
        Ok((Recorded { cmd, ticket: update.ticket }, update))
    }

    /// Run recorded updates of this crowd, the oldest that wait, in the order in which they were recorded, and wait.
    ///
    /// # Errors
    /// Updates of another crowd, out of order, discarded, or left behind by a [`step`](Self::step): nothing runs then. A
    /// device that fails.
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
            _ => drop(self.waiting.drain(..count)),
        }
        ran
    }

    /// Draw the pose of every instance `copies` times, discarding all primitives; device time in milliseconds. On a
    /// direct path these are the draws that evaluate the pose.
    ///
    /// # Errors
    /// No update recorded yet; a device that fails.
    pub fn draw(&self, copies: u32) -> Result<Option<f64>> {
        let ((), [ms, _]) = self.headless.submitter.run_timed(|cmd, _| self.record_draws(cmd, copies))?;
        Ok(ms)
    }

    fn record_draws(&self, cmd: vk::CommandBuffer, copies: u32) -> Result<()> {
        if copies == 0 {
            return Ok(());
        }
        #[cfg(feature = "baselines")]
        if let Some(crowd) = self.direct() {
            let engine = &self.headless.engine;
            // SAFETY: as in `step_together`.
            return (0..copies).try_for_each(|_| unsafe { engine.record_draws(cmd, crowd) });
        }
        let (base, mut poses) = (self.crowd.base(), vec![]);
        if base.desc().poses.is_some() {
            let text = "draws of poses in vertices of the host's own, of a layout that is the host's";
            return Err(Error::invalid(text, "draw them as the host does"));
        }
        for instance in base.shown() {
            let pose = base.group_pose(instance, 0)?;
            poses.extend(std::iter::repeat_n((pose.buffer, pose.offset), copies as usize));
        }
        self.draw.record(cmd, poses.into_iter(), self.mesh.layout().padded_vertices() as u32);
        Ok(())
    }
}
