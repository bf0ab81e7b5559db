//! Crowds on a device: poses, slots and tickets, independent of the technique.

use super::poses;
use super::upload::GpuMesh;
use super::views::PoseView;
use crate::after::After;
use crate::crowd::crowd_methods;
use crate::error::{Error, Result, ensure};
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::pipelines::Kernels;
use crate::pack::PackedLayout;
use crate::pack::blocks::PoseGrid;
use crate::plan::UpdateStats;
use crate::plan::instances::{InstanceState, Instances, OutputChange, check_weight, check_weights};
use crate::plan::schedule::Schedule;
use crate::plan::steps::{Owner, Resource, Steps, Use, Work};
use crate::update::crowd::CrowdDesc;
use crate::update::technique::{Context, PoseDraws, PoseGroup, Technique, UpdateId};
use ash::vk;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Most ranges of discarded updates that a crowd remembers.
const DISCARDED_RANGES: usize = 64;

/// Identifies a recorded update, to discard it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "an update that never runs has to be discarded with its ticket"]
pub struct Ticket {
    crowd: u64,
    id: UpdateId,
}

/// A recorded update.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Update {
    /// For [`Crowd::discard`], if the command buffer will never run.
    pub ticket: Ticket,
    /// Statistics; all zero except the bound if nothing changed and nothing was recorded. Direct paths: of the draws,
    /// even if nothing changed.
    pub stats: UpdateStats,
    /// Timestamps that it writes, into the first queries of [`Crowd::set_queries`]: one more than
    /// [steps](Crowd::step_names), 0 if nothing was recorded or no queries were set.
    pub timestamps: u32,
}

/// Instances of one mesh on a device, numbered from 0. All instances of a new crowd exist and are shown.
///
/// The host sets weights ([`set_weights`](Self::set_weights)), or, in a crowd that
/// [`create_animated_crowd`](super::MorphEngine::create_animated_crowd) made, plays clips ([`play`](Self::play)): the
/// GPU then samples, plans and applies weights. [`MorphEngine`](crate::MorphEngine) lists the caller's
/// responsibilities.
pub struct Crowd {
    pub(super) instances: Instances,
    /// Updates planned so far.
    pub(super) updates: u64,
    pub(super) after: After,
    /// At least one.
    pub(super) groups: Vec<PoseGroup>,
    pub(super) steps: Steps,
    /// Uses of the last update that wrote poses.
    wrote: Vec<&'static [Use]>,
    pub(super) schedule: Schedule,
    last: Option<UpdateId>,
    pub(super) desc: CrowdDesc,
    device: Arc<Device>,
    /// Unique number of the crowd.
    number: u64,
    /// Updates that recorded something and were not discarded: index of the rings of lists.
    pub(super) recorded: u64,
    /// Discarded updates, ascending: a ticket can be discarded once.
    discarded: Vec<RangeInclusive<u64>>,
    /// The host's queries that are left for the next update: pool, first and number.
    pub(super) queries: Option<(vk::QueryPool, u32, u32)>,
    // Dropped before the buffers that its descriptor sets reference.
    pub(super) technique: Box<dyn Technique>,
    _poses: Vec<Buffer>,
}

impl Crowd {
    crowd_methods!();

