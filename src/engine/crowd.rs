//! Instances of one mesh, their pose buffers, and the recording of their updates.

use super::animated::Animated;
use super::baselines::BaselineCrowd;
use super::blocks::Blocks;
use super::dense::Dense;
use super::{Kernel, MeshBuffers};
use crate::error::{Error, Result};
use crate::gpu::device::Device;
use crate::gpu::memory::{Buffer, BufferDesc};
use crate::pack::{POSE_STRIDE, PackedLayout};
use crate::plan::blocks::check_block_weights;
use crate::plan::commands::CommandList;
use crate::plan::heads::Heads;
use crate::plan::{UpdateDesc, UpdateStats};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The number of the next crowd: tickets tell crowds apart by it.
static CROWDS: AtomicU64 = AtomicU64::new(0);
/// Ranges of discarded updates that a crowd keeps apart.
const DISCARDED_RANGES: usize = 64;

/// How to make a [`Crowd`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrowdDesc {
    /// Heads, each with weights and poses of its own (≥ 1).
    pub instances: u32,
    /// How poses are updated.
    pub update: UpdateDesc,
    /// Updates that may be recorded and not yet finished (≥ 1): how many coefficient or work lists are kept. Updates
    /// that recorded nothing and discarded ones do not count.
    pub frames_in_flight: u32,
}

/// Proof of a recorded update, for [`Crowd::discard`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "an update that never runs has to be discarded with its ticket"]
pub struct Ticket {
    /// The crowd that it is of.
    crowd: u64,
    /// Number of the update, from 1.
    update: u64,
    /// Updates with passes before it: where in the ring its coefficient lists are.
    recorded: u64,
}

/// What an update recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// For [`Crowd::discard`], should the command buffer never run.
    pub ticket: Ticket,
    /// Coefficients, passes and bytes; all zero, but for the bound, when nothing changed and nothing was recorded. On
    /// direct paths they speak of the draw, and are the same when nothing changed.
    pub stats: UpdateStats,
}

/// Where a pose is. Positions start at `offset`, normals (not normalised) 12 bytes after; float32 × 3 each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoseView {
    /// The buffer; usable as vertex, storage and transfer-source buffer.
    pub buffer: vk::Buffer,
    /// Offset of the first vertex, a multiple of 256.
    pub offset: u64,
    /// Bytes, padding included.
    pub size: u64,
    /// Bytes from vertex to vertex.
    pub stride: u32,
    /// Which slot of the instance it is.
    pub slot: u32,
}

/// Heads of one mesh on the device. See the [module](super) for what the caller is responsible for.
pub struct Crowd {
    device: Arc<Device>,
    mesh: Arc<MeshBuffers>,
    desc: CrowdDesc,
    poses: Buffer,
    heads: Heads,
    pub(super) backend: Backend,
    id: u64,
    /// Updates planned.
    updates: u64,
    /// Updates that were discarded, ascending: a ticket is good for one discard.
    discarded: Vec<RangeInclusive<u64>>,
    /// Updates with passes, less discarded ones: the ring of lists turns with them.
    recorded: u64,
}

/// What depends on the update path.
pub(super) enum Backend {
    Dense(Box<Dense>),
    Blocks(Box<Blocks>),
    Animated(Box<Animated>),
    Baseline(Box<BaselineCrowd>),
}

impl Crowd {
    pub(super) fn new(device: &Arc<Device>, mesh: &Arc<MeshBuffers>, kernel: Kernel, desc: &CrowdDesc) -> Result<Self> {
        Self::with_backend(device, mesh, desc, |poses| {
            let baseline = match &kernel {
                Kernel::Baseline(kernel) => BaselineCrowd::new(device, mesh, kernel, desc, poses)?,
                _ => None,
            };
            Ok(match (baseline, kernel, &mesh.layout.blocks) {
                (Some(baseline), ..) => Backend::Baseline(Box::new(baseline)),
                (None, Kernel::Blocks(kernel), Some(index)) => {
                    Backend::Blocks(Box::new(Blocks::new(device, mesh, index, kernel, desc, poses)?))
                }
                (None, kernel, _) => Backend::Dense(Box::new(Dense::new(device, mesh, kernel, desc, poses)?)),
            })
        })
    }

