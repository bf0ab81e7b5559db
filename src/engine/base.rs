//! What every crowd has: poses, instances, slots, tickets, and a technique that updates them.

use super::poses;
use super::upload::GpuMesh;
use super::views::{self, PoseBuffer, PoseView};
use crate::after::{After, Place};
use crate::asset::streams::{Semantic, StreamPlace};
use crate::error::{Error, Result};
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::pipelines::Kernels;
use crate::pack::PackedLayout;
use crate::pack::blocks::PoseGrid;
use crate::plan::UpdateStats;
use crate::plan::instances::Instances;
use crate::plan::schedule::Schedule;
use crate::plan::steps::{Owner, Resource, Steps, Use, Work};
use crate::update::crowd::CrowdDesc;
use crate::update::technique::{Context, PoseDraws, PoseGroup, Technique, UpdateId};
use ash::vk;
use std::any::Any;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Ranges of discarded updates that a crowd remembers.
const DISCARDED_RANGES: usize = 64;

/// Proof of a recorded update, to discard it with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "an update that never runs has to be discarded with its ticket"]
pub struct Ticket {
    /// Of which crowd.
    crowd: u64,
    id: UpdateId,
}

/// What an update recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Update {
    /// For [`Crowd::discard`](super::Crowd::discard), should the command buffer never run.
    pub ticket: Ticket,
    /// Coefficients, passes and bytes; all zero, but for the bound, when nothing changed and nothing was recorded. On
    /// direct paths they speak of the draw, and are the same when nothing changed.
    pub stats: UpdateStats,
}

/// The part that all kinds of crowds share.
pub struct CrowdBase {
    // Before the buffers that its descriptor sets name.
    pub(crate) technique: Box<dyn Technique>,
    /// What follows the steps of the technique.
    pub(crate) after: After,
    /// At least one.
    groups: Vec<PoseGroup>,
    pub(super) instances: Instances,
    pub(super) steps: Steps,
    /// What the steps used of the update that wrote poses last.
    wrote: Vec<&'static [Use]>,
    /// Scratch space of recording.
    pub(super) schedule: Schedule,
    /// The update planned last.
    last: Option<UpdateId>,
    pub(crate) desc: CrowdDesc,
    device: Arc<Device>,
    _pose_buffers: Vec<Buffer>,
    /// Its number, which no other crowd has.
    pub(super) crowd: u64,
    /// Updates planned.
    pub(super) updates: u64,
    /// Updates that recorded something, less discarded ones: the rings of lists turn with them.
    pub(super) recorded: u64,
    /// Updates that were discarded, ascending: a ticket is good for one discard.
    pub(super) discarded: Vec<RangeInclusive<u64>>,
}

/// A crowd on the device, whose weights the host sets ([`Crowd`](super::Crowd)) or which plays clips
/// ([`AnimatedCrowd`](super::AnimatedCrowd)). What takes crowds of both kinds takes this: as `&mut dyn AnyCrowd` in a list for
/// [`MorphEngine::record_updates`](super::MorphEngine::record_updates), and steps after the pose, such as
/// [`MorphEngine::set_skin_target`](super::MorphEngine::set_skin_target). No other type can implement it.
pub trait AnyCrowd: sealed::Sealed {}

pub(crate) mod sealed {
    /// Keeps other types out.
    pub trait Sealed {
        fn base(&self) -> &super::CrowdBase;
        fn base_mut(&mut self) -> &mut super::CrowdBase;
    }
}

impl CrowdBase {
    /// A crowd of which the weights of `targets` targets are set, updated by what `make` makes.
    pub(super) fn new(
        device: &Arc<Device>,
        kernels: &Kernels,
        mesh: &GpuMesh,
        desc: &CrowdDesc,
        targets: usize,
        make: impl FnOnce(Context<'_>) -> Result<Box<dyn Technique>>,
    ) -> Result<Self> {
        static CROWDS: AtomicU64 = AtomicU64::new(0);
        let (instances, slots, frames) = (desc.instances, desc.update.slots, desc.frames_in_flight);
        if instances == 0 || frames == 0 {
            let text = format!("a crowd of {instances} instances with {frames} frames in flight");
            return Err(Error::invalid(text, "use 1 or more of both"));
        }
        let (groups, buffers) = poses::make(device, mesh, desc)?;
        let (mesh, poses) = (&groups[0].mesh, groups[0].poses);
        Ok(Self {
            technique: make(Context { device, kernels, mesh, desc, poses, all: &groups })?,
            after: After::default(),
            groups,
            instances: Instances::new(instances as usize, targets, slots, frames),
            steps: Steps::new(desc.consumers_on_queue(device)),
            wrote: vec![],
            schedule: Schedule::default(),
            last: None,
            desc: *desc,
            device: device.clone(),
            _pose_buffers: buffers,
            crowd: CROWDS.fetch_add(1, Ordering::Relaxed),
            updates: 0,
            recorded: 0,
            discarded: vec![],
        })
    }

    /// Refuse to record a crowd that was made on another device.
    pub(crate) fn check_device(&self, device: &Arc<Device>) -> Result<()> {
        match Arc::ptr_eq(&self.device, device) {
            true => Ok(()),
            false => Err(Error::invalid(
                "the crowd belongs to another MorphEngine",
                "record it with the engine that created it",
            )),
        }
    }

    /// The technique, if it is a `T`.
    pub(crate) fn technique<T: Technique>(&self) -> Option<&T> {
        let any: &dyn Any = &*self.technique;
        any.downcast_ref()
    }

    pub(super) fn technique_mut<T: Technique>(&mut self) -> Option<&mut T> {
        let any: &mut dyn Any = &mut *self.technique;
        any.downcast_mut()
    }

    pub fn cut(&mut self, instance: u32) -> Result<()> {
        self.instances.cut(instance)?;
        self.technique.cut(instance);
        self.after.cut(instance);
        Ok(())
    }

    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
        if self.instances.set_hidden(instance, hidden)? {
            self.technique.set_hidden(instance, hidden);
            self.after.renew(instance);
        }
        Ok(())
    }

