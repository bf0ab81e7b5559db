//! What a crowd on a dense path has of its own: plans of passes, and coefficient lists.

use super::MeshBuffers;
use super::crowd::CrowdDesc;
use super::{Kernel, delta_range};
use crate::abi::push::DenseListEntry;
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::baselines::Baseline;
use crate::gpu::baselines::vertex_store::StoreSets;
use crate::gpu::compute::{ComputePass, PassSets, SetBuffers, list_entries};
use crate::gpu::device::Device;
use crate::gpu::feedback::FeedbackPass;
use crate::gpu::memory::{Buffer, BufferDesc};
use crate::plan::commands::{Command, CommandList, PassCommand};
use crate::plan::heads::Heads;
use crate::plan::{BatchSize, Plan, PoseState, Source, UpdateStats};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

pub(super) struct Dense {
    kernel: Kernel,
    mesh: Arc<MeshBuffers>,
    desc: CrowdDesc,
    lists: Option<Lists>,
    /// Where passes of `vertex-store` store.
    stores: Option<StoreSets>,
    pub(super) states: Vec<PoseState>,
    pub(super) plans: Vec<Plan>,
    pub(super) list: CommandList,
}

/// Coefficient lists in host-visible memory, and the descriptor sets of the compute path.
struct Lists {
    sets: PassSets,
    ring: Buffer,
    /// Bytes of one instance's list.
    stride: u64,
    instances: u32,
}

impl Lists {
    /// Where the list of an instance is in a frame's part of the ring. Fits 32 bits: checked in [`Dense::new`].
    fn offset(&self, frame: u64, instance: u32) -> u64 {
        (frame * u64::from(self.instances) + u64::from(instance)) * self.stride
    }
}

impl Dense {
    pub(super) fn new(
        device: &Arc<Device>,
        mesh: &Arc<MeshBuffers>,
        kernel: Kernel,
        desc: &CrowdDesc,
        poses: &Buffer,
    ) -> Result<Self> {
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
                let sets = PassSets::new(
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
            Kernel::Feedback(_) | Kernel::Blocks(_) | Kernel::Baseline(_) => None,
        };
        let stores = match &kernel {
            Kernel::Baseline(Baseline::VertexStore(kernel)) => {
                Some(StoreSets::new(kernel, &mesh.layout, poses.raw, desc.instances * desc.update.slots)?)
            }
            _ => None,
        };
        let instances = desc.instances as usize;
        Ok(Self {
            kernel,
            mesh: mesh.clone(),
            desc: *desc,
            lists,
            stores,
            states: vec![PoseState::new(desc.update)?; instances],
            plans: vec![Plan::default(); instances],
            list: CommandList::new(desc.update.path),
        })
    }

    pub(super) fn plan(&mut self, heads: &Heads, update: u64) -> UpdateStats {
        for ((state, asked), plan) in self.states.iter_mut().zip(heads.asked()).zip(&mut self.plans) {
            match asked {
                Some(weights) => state.plan(weights, update, plan),
                None => plan.clear(),
            }
        }
        self.list.fill(&self.plans);
        UpdateStats::new(&self.mesh.layout, &self.list, &self.plans)
    }

    /// Write the planned commands.
    ///
    /// # Safety
    /// As [`super::MorphEngine::record_update`]; `poses` are the crowd's.
    pub(super) unsafe fn record(
        &mut self,
        device: &Device,
        cmd: vk::CommandBuffer,
        poses: &Buffer,
        frame: u64,
    ) -> Result<()> {
        if self.desc.update.batch == BatchSize::All {
            self.write_lists(frame)?;
        }
        for command in &self.list.commands {
            match command {
                // SAFETY: the caller's obligations.
                Command::Barrier(hazard) => unsafe { barriers::record(&device.raw, cmd, *hazard) },
                // SAFETY: the caller's obligations; the buffers are ours or our mesh's, and the lists of this
                // frame were written above.
                Command::Pass(pass) => unsafe { self.record_pass(cmd, pass, poses, frame) },
                Command::Blocks(_) | Command::Scatter(_) | Command::Animated(_) => {}
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

    fn offset(&self, instance: u32, slot: u32) -> u64 {
        u64::from(instance * self.desc.update.slots + slot) * self.mesh.layout.pose_bytes()
    }

    /// # Safety
    /// As [`record`](Self::record).
    unsafe fn record_pass(&self, cmd: vk::CommandBuffer, pass: &PassCommand, poses: &Buffer, frame: u64) {
        let coefficients = &self.list.coefficients[pass.coefficients.clone()];
        let vertex_pass = || FeedbackPass {
            layout: &self.mesh.layout,
            deltas: self.mesh.deltas.raw,
            source: match pass.source {
                Source::Base => (self.mesh.base.raw, 0),
                Source::Slot(slot) => (poses.raw, self.offset(pass.instance, slot)),
            },
            destination: (poses.raw, self.offset(pass.instance, pass.destination)),
            coefficients,
        };
        match (&self.kernel, &self.lists) {
            // SAFETY: the caller's obligations; source and destination are different slots: the plan
            // alternates (tests hold every plan to that).
            (Kernel::Feedback(feedback), _) => unsafe { feedback.record(cmd, &vertex_pass()) },
            (Kernel::Baseline(Baseline::VertexStore(store)), _) => {
                let pose = pass.instance * self.desc.update.slots + pass.destination;
                let sets = self.stores.iter().flat_map(|stores| stores.of(pose));
                // SAFETY: as for `feedback`; the sets were written for this mesh and crowd.
                unsafe { store.record(cmd, &vertex_pass(), sets) };
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
            _ => {}
        }
    }
}