    pub(super) fn with_backend(
        device: &Arc<Device>,
        mesh: &Arc<MeshBuffers>,
        desc: &CrowdDesc,
        backend: impl FnOnce(&Buffer) -> Result<Backend>,
    ) -> Result<Self> {
        if desc.instances == 0 || desc.frames_in_flight == 0 {
            return Err(Error::invalid(
                format!("a crowd of {} instances with {} frames in flight", desc.instances, desc.frames_in_flight),
                "use 1 or more of both",
            ));
        }
        let bytes = Self::pose_bytes(&mesh.layout, desc);
        if bytes > u64::from(u32::MAX) {
            return Err(Error::invalid(
                format!(
                    "{} instances with {} slots take {bytes} bytes of poses; one crowd holds at most {}",
                    desc.instances,
                    desc.update.slots,
                    u32::MAX
                ),
                "make several crowds, or use fewer slots",
            ));
        }
        let mut usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::VERTEX_BUFFER
            | vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC;
        if device.feedback.is_some() {
            usage |= vk::BufferUsageFlags::TRANSFORM_FEEDBACK_BUFFER_EXT;
        }
        let poses = Buffer::new(
            device,
            &BufferDesc { name: "deltamorph poses", bytes, usage, location: MemoryLocation::GpuOnly },
        )?;
        let backend = backend(&poses)?;
        // Those that the GPU samples stay there.
        let targets = if matches!(backend, Backend::Animated(_)) { 0 } else { mesh.layout.targets.len() };
        Ok(Self {
            heads: Heads::new(desc.instances as usize, targets),
            backend,
            id: CROWDS.fetch_add(1, Ordering::Relaxed),
            updates: 0,
            discarded: vec![],
            recorded: 0,
            device: device.clone(),
            mesh: mesh.clone(),
            desc: *desc,
            poses,
        })
    }

    /// Bytes of device memory that the poses of a crowd take. On a direct path that is one, to capture into.
    pub fn pose_bytes(layout: &PackedLayout, desc: &CrowdDesc) -> u64 {
        if desc.update.path.evaluates_in_draws() {
            return layout.pose_bytes();
        }
        layout.pose_bytes().saturating_mul(u64::from(desc.instances) * u64::from(desc.update.slots))
    }

    /// How the crowd was made.
    pub fn desc(&self) -> &CrowdDesc {
        &self.desc
    }