    pub fn add(&mut self) -> Result<u32> {
        let instance = self.instances.add()?;
        self.technique.add(instance);
        Ok(instance)
    }

    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.instances.remove(instance)?;
        self.technique.set_hidden(instance, true);
        self.after.remove(instance);
        Ok(())
    }

    pub fn discard(&mut self, ticket: Ticket) -> Result<()> {
        if self.is_discarded(ticket)? {
            return Ok(());
        }
        // Later ranges are part of this one, the last earlier one may end where it begins, and only so many are
        // kept: a ticket between the two oldest is taken for one that was discarded before.
        let update = ticket.id.update;
        self.discarded.retain(|updates| *updates.start() < update);
        let mut first = update;
        if let Some(before) = self.discarded.pop_if(|updates| *updates.end() + 1 == update) {
            first = *before.start();
        }
        if self.discarded.len() == DISCARDED_RANGES {
            let oldest = self.discarded.remove(0);
            self.discarded[0] = *oldest.start()..=*self.discarded[0].end();
        }
        self.discarded.push(first..=self.updates);
        self.instances.discard_from(update);
        self.technique.discard_from(ticket.id);
        self.after.discard_from(update);
        self.recorded = self.recorded.min(ticket.id.recorded);
        Ok(())
    }

    /// Whether the update of a ticket was discarded. A ticket of another crowd is refused.
    pub fn is_discarded(&self, ticket: Ticket) -> Result<bool> {
        if ticket.crowd != self.crowd {
            return Err(Error::invalid("the ticket is of another crowd", "discard it in the crowd that was updated"));
        }
        Ok(self.discarded.iter().any(|updates| updates.contains(&ticket.id.update)))
    }

    /// Updates that recorded something from that of `ticket` on.
    pub fn recorded_since(&self, ticket: Ticket) -> u64 {
        self.recorded.saturating_sub(ticket.id.recorded)
    }

    /// The update planned last, all of it or in part, will never run.
    pub(super) fn discard_last(&mut self) {
        if let Some(id) = self.last {
            // The ticket is of this crowd: there is no error.
            let _ = self.discard(Ticket { crowd: self.crowd, id });
        }
    }

    pub fn shown(&self) -> impl Iterator<Item = u32> {
        self.instances.requested().zip(0..).filter_map(|(requested, i)| requested.map(|_| i))
    }

    /// See [`Crowd::changed`](super::Crowd::changed).
    #[cfg(feature = "internals")]
    pub(super) fn changed(&self, instance: u32) -> Vec<std::ops::Range<u32>> {
        let mut changed = vec![];
        if let (Some(id), Ok(_)) = (self.last, self.instances.check(instance)) {
            self.technique.changed(&self.instances, id, instance, &mut changed);
        }
        changed
    }

    /// See [`Crowd::begin_at`](super::Crowd::begin_at).
    #[cfg(feature = "internals")]
    pub(super) fn begin_at(&mut self, updates: u64) {
        (self.updates, self.recorded) = (updates, updates);
        self.technique.begin_at(updates);
    }

    /// The groups of the mesh, and the poses in them.
    pub(crate) fn groups(&self) -> &[PoseGroup] {
        &self.groups
    }

    /// What the steps of the update that wrote poses last did to them.
    pub(super) fn writes_of_poses(&self) -> impl Iterator<Item = &'static Use> {
        let uses = self.wrote.iter().flat_map(|uses| uses.iter());
        uses.filter(|used| used.memory == Resource::Poses && used.access.writes())
    }

    pub(super) fn layout(&self) -> &PackedLayout {
        &self.groups[0].mesh.layout
    }

    /// The grid of the first group; that of others may have other units, and the same weights.
    pub(super) fn grid(&self) -> Option<PoseGrid> {
        self.groups[0].poses.grid
    }

    pub fn group_pose(&self, instance: u32, group: usize) -> Result<PoseView> {
        let (slot, _) = self.slots_of(instance)?;
        self.check_has_poses()?;
        if group >= self.groups.len() {
            let text = format!("group {group} of mesh '{}', which has {}", self.layout().name, self.groups.len());
            return Err(Error::invalid(text, "count groups from 0"));
        }
        Ok(self.view(instance, slot, group))
    }

    /// The draws that evaluate poses, on paths that have no pose buffers.
    pub fn draws(&self, group: usize) -> Option<&dyn PoseDraws> {
        self.technique.draws(group)
    }

    fn check_has_poses(&self) -> Result<()> {
        if self.technique.draws(0).is_none() {
            return Ok(());
        }
        Err(Error::invalid(
            format!("the path '{}' has no pose buffers", self.desc.update.path.name()),
            "its draws evaluate poses: use a path with pose buffers, such as 'compute'",
        ))
    }

    pub fn previous_group_pose(&self, instance: u32, group: usize) -> Result<Option<PoseView>> {
        let (_, previous) = self.slots_of(instance)?;
        Ok(previous.filter(|_| self.technique.draws(0).is_none()).map(|slot| self.view(instance, slot, group)))
    }

    /// The group that has a stream, and where.
    pub(super) fn place(&self, semantic: Semantic) -> Result<(usize, StreamPlace)> {
        views::place(self.groups.iter().map(|group| &group.mesh.layout), semantic)
    }

    /// Slots of the pose and of the previous pose.
    pub fn slots_of(&self, instance: u32) -> Result<(u32, Option<u32>)> {
        let place = self.instances.check(instance)?;
        let none = || Error::invalid(format!("instance {instance} has no pose yet"), "record an update first");
        self.technique.slots_of(&self.instances, place).ok_or_else(none)
    }

    pub fn view(&self, instance: u32, slot: u32, group: usize) -> PoseView {
        PoseView::new(&self.groups[group].poses, instance, slot)
    }

    /// See [`Crowd::pose_buffer`](super::Crowd::pose_buffer).
    pub(super) fn pose_buffer(&self, semantic: Semantic) -> Result<PoseBuffer> {
        self.check_has_poses()?;
        let (group, place) = self.place(semantic)?;
        PoseBuffer::new(&self.groups[group].poses, place)
    }

    /// Change what follows the pose of an instance, by what `set` does.
    pub(super) fn set_after(
        &mut self,
        kernels: &Kernels,
        instance: u32,
        set: impl FnOnce(&mut After, &Place<'_>) -> Result<()>,
    ) -> Result<()> {
        self.instances.check(instance)?;
        self.check_has_poses()?;
        let (group, frames) = (&self.groups[0], self.desc.frames_in_flight);
        set(&mut self.after, &Place { device: &self.device, kernels, group, frames, instance })?;
        self.steps.read_besides(self.after.outputs());
        Ok(())
    }

    /// Record a work of the update planned last.
    ///
    /// # Safety
    /// As [`Technique::record`].
    pub(super) unsafe fn record(&self, cmd: vk::CommandBuffer, work: &Work) {
        let frame = self.last.map_or(0, |id| id.frame);
        match work.owner {
            // SAFETY: the caller's obligations.
            Owner::Technique => unsafe { self.technique.record(cmd, frame, work) },
            // SAFETY: as above.
            Owner::Step(kind) => unsafe { self.after.record(cmd, frame, kind, work) },
        }
    }

    /// What works of a step read and write, for the hazard checker.
    #[cfg(feature = "internals")]
    pub(super) fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        match works[0].owner {
            Owner::Technique => self.technique.accesses(works),
            Owner::Step(kind) => self.after.accesses(kind, works),
        }
    }

    /// Plan an update, and take it as done. Where this fails, [`discard_last`](Self::discard_last) has to follow.
    pub(super) fn plan(&mut self) -> Result<Update> {
        self.updates += 1;
        self.steps.clear();
        // Lists lie where the update lies that is `frames_in_flight` older.
        let frame = (self.recorded + 1) % u64::from(self.desc.frames_in_flight);
        let id = UpdateId { update: self.updates, recorded: self.recorded, frame };
        self.last = Some(id);
        let stats = self.technique.plan(&mut self.instances, id, &mut self.steps)?;
        if !self.steps.is_empty() {
            self.wrote.clear();
            self.wrote.extend(self.steps.uses());
        }
        self.after.plan(&*self.technique, &self.instances, id, &self.wrote, &mut self.steps)?;
        self.recorded += u64::from(!self.steps.is_empty());
        Ok(Update { ticket: Ticket { crowd: self.crowd, id }, stats })
    }
}