    /// Creates a crowd with requested weights for `targets` targets; `make` makes the technique.
    pub(super) fn on_device(
        device: &Arc<Device>,
        kernels: &Kernels,
        mesh: &GpuMesh,
        desc: &CrowdDesc,
        targets: usize,
        make: impl FnOnce(Context<'_>) -> Result<Box<dyn Technique>>,
    ) -> Result<Self> {
        static CROWDS: AtomicU64 = AtomicU64::new(0);
        let instances = desc.instances;
        let slots = desc.update.slots;
        let frames = desc.frames_in_flight;
        let text = format!("a crowd of {instances} instances with {frames} frames in flight");
        ensure!(instances > 0 && frames > 0, text, "use 1 or more of both");
        let (groups, buffers) = poses::make(device, mesh, desc)?;
        let mesh = &groups[0].mesh;
        let poses = groups[0].poses;
        let technique = make(Context { device, kernels, mesh, desc, poses, all: &groups })?;
        Ok(Self {
            instances: Instances::new(instances as usize, targets, slots, frames),
            updates: 0,
            after: After::default(),
            groups,
            steps: Steps::new(desc.consumers_on_queue(device)),
            wrote: vec![],
            schedule: Schedule::default(),
            last: None,
            desc: *desc,
            device: device.clone(),
            number: CROWDS.fetch_add(1, Ordering::Relaxed),
            recorded: 0,
            discarded: vec![],
            queries: None,
            technique,
            _poses: buffers,
        })
    }

    /// The mesh's layout of positions and normals: names, steps and sizes.
    pub fn layout(&self) -> &PackedLayout {
        &self.groups[0].mesh.layout
    }

    fn grid(&self) -> Option<PoseGrid> {
        self.groups[0].poses.grid
    }

    pub(super) fn parts(&mut self) -> (&mut Instances, &mut dyn InstanceState) {
        (&mut self.instances, self.technique.state())
    }

    fn change_outputs(&mut self, instance: u32, change: OutputChange) {
        self.after.change(instance, change);
    }

    /// The technique that plans and records updates.
    #[doc(hidden)]
    pub fn technique(&self) -> &dyn Technique {
        &*self.technique
    }

    /// Checks that the crowd was created on this device.
    pub(crate) fn check_device(&self, device: &Arc<Device>) -> Result<()> {
        let is_its_own = Arc::ptr_eq(&self.device, device);
        ensure!(is_its_own, "the crowd belongs to another MorphEngine", "record it with the engine that created it");
        Ok(())
    }

    /// Discards the update of `ticket` and all later ones, which will never run since their command buffers were reset
    /// or dropped. What they would have written is then unknown, and the next update writes it. Discarding an update
    /// again changes nothing.
    ///
    /// That none of them will run is an obligation of the caller in the `# Safety` section of
    /// [`record_update`](super::MorphEngine::record_update): the next update reuses the memory of their lists.
    ///
    /// # Errors
    /// A ticket of another crowd.
    pub fn discard(&mut self, ticket: Ticket) -> Result<()> {
        if self.is_discarded(ticket)? {
            return Ok(());
        }
        // Later ranges are merged into this one, as is the last earlier one if adjacent. Only a limited number is kept:
        // a ticket between the two oldest counts as discarded.
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

    /// Whether the update of a ticket was discarded; an error for a ticket of another crowd.
    #[doc(hidden)]
    pub fn is_discarded(&self, ticket: Ticket) -> Result<bool> {
        let is_its_own = ticket.crowd == self.number;
        ensure!(is_its_own, "the ticket is of another crowd", "discard it in the crowd that was updated");
        Ok(self.discarded.iter().any(|updates| updates.contains(&ticket.id.update)))
    }

    /// Number of updates that recorded something since that of `ticket`, inclusive.
    #[doc(hidden)]
    pub fn recorded_since(&self, ticket: Ticket) -> u64 {
        self.recorded.saturating_sub(ticket.id.recorded)
    }

    /// Discards the update planned last, completely or partly.
    pub(super) fn discard_last(&mut self) {
        if let Some(id) = self.last {
            // Cannot fail: the ticket is of this crowd.
            let _ = self.discard(Ticket { crowd: self.number, id });
        }
    }

    /// Writes of poses by the last update that wrote any.
    pub(super) fn writes_of_poses(&self) -> impl Iterator<Item = &'static Use> {
        let uses = self.wrote.iter().flat_map(|uses| uses.iter());
        uses.filter(|used| used.memory == Resource::Poses && used.access.writes())
    }

    /// The pose of an instance in a group of the mesh.
    #[doc(hidden)]
    pub fn group_pose(&self, instance: u32, group: usize) -> Result<PoseView> {
        let (slot, _) = self.slots_of(instance)?;
        self.check_has_poses()?;
        let count = self.groups.len();
        let what = || format!("group {group} of mesh '{}', which has {count}", self.layout().name);
        ensure!(group < count, what(), "count groups from 0");
        Ok(self.view(instance, slot, group))
    }

    /// The draws that evaluate poses of a group, on paths without pose buffers.
    #[doc(hidden)]
    pub fn draws(&self, group: usize) -> Option<&dyn PoseDraws> {
        self.technique().draws(group)
    }

    pub(super) fn check_has_poses(&self) -> Result<()> {
        let what = || format!("the path '{}' has no pose buffers", self.desc.update.path.name());
        let remedy = "its draws evaluate poses: use a path with pose buffers, such as 'compute'";
        ensure!(self.technique().draws(0).is_none(), what(), remedy);
        Ok(())
    }

    /// The previous pose of an instance in a group of the mesh.
    #[doc(hidden)]
    pub fn previous_group_pose(&self, instance: u32, group: usize) -> Result<Option<PoseView>> {
        let (_, previous) = self.slots_of(instance)?;
        Ok(previous.filter(|_| self.technique().draws(0).is_none()).map(|slot| self.view(instance, slot, group)))
    }

    /// Slots of an instance's pose and previous pose.
    #[doc(hidden)]
    pub fn slots_of(&self, instance: u32) -> Result<(u32, Option<u32>)> {
        let place = self.instances.check(instance)?;
        let none = || Error::invalid(format!("instance {instance} has no pose yet"), "record an update first");
        self.technique().slots_of(&self.instances, place).ok_or_else(none)
    }

    /// The pose in a slot of an instance, in a group of the mesh.
    #[doc(hidden)]
    pub fn view(&self, instance: u32, slot: u32, group: usize) -> PoseView {
        PoseView::new(&self.groups[group].poses, instance, slot)
    }

    /// Names of the steps of the update recorded last, in order: of its path (`blocks`, `compute`, …; crowds animated
    /// on the GPU have a name for each step), then of [post-morph passes](crate::after). None if nothing was
    /// recorded. Labels ([`DeviceDesc::debug_names`](crate::DeviceDesc::debug_names)) have these names.
    pub fn step_names(&self) -> impl Iterator<Item = &'static str> {
        self.steps.firsts().map(|work| self.step_name(work))
    }

