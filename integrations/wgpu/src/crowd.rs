//! Crowds: instances of a mesh with weights and poses.

use super::submission::{Fate, Submission, first_astray};
use super::{import, invalid, lock};
use deltamorph::ash::vk;
use deltamorph::{CrowdDesc, PackedLayout, PoseBuffer, PoseView, Result, Semantic, StreamView, Ticket};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Instances of one mesh, each with its own weights and poses: see [`deltamorph::Crowd`].
pub struct Crowd {
    /// The buffers of the poses.
    buffers: Vec<(vk::Buffer, wgpu::Buffer)>,
    /// Updates that have not finished yet, the oldest first.
    pending: VecDeque<(Ticket, Arc<Submission>)>,
    shared: Arc<Mutex<deltamorph::Crowd>>,
    desc: CrowdDesc,
    device: wgpu::Device,
}

/// A pose in a vertex, storage and copy-source buffer, laid out as described by `view`.
#[derive(Clone, Copy, Debug)]
pub struct Pose<'a> {
    /// The buffer of all poses of the crowd.
    pub buffer: &'a wgpu::Buffer,
    /// Offset, bytes, format, and what its numbers mean.
    pub view: PoseView,
}

/// A stream of a pose in a buffer.
#[derive(Clone, Copy, Debug)]
pub struct Stream<'a> {
    /// The buffer with the stream: a vertex, storage and copy-source buffer.
    pub buffer: &'a wgpu::Buffer,
    /// Offset of its first component, stride, format, and what its numbers mean.
    pub view: StreamView,
}

impl<'a> Pose<'a> {
    /// Returns the range of all vertices, for `set_vertex_buffer`.
    pub fn slice(&self) -> wgpu::BufferSlice<'a> {
        self.buffer.slice(self.view.offset..self.view.offset + self.view.size)
    }

    /// Returns a binding of all vertices, as read-only storage. Offsets of poses are multiples of 256.
    pub fn binding(&self) -> wgpu::BindingResource<'a> {
        let size = std::num::NonZero::new(self.view.size);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: self.buffer, offset: self.view.offset, size })
    }
}