    /// Ask for these weights, one per target in the mesh's order, from the next recorded update on.
    ///
    /// # Errors
    /// An instance out of range or removed; a wrong number of weights; one that is not finite or out of range; more active
    /// targets than a draw of `direct-attributes` takes. Nothing changes then.
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        let exact = match &self.backend {
            Backend::Dense(_) => None,
            Backend::Blocks(blocks) => blocks.exact(),
            Backend::Animated(_) => {
                let what = format!("weights of instance {instance}, which is animated on the GPU");
                return Err(Error::invalid(what, "play a clip, or make the crowd with create_crowd"));
            }
            Backend::Baseline(baseline) => baseline.exact(),
        };
        check_block_weights(weights, &self.mesh.layout, exact)?;
        if let Backend::Baseline(baseline) = &self.backend {
            baseline.check_weights(weights)?;
        }
        self.heads.set_weights(instance, weights)
    }

    /// The next pose of `instance` has no predecessor (it was hidden, or teleported): its previous pose will
    /// be the pose itself, so that motion vectors come out as zero.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn cut(&mut self, instance: u32) -> Result<()> {
        let i = self.heads.check(instance)?;
        match &mut self.backend {
            Backend::Dense(dense) => dense.states[i].cut(),
            Backend::Blocks(blocks) => blocks.planner.states[i].cut(),
            Backend::Animated(animated) => animated.heads.cut(instance),
            Backend::Baseline(baseline) => baseline.states[i].cut(),
        }
        Ok(())
    }

    /// Hide `instance`, or show it again. A hidden one is left out of updates, whatever is asked of it, and keeps its
    /// pose; shown again, it catches up in the next update, and its previous pose is the pose itself then.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
        let changed = self.heads.set_hidden(instance, hidden)?;
        match &mut self.backend {
            Backend::Animated(animated) => animated.heads.set_hidden(instance, hidden),
            _ if changed => self.cut(instance)?,
            _ => {}
        }
        Ok(())
    }

    /// Add a head, in a place that [`remove`](Self::remove) freed: shown, with all weights 0. The next update writes its
    /// pose from base. A crowd begins with all its [`CrowdDesc::instances`] in place, and has no room for more.
    ///
    /// # Errors
    /// No free place.
    pub fn add(&mut self) -> Result<u32> {
        let instance = self.heads.add()?;
        match &mut self.backend {
            Backend::Dense(dense) => dense.states[instance as usize].forget(),
            Backend::Blocks(blocks) => blocks.planner.states[instance as usize].forget(),
            Backend::Animated(animated) => animated.heads.add(instance),
            Backend::Baseline(baseline) => baseline.states[instance as usize].forget(),
        }
        Ok(instance)
    }

    /// Take a head out of the crowd. Its memory stays the crowd's, for the next to be added.
    ///
    /// # Errors
    /// An instance out of range, or removed before.
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.heads.remove(instance)?;
        if let Backend::Animated(animated) = &mut self.backend {
            animated.heads.set_hidden(instance, true);
        }
        Ok(())
    }

    /// The update of `ticket` and all later ones will never run (their command buffers were reset or dropped):
    /// what they would have written is unknown now, and the next update rebuilds it from the base pose.
    /// Until then [`pose`](Self::pose) is an error for the instances concerned; the previous pose of that update
    /// will be the pose itself. An update that was discarded before stays so: nothing changes then.
    ///
    /// That none of them will run is an obligation of the caller, named in the `# Safety` section of
    /// [`record_update`](super::MorphEngine::record_update): the next update takes over the memory of their lists.
    ///
    /// # Errors
    /// A ticket of another crowd.
    pub fn discard(&mut self, ticket: Ticket) -> Result<()> {
        if self.is_discarded(ticket)? {
            return Ok(());
        }
        // Later ranges are part of this one, the last earlier one may end where it begins, and only so many are kept
        // apart: a ticket that waited through all of them is taken for one that was discarded before.
        self.discarded.retain(|updates| *updates.start() < ticket.update);
        let mut first = ticket.update;
        if let Some(before) = self.discarded.pop_if(|updates| *updates.end() + 1 == ticket.update) {
            first = *before.start();
        }
        if self.discarded.len() == DISCARDED_RANGES {
            let oldest = self.discarded.remove(0);
            self.discarded[0] = *oldest.start()..=*self.discarded[0].end();
        }
        self.discarded.push(first..=self.updates);
        match &mut self.backend {
            Backend::Dense(dense) => dense.states.iter_mut().for_each(|state| state.discard_from(ticket.update)),
            Backend::Blocks(blocks) => {
                blocks.planner.states.iter_mut().for_each(|state| state.discard_from(ticket.update))
            }
            // What the GPU would have changed is unchanged: the CPU's count of updates turns back, and that is all.
            Backend::Animated(animated) => animated.heads.discard_from(ticket.recorded),
            Backend::Baseline(baseline) => baseline.discard_from(ticket.update),
        }
        self.recorded = self.recorded.min(ticket.recorded);
        Ok(())
    }

    /// Whether the update of a ticket was discarded.
    ///
    /// # Errors
    /// A ticket of another crowd.
    pub(crate) fn is_discarded(&self, ticket: Ticket) -> Result<bool> {
        if ticket.crowd != self.id {
            return Err(Error::invalid("the ticket is of another crowd", "discard it in the crowd that was updated"));
        }
        Ok(self.discarded.iter().any(|updates| updates.contains(&ticket.update)))
    }

    /// The ticket of the update that is planned next.
    pub(super) fn next_ticket(&self) -> Ticket {
        Ticket { crowd: self.id, update: self.updates + 1, recorded: self.recorded }
    }

    /// Updates with passes from that of `ticket` on, for `headless`.
    #[cfg(feature = "headless")]
    pub(crate) fn recorded_since(&self, ticket: Ticket) -> u64 {
        self.recorded.saturating_sub(ticket.recorded)
    }

    /// The instances that are shown, ascending.
    pub fn shown(&self) -> impl Iterator<Item = u32> {
        self.heads.asked().zip(0..).filter_map(|(asked, i)| asked.map(|_| i))
    }

    /// The pose of `instance` once the updates recorded so far have run.
    ///
    /// # Errors
    /// An instance out of range or removed; no update recorded yet, or its update was discarded; a direct path, which has
    /// no pose buffers.
    pub fn pose(&self, instance: u32) -> Result<PoseView> {
        let (result, _) = self.slots_of(instance)?;
        if self.desc.update.path.evaluates_in_draws() {
            return Err(Error::invalid(
                format!("the path '{}' has no pose buffers", self.desc.update.path.name()),
                "draw with MorphEngine::record_draws, or write the pose with MorphEngine::record_capture",
            ));
        }
        Ok(self.view(instance, result))
    }

    /// The pose of `instance` before its last update: the pose itself when nothing changed, on its first
    /// update, and after [`cut`](Self::cut); `None` where the update had to overwrite it (one slot; several
    /// feedback passes in two slots), and on direct paths.
    ///
    /// # Errors
    /// As [`pose`](Self::pose).
    pub fn previous_pose(&self, instance: u32) -> Result<Option<PoseView>> {
        let (_, previous) = self.slots_of(instance)?;
        let kept = previous.filter(|_| !self.desc.update.path.evaluates_in_draws());
        Ok(kept.map(|slot| self.view(instance, slot)))
    }

    pub(super) fn check_instance(&self, instance: u32) -> Result<usize> {
        self.heads.check(instance)
    }

    /// Slots of the pose and of the previous pose.
    fn slots_of(&self, instance: u32) -> Result<(u32, Option<u32>)> {
        let i = self.heads.check(instance)?;
        let (known, slots) = match &self.backend {
            Backend::Animated(animated) => {
                let slots = animated.slots_of(instance);
                (slots.is_some(), slots.unwrap_or_default())
            }
            Backend::Dense(dense) => {
                (dense.states[i].applied().is_some(), (dense.plans[i].result, dense.plans[i].previous))
            }
            Backend::Blocks(blocks) => {
                let (state, plan) = (&blocks.planner.states[i], blocks.planner.plans[i]);
                (state.is_known(), (plan.result, plan.previous))
            }
            Backend::Baseline(b) => (b.states[i].applied().is_some(), (b.plans[i].result, b.plans[i].previous)),
        };
        if !known {
            return Err(Error::invalid(format!("instance {instance} has no pose yet"), "record an update first"));
        }
        Ok(slots)
    }

    /// The integer sums of an instance, for `headless`: buffer and offset.
    #[cfg(feature = "headless")]
    pub(crate) fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        match &self.backend {
            Backend::Dense(_) => None,
            Backend::Blocks(blocks) => blocks.sums(instance, self.mesh.layout.pose_bytes()),
            Backend::Animated(animated) => Some(animated.sums(instance, self.mesh.layout.pose_bytes())),
            Backend::Baseline(baseline) => baseline.sums(instance),
        }
    }

    fn offset(&self, instance: u32, slot: u32) -> u64 {
        u64::from(instance * self.desc.update.slots + slot) * self.mesh.layout.pose_bytes()
    }

    fn view(&self, instance: u32, slot: u32) -> PoseView {
        PoseView {
            buffer: self.poses.raw,
            offset: self.offset(instance, slot),
            size: self.mesh.layout.pose_bytes(),
            stride: POSE_STRIDE as u32,
            slot,
        }
    }

    pub(super) fn is_on(&self, device: &Arc<Device>) -> bool {
        Arc::ptr_eq(&self.device, device)
    }

    pub(super) fn commands_mut(&mut self) -> &mut CommandList {
        match &mut self.backend {
            Backend::Dense(dense) => &mut dense.list,
            Backend::Blocks(blocks) => &mut blocks.list,
            Backend::Animated(animated) => &mut animated.list,
            Backend::Baseline(baseline) => &mut baseline.list,
        }
    }

    /// Plan the update and take it as done.
    pub(super) fn plan_update(&mut self) -> Update {
        let ticket = self.next_ticket();
        self.updates += 1;
        let stats = match &mut self.backend {
            Backend::Dense(dense) => dense.plan(&self.heads, self.updates),
            Backend::Blocks(blocks) => blocks.plan(&self.heads, self.updates),
            Backend::Animated(animated) => animated.plan(),
            Backend::Baseline(baseline) => baseline.plan(&self.heads, self.updates),
        };
        let turns = match &self.backend {
            // Direct paths record nothing, but write weights.
            Backend::Baseline(baseline) => baseline.has_changed(),
            Backend::Dense(_) | Backend::Blocks(_) | Backend::Animated(_) => !self.commands_mut().commands.is_empty(),
        };
        self.recorded += u64::from(turns);
        Update { ticket, stats }
    }

    /// Write the planned commands of `update`.
    ///
    /// # Safety
    /// As [`super::MorphEngine::record_update`].
    pub(super) unsafe fn record(&mut self, cmd: vk::CommandBuffer, update: &mut Update) -> Result<()> {
        let frame = self.recorded % u64::from(self.desc.frames_in_flight);
        match &mut self.backend {
            // SAFETY: the caller's obligations.
            Backend::Dense(dense) => unsafe { dense.record(&self.device, cmd, &self.poses, frame) },
            Backend::Blocks(blocks) => {
                // SAFETY: the caller's obligations.
                let bytes = unsafe { blocks.record(&self.device, cmd, frame) }?;
                update.stats.bytes_moved += bytes.moved;
                update.stats.bytes_floor += bytes.floor;
                Ok(())
            }
            Backend::Animated(animated) => {
                // SAFETY: the caller's obligations.
                unsafe { animated.record(&self.device, cmd) };
                Ok(())
            }
            // SAFETY: the caller's obligations.
            Backend::Baseline(b) => unsafe { b.record(&self.device, cmd, frame) },
        }
    }

    /// # Safety
    /// As [`super::MorphEngine::record_draws`].
    pub(super) unsafe fn record_draws(&self, cmd: vk::CommandBuffer) -> Result<()> {
        self.shown().try_for_each(|i| self.slots_of(i).map(|_| ()))?;
        if let Backend::Baseline(baseline) = &self.backend {
            // SAFETY: the caller's obligations.
            unsafe { baseline.record_draws(cmd, self.shown()) };
        }
        Ok(())
    }

    /// # Safety
    /// As [`super::MorphEngine::record_capture`].
    pub(super) unsafe fn record_capture(&self, cmd: vk::CommandBuffer, instance: u32) -> Result<PoseView> {
        self.slots_of(instance)?;
        if let Backend::Baseline(baseline) = &self.backend {
            // SAFETY: the caller's obligations.
            unsafe { baseline.record_capture(&self.device, cmd, instance) }?;
        }
        let size = self.mesh.layout.pose_bytes();
        Ok(PoseView { buffer: self.poses.raw, offset: 0, size, stride: POSE_STRIDE as u32, slot: 0 })
    }
}
