//! Instances of one mesh, their pose buffers, and the recording of their updates.

use super::{Kernel, MeshBuffers, delta_range};
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::compute::{ComputePass, SetBuffers, Sets, list_entries};
use crate::gpu::device::Device;
use crate::gpu::feedback::FeedbackPass;
use crate::gpu::memory::{Buffer, BufferDesc};
use crate::gpu::shaders::DenseListEntry;
use crate::mesh::packed::{POSE_STRIDE, PackedLayout};
use crate::plan::commands::{Command, CommandList, PassCommand};
use crate::plan::{BatchSize, Plan, PoseState, Source, UpdateDesc, UpdateStats};
use crate::weights::delta::check_weights;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// How to make a [`Crowd`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CrowdDesc {
    /// Heads, each with weights and poses of its own (≥ 1).
    pub instances: u32,
    /// How poses are updated.
    pub update: UpdateDesc,
    /// Updates that may be recorded and not yet finished (≥ 1): how many rings of coefficients are kept. Updates
    /// that recorded nothing and discarded ones do not count.
    pub frames_in_flight: u32,
}

/// Proof of a recorded update, for [`Crowd::discard`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "an update that never runs has to be discarded with its ticket"]
pub struct Ticket {
    /// Number of the update, from 1.
    update: u64,
    /// Updates with passes before it: where in the ring its coefficient lists are.
    recorded: u64,
}

/// What an update recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Update {
    /// For [`Crowd::discard`], should the command buffer never run.
    pub ticket: Ticket,
    /// Coefficients, passes and bytes; all zero when nothing changed and nothing was recorded.
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
    kernel: Kernel,
    desc: CrowdDesc,
    poses: Buffer,
    lists: Option<Lists>,
    states: Vec<PoseState>,
    weights: Vec<Vec<f32>>,
    plans: Vec<Plan>,
    list: CommandList,
    /// Updates planned.
    updates: u64,
    /// Updates with passes, less discarded ones: the ring of coefficient lists turns with them.
    recorded: u64,
}

/// Coefficient lists in host-visible memory, and the descriptor sets of the compute path.
struct Lists {
    sets: Sets,
    ring: Buffer,
    /// Bytes of one instance's list.
    stride: u64,
    instances: u32,
}

impl Lists {
    /// Where the list of an instance is in a frame's part of the ring. Fits 32 bits: checked in [`Crowd::new`].
    fn offset(&self, frame: u64, instance: u32) -> u64 {
        (frame * u64::from(self.instances) + u64::from(instance)) * self.stride
    }
}

impl Crowd {
    pub(super) fn new(device: &Arc<Device>, mesh: &Arc<MeshBuffers>, kernel: Kernel, desc: &CrowdDesc) -> Result<Self> {
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
            | vk::BufferUsageFlags::TRANSFER_SRC;
        if device.feedback.is_some() {
            usage |= vk::BufferUsageFlags::TRANSFORM_FEEDBACK_BUFFER_EXT;
        }
        let poses = Buffer::new(
            device,
            &BufferDesc { name: "deltamorph poses", bytes, usage, location: MemoryLocation::GpuOnly },
        )?;
        let lists = match &kernel {
            Kernel::Compute(compute) => {
                // Only `All` reads lists; the kernels that do not still have one bound.
                let (entries, lists) = match desc.update.batch {
                    BatchSize::All => {
                        (mesh.layout.targets.len(), u64::from(desc.instances) * u64::from(desc.frames_in_flight))
                    }
                    BatchSize::Targets(_) => (0, 1),
                };
                let stride = ((entries * size_of::<DenseListEntry>()) as u64).max(16).next_multiple_of(256);
                let bytes = stride.saturating_mul(lists);
                if bytes > u64::from(u32::MAX) {
                    return Err(Error::invalid(
                        format!("the coefficient lists of {} instances take {bytes} bytes", desc.instances),
                        "make several crowds, or use a batch size of 1 to 16",
                    ));
                }
                let mut ring = Buffer::new(
                    device,
                    &BufferDesc {
                        name: "deltamorph coefficient lists",
                        bytes,
                        usage: vk::BufferUsageFlags::STORAGE_BUFFER,
                        location: MemoryLocation::CpuToGpu,
                    },
                )?;
                ring.mapped()?;
                let sets = Sets::new(
                    compute,
                    &SetBuffers {
                        layout: &mesh.layout,
                        base: mesh.base.raw,
                        poses: poses.raw,
                        instances: desc.instances,
                        slots: desc.update.slots,
                        deltas: (mesh.deltas.raw, delta_range(&mesh.layout)),
                        lists: (ring.raw, stride),
                    },
                )?;
                Some(Lists { sets, ring, stride, instances: desc.instances })
            }
            Kernel::Feedback(_) => None,
        };
        let instances = desc.instances as usize;
        Ok(Self {
            states: vec![PoseState::new(desc.update)?; instances],
            weights: vec![vec![0.0; mesh.layout.targets.len()]; instances],
            plans: vec![Plan::default(); instances],
            list: CommandList::new(desc.update.path),
            updates: 0,
            recorded: 0,
            device: device.clone(),
            mesh: mesh.clone(),
            kernel,
            desc: *desc,
            poses,
            lists,
        })
    }