impl Crowd {
    pub(crate) fn new<'a>(
        crowd: deltamorph::Crowd,
        layouts: impl Iterator<Item = &'a PackedLayout>,
        device: &wgpu::Device,
    ) -> Result<Self> {
        let desc = *crowd.desc();
        let streams = layouts.filter_map(|layout| layout.streams.first());
        let places: Vec<_> = streams.map(|stream| crowd.pose_buffer(stream.semantic)).collect::<Result<_>>()?;
        let shared = Arc::new(Mutex::new(crowd));
        let usage = wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let imported = |place: PoseBuffer| {
            let (raw, (begin, size)) = (place.first.buffer, place.poses);
            // SAFETY: the buffer is the crowd's, and lives as long; its usages are those that `StreamView::buffer`
            // names, and it has room for all poses. It is filled before anything else is submitted.
            (raw, unsafe { import(device, raw, begin + size, usage, shared.clone()) })
        };
        let buffers = places.into_iter().map(imported).collect();
        Ok(Self { buffers, pending: VecDeque::new(), shared, desc, device: device.clone() })
    }

    /// Returns the description that the crowd was made from.
    pub fn desc(&self) -> &CrowdDesc {
        &self.desc
    }

    /// Requests these weights; the next update applies them. See [`deltamorph::Crowd::set_weights`].
    ///
    /// # Errors
    /// The instance does not exist, or the weights are not valid: those of [`deltamorph::Crowd::set_weights`].
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        lock(&self.shared).set_weights(instance, weights)
    }

    /// Marks the next pose as one without predecessor: see [`deltamorph::Crowd::reset_history`].
    ///
    /// # Errors
    /// The instance does not exist: those of [`deltamorph::Crowd::reset_history`].
    pub fn reset_history(&mut self, instance: u32) -> Result<()> {
        lock(&self.shared).reset_history(instance)
    }

    /// Hides an instance, or shows it again: see [`deltamorph::Crowd::set_hidden`].
    ///
    /// # Errors
    /// The instance does not exist: those of [`deltamorph::Crowd::set_hidden`].
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
        lock(&self.shared).set_hidden(instance, hidden)
    }

    /// Adds an instance and returns its number: see [`deltamorph::Crowd::add`].
    ///
    /// # Errors
    /// All instances are in use: those of [`deltamorph::Crowd::add`].
    pub fn add(&mut self) -> Result<u32> {
        lock(&self.shared).add()
    }

    /// Removes an instance from the crowd: see [`deltamorph::Crowd::remove`].
    ///
    /// # Errors
    /// The instance does not exist: those of [`deltamorph::Crowd::remove`].
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        lock(&self.shared).remove(instance)
    }

    /// Returns the pose of `instance` after the updates made so far.
    ///
    /// # Errors
    /// The instance does not exist or has no pose: those of [`deltamorph::Crowd::pose`].
    pub fn pose(&self, instance: u32) -> Result<Pose<'_>> {
        let view = lock(&self.shared).pose(instance)?;
        Ok(Pose { buffer: self.buffer(view.buffer)?, view })
    }

    /// Returns the pose of `instance` before its last update, for motion vectors: see
    /// [`deltamorph::Crowd::previous_pose`].
    ///
    /// # Errors
    /// The instance does not exist: those of [`deltamorph::Crowd::previous_pose`].
    pub fn previous_pose(&self, instance: u32) -> Result<Option<Pose<'_>>> {
        let view = lock(&self.shared).previous_pose(instance)?;
        view.map(|view| Ok(Pose { buffer: self.buffer(view.buffer)?, view })).transpose()
    }

    /// Returns a stream of the pose of `instance`, such as its tangents: see [`deltamorph::Crowd::stream`].
    ///
    /// # Errors
    /// The instance or the stream does not exist: those of [`deltamorph::Crowd::stream`].
    pub fn stream(&self, instance: u32, semantic: Semantic) -> Result<Stream<'_>> {
        let view = lock(&self.shared).stream(instance, semantic)?;
        Ok(Stream { buffer: self.buffer(view.buffer)?, view })
    }

    /// Returns a stream of the previous pose: see [`deltamorph::Crowd::previous_stream`].
    ///
    /// # Errors
    /// The instance or the stream does not exist: those of [`deltamorph::Crowd::previous_stream`].
    pub fn previous_stream(&self, instance: u32, semantic: Semantic) -> Result<Option<Stream<'_>>> {
        let view = lock(&self.shared).previous_stream(instance, semantic)?;
        view.map(|view| Ok(Stream { buffer: self.buffer(view.buffer)?, view })).transpose()
    }

    fn buffer(&self, raw: vk::Buffer) -> Result<&wgpu::Buffer> {
        let found = self.buffers.iter().find(|(handle, _)| *handle == raw);
        found
            .map(|(_, buffer)| buffer)
            .ok_or_else(|| invalid("a pose is in a buffer that the crowd does not have", "this is a bug"))
    }

    /// Iterates over the buffers of its poses.
    pub(crate) fn raw_buffers(&self) -> impl Iterator<Item = vk::Buffer> {
        self.buffers.iter().map(|(raw, _)| *raw)
    }

    pub(crate) fn shared(&self) -> &Arc<Mutex<deltamorph::Crowd>> {
        &self.shared
    }

    /// Notes that an update was recorded into the command buffer of a submission.
    pub(crate) fn updated(&mut self, ticket: Ticket, submission: Arc<Submission>) {
        self.pending.push_back((ticket, submission));
    }

    /// Waits until another update may be recorded, and discards updates that were lost.
    pub(crate) fn make_room(&mut self) -> Result<()> {
        /// Time that a queue must be idle before an unfinished update counts as not submitted: another thread may have
        /// fetched the callbacks, and not called them yet.
        const IDLE: Duration = Duration::from_millis(100);
        /// Longest time that the GPU may take for the unfinished updates.
        const STUCK: Duration = Duration::from_secs(60);
        let begin = Instant::now();
        let mut busy = begin;
        while !self.settle()? {
            let idle = self.device.poll(wgpu::PollType::Poll).is_ok_and(|status| status.is_queue_empty());
            let now = Instant::now();
            if !idle {
                busy = now;
            }
            let text = |why| format!("{} updates of a crowd are unfinished, and {why}", self.pending.len());
            if now - busy > IDLE {
                let text = text("the queue is empty: one was not submitted");
                return Err(invalid(text, "submit or drop its command buffer first"));
            }
            if now - begin > STUCK {
                return Err(invalid(text("have been so for a minute"), "submit all command buffers, or drop them"));
            }
            sleep(Duration::from_micros(50));
        }
        Ok(())
    }

    /// Processes the results of earlier updates. Returns whether another may be recorded.
    fn settle(&mut self) -> Result<bool> {
        // The newest first: command buffers submitted in order end in order, so none ends before one that is checked
        // later.
        let mut fates: Vec<Fate> = self.pending.iter().rev().map(|(_, submission)| submission.fate()).collect();
        fates.reverse();
        if let Some(astray) = first_astray(&fates) {
            // The lists of discarded updates are overwritten, so none of these updates may still be running.
            if fates[astray..].contains(&Fate::Waiting) {
                return Ok(false);
            }
            lock(&self.shared).discard(self.pending[astray].0)?;
            self.pending.truncate(astray);
            fates.truncate(astray);
        }
        let ran = fates.iter().take_while(|fate| matches!(fate, Fate::Ran(_))).count();
        self.pending.drain(..ran);
        Ok(self.pending.len() < self.desc.frames_in_flight as usize)
    }
}