    /// Makes the next recording call write timestamps of this crowd's update into the host's queries: query `first`
    /// when the commands before the update have finished, the following ones after each of its
    /// [steps](Self::step_names), at BOTTOM_OF_PIPE. [`Update::timestamps`] says how many. Steps of crowds that are
    /// recorded by one call may run at the same time. No barriers are added: drivers may begin a step before the one
    /// that was timed has ended, if it does not depend on it.
    ///
    /// The call fails before anything is recorded if `count` is too small. It uses up the setting either way.
    ///
    /// # Safety
    /// - Queries `first` to `first + count` are of a pool of timestamps on the engine's device, which lives until the
    ///   device has finished, are reset before the update runs, and are in no other use until then.
    /// - The queue of the update has timestamps (`timestampValidBits` of its family is not 0).
    pub unsafe fn set_queries(&mut self, pool: vk::QueryPool, first: u32, count: u32) {
        self.queries = Some((pool, first, count));
    }

    /// Writes a timestamp into the next query, if there are any.
    ///
    /// # Safety
    /// See [`set_queries`](Self::set_queries); `cmd` is in the recording state on the crowd's device.
    pub(super) unsafe fn write_timestamp(&mut self, cmd: vk::CommandBuffer) {
        let Self { queries: Some((pool, next, left)), device, .. } = self else { return };
        // Tests record more works than were planned.
        if *left > 0 {
            // SAFETY: the caller's obligations.
            unsafe { device.raw.cmd_write_timestamp(cmd, vk::PipelineStageFlags::BOTTOM_OF_PIPE, *pool, *next) };
            (*next, *left) = (*next + 1, *left - 1);
        }
    }

    /// Timestamps of the update planned last, for which there have to be queries.
    fn timestamps(&mut self) -> Result<u32> {
        let written = match self.steps.firsts().count() as u32 {
            0 => 0,
            steps => steps + 1,
        };
        let Some((.., count)) = &mut self.queries else { return Ok(0) };
        let what = || format!("{count} queries for the {written} timestamps of an update");
        ensure!(*count >= written, what(), "hand in one more than the update has steps");
        *count = written;
        Ok(written)
    }

    pub(super) fn step_name(&self, work: &Work) -> &'static str {
        match work.owner {
            Owner::Technique => self.technique().step_name(work).unwrap_or(self.desc.update.path.name()),
            Owner::Pass(kind) => kind.name(),
        }
    }

    /// Records a work of the update planned last.
    ///
    /// # Safety
    /// See [`Technique::record`].
    pub(super) unsafe fn record(&self, cmd: vk::CommandBuffer, work: &Work) {
        let frame = self.last.map_or(0, |id| id.frame);
        match work.owner {
            // SAFETY: the caller's obligations.
            Owner::Technique => unsafe { self.technique().record(cmd, frame, work) },
            // SAFETY: as above.
            Owner::Pass(kind) => unsafe { self.after.record(cmd, frame, kind, work) },
        }
    }

    /// Plans an update and advances the state. If it fails, call [`discard_last`](Self::discard_last).
    pub(super) fn plan(&mut self) -> Result<Update> {
        self.updates += 1;
        let Self { instances, technique, after, steps, wrote, last, desc, recorded, .. } = self;
        steps.clear();
        // Reuses the lists of the update `frames_in_flight` before it.
        let frame = (*recorded + 1) % u64::from(desc.frames_in_flight);
        let id = UpdateId { update: self.updates, recorded: *recorded, frame };
        *last = Some(id);
        let stats = technique.plan(instances, id, steps)?;
        if !steps.is_empty() {
            wrote.clear();
            wrote.extend(steps.uses());
        }
        after.plan(&mut **technique, instances, id, wrote, steps)?;
        *recorded += u64::from(!steps.is_empty());
        Ok(Update { ticket: Ticket { crowd: self.number, id }, stats, timestamps: self.timestamps()? })
    }
}