    /// Bytes of device memory that the poses of a crowd take.
    pub fn pose_bytes(layout: &PackedLayout, desc: &CrowdDesc) -> u64 {
        layout.pose_bytes().saturating_mul(u64::from(desc.instances) * u64::from(desc.update.slots))
    }

    /// How the crowd was made.
    pub fn desc(&self) -> &CrowdDesc {
        &self.desc
    }

    /// Ask for these weights, one per target in the mesh's order, from the next recorded update on.
    ///
    /// # Errors
    /// An instance out of range; a wrong number of weights; one that is not finite. Nothing changes then.
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        let targets = &self.mesh.layout.targets;
        check_weights(weights, |i| targets.get(i).map(|t| t.name.as_str()), targets.len())?;
        self.check_instance(instance)?;
        self.weights[instance as usize].copy_from_slice(weights);
        Ok(())
    }

    /// The next pose of `instance` has no predecessor (it was hidden, or teleported): its previous pose will
    /// be the pose itself, so that motion vectors come out as zero.
    ///
    /// # Errors
    /// An instance out of range.
    pub fn cut(&mut self, instance: u32) -> Result<()> {
        self.check_instance(instance)?;
        self.states[instance as usize].cut();
        Ok(())
    }

    /// The update of `ticket` and all later ones will never run (their command buffers were reset or dropped):
    /// what they would have written is unknown now, and the next update rebuilds it from the base pose.
    /// Until then [`pose`](Self::pose) is an error for the instances concerned; the previous pose of that update
    /// will be the pose itself.
    pub fn discard(&mut self, ticket: Ticket) {
        self.states.iter_mut().for_each(|state| state.discard_from(ticket.update));
        self.recorded = self.recorded.min(ticket.recorded);
    }

    /// The pose of `instance` once the updates recorded so far have run.
    ///
    /// # Errors
    /// An instance out of range; no update recorded yet, or its update was discarded.
    pub fn pose(&self, instance: u32) -> Result<PoseView> {
        let plan = self.plan_of(instance)?;
        Ok(self.view(instance, plan.result))
    }

    /// The pose of `instance` before its last update: the pose itself when nothing changed, on its first
    /// update, and after [`cut`](Self::cut); `None` where the update had to overwrite it (one slot; several
    /// feedback passes in two slots).
    ///
    /// # Errors
    /// As [`pose`](Self::pose).
    pub fn previous_pose(&self, instance: u32) -> Result<Option<PoseView>> {
        let plan = self.plan_of(instance)?;
        Ok(plan.previous.map(|slot| self.view(instance, slot)))
    }

    fn check_instance(&self, instance: u32) -> Result<()> {
        if instance < self.desc.instances {
            return Ok(());
        }
        Err(Error::invalid(
            format!("instance {instance} of a crowd of {}", self.desc.instances),
            "count instances from 0",
        ))
    }

    fn plan_of(&self, instance: u32) -> Result<&Plan> {
        self.check_instance(instance)?;
        if self.states[instance as usize].applied().is_none() {
            return Err(Error::invalid(format!("instance {instance} has no pose yet"), "record an update first"));
        }
        Ok(&self.plans[instance as usize])
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
        &mut self.list
    }

    /// Plan the update and take it as done.
    pub(super) fn plan_update(&mut self) -> Update {
        self.updates += 1;
        for ((state, weights), plan) in self.states.iter_mut().zip(&self.weights).zip(&mut self.plans) {
            state.plan(weights, self.updates, plan);
        }
        self.list.fill(&self.plans);
        let stats = UpdateStats::new(&self.mesh.layout, &self.list, &self.plans);
        let ticket = Ticket { update: self.updates, recorded: self.recorded };
        self.recorded += u64::from(!self.list.commands.is_empty());
        Update { ticket, stats }
    }

    /// Write the planned commands.
    ///
    /// # Safety
    /// As [`super::MorphEngine::record_update`].
    pub(super) unsafe fn record(&mut self, cmd: vk::CommandBuffer) -> Result<()> {
        let frame = self.recorded % u64::from(self.desc.frames_in_flight);
        if self.desc.update.batch == BatchSize::All {
            self.write_lists(frame)?;
        }
        for command in &self.list.commands {
            match command {
                // SAFETY: the caller's obligations.
                Command::Barrier(hazard) => unsafe { barriers::record(&self.device.raw, cmd, *hazard) },
                // SAFETY: the caller's obligations; the buffers are ours or our mesh's, and the lists of this
                // frame were written above.
                Command::Pass(pass) => unsafe { self.record_pass(cmd, pass, frame) },
            }
        }
        Ok(())
    }

    /// Write this frame's coefficient lists; the update that used this ring last has finished by contract.
    fn write_lists(&mut self, frame: u64) -> Result<()> {
        let Some(lists) = &mut self.lists else { return Ok(()) };
        for pass in self.list.passes() {
            let coefficients = &self.list.coefficients[pass.coefficients.clone()];
            let (at, size) = (lists.offset(frame, pass.instance) as usize, lists.stride as usize);
            let out = &mut lists.ring.mapped()?[at..at + size];
            for (slot, entry) in
                out.chunks_exact_mut(size_of::<DenseListEntry>()).zip(list_entries(&self.mesh.layout, coefficients))
            {
                slot.copy_from_slice(bytemuck::bytes_of(&entry));
            }
        }
        Ok(())
    }

    /// # Safety
    /// As [`record`](Self::record).
    unsafe fn record_pass(&self, cmd: vk::CommandBuffer, pass: &PassCommand, frame: u64) {
        let coefficients = &self.list.coefficients[pass.coefficients.clone()];
        match (&self.kernel, &self.lists) {
            (Kernel::Feedback(feedback), _) => {
                let source = match pass.source {
                    Source::Base => (self.mesh.base.raw, 0),
                    Source::Slot(slot) => (self.poses.raw, self.offset(pass.instance, slot)),
                };
                let pass = FeedbackPass {
                    layout: &self.mesh.layout,
                    deltas: self.mesh.deltas.raw,
                    source,
                    destination: (self.poses.raw, self.offset(pass.instance, pass.destination)),
                    coefficients,
                };
                // SAFETY: the caller's obligations; source and destination are different slots: the plan
                // alternates (tests hold every plan to that).
                unsafe { feedback.record(cmd, &pass) };
            }
            (Kernel::Compute(compute), Some(lists)) => {
                let list = match self.desc.update.batch {
                    BatchSize::All => lists.offset(frame, pass.instance),
                    BatchSize::Targets(_) => 0,
                };
                let pass = ComputePass {
                    layout: &self.mesh.layout,
                    sets: lists.sets.get(pass.instance, pass.source, pass.destination),
                    list: list as u32,
                    coefficients,
                };
                // SAFETY: the caller's obligations; the sets were written for this mesh and crowd.
                unsafe { compute.record(cmd, &pass) };
            }
            (Kernel::Compute(_), None) => {}
        }
    }
}
