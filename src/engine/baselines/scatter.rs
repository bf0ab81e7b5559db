//! A crowd on the path `scatter`: integer sums for each instance, cleared, added to and resolved in each update.

use crate::engine::MeshBuffers;
use crate::engine::crowd::CrowdDesc;
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::baselines::scatter::{RECORD_WORDS, Scatter, ScatterBuffers};
use crate::gpu::descriptors::Sets;
use crate::gpu::device::Device;
use crate::gpu::memory::{Buffer, BufferDesc};
use crate::pack::POSE_FLOATS;
use crate::pack::blocks::ExactGrid;
use crate::plan::commands::{Command, CommandList, ScatterCommand, ScatterStep};
use crate::plan::{Plan, UpdateStats};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

pub(super) struct ScatterCrowd {
    kernel: Arc<Scatter>,
    pub(super) grid: ExactGrid,
    /// Input units of a sum: positions, normals.
    units: [f32; 2],
    slots: u32,
    sums: Buffer,
    /// `[instance][slot]`.
    sets: Sets,
}

impl ScatterCrowd {
    pub(super) fn new(
        device: &Arc<Device>,
        mesh: &Arc<MeshBuffers>,
        kernel: &Arc<Scatter>,
        desc: &CrowdDesc,
        poses: &Buffer,
    ) -> Result<Self> {
        let (Some(index), Some(first)) = (&mesh.layout.blocks, &mesh.records) else {
            return Err(Error::invalid(
                format!("mesh '{}' has no records for 'scatter'", mesh.layout.name),
                "upload it with MorphEngine::upload_scatter",
            ));
        };
        let grid = index.exact()?;
        let (pose_bytes, slots) = (mesh.layout.pose_bytes(), desc.update.slots);
        let sums = Buffer::new(
            device,
            &BufferDesc {
                name: "deltamorph scattered sums",
                bytes: pose_bytes.saturating_mul(desc.instances.into()),
                usage: vk::BufferUsageFlags::STORAGE_BUFFER
                    | vk::BufferUsageFlags::TRANSFER_DST
                    | vk::BufferUsageFlags::TRANSFER_SRC,
                location: MemoryLocation::GpuOnly,
            },
        )?;
        let records = u64::from(first.last().copied().unwrap_or(0)) * (RECORD_WORDS * 4) as u64;
        let of_pose = |pose: u32| ScatterBuffers {
            records: (mesh.deltas.raw, records.max(16)),
            sums: (sums.raw, u64::from(pose / slots) * pose_bytes),
            base: mesh.base.raw,
            destination: (poses.raw, u64::from(pose) * pose_bytes),
            pose_bytes,
        };
        let sets = kernel.sets((0..desc.instances * slots).map(of_pose))?;
        let units = index.steps().map(|step| step * grid.weight_step());
        Ok(Self { kernel: kernel.clone(), grid, units, slots, sums, sets })
    }

    #[cfg(feature = "headless")]
    pub(super) fn sums(&self, instance: u32, pose_bytes: u64) -> (vk::Buffer, u64) {
        (self.sums.raw, u64::from(instance) * pose_bytes)
    }

    /// Bytes moved: sums cleared; each record loaded, and its six sums loaded and stored by atomics; sums and base pose
    /// loaded, the pose stored. The floor is records, base pose and pose.
    pub(super) fn stats(&self, mesh: &MeshBuffers, list: &CommandList, plans: &[Plan]) -> UpdateStats {
        let instances = plans.iter().filter(|plan| !plan.passes.is_empty()).count();
        let records: u64 =
            list.coefficients.iter().map(|c| u64::from(self.records_of(mesh, c.target).len() as u32)).sum();
        let poses = instances as u64 * mesh.layout.pose_bytes();
        let (record, atomics) = ((RECORD_WORDS * 4) as u64, (POSE_FLOATS * 8) as u64);
        UpdateStats {
            coefficients: list.coefficients.len(),
            passes: instances,
            rebuilt: instances,
            bytes_moved: poses * 4 + records * (record + atomics),
            bytes_floor: poses * 2 + records * record,
            ..UpdateStats::default()
        }
    }

    fn records_of(&self, mesh: &MeshBuffers, target: u32) -> std::ops::Range<u32> {
        let first = mesh.records.as_deref().unwrap_or(&[]);
        let at = |target: usize| first.get(target).copied().unwrap_or(0);
        at(target as usize)..at(target as usize + 1)
    }

    /// Write the planned commands.
    ///
    /// # Safety
    /// As [`super::super::MorphEngine::record_update`]; `mesh` is the one that this was made with.
    pub(super) unsafe fn record(
        &self,
        device: &Device,
        cmd: vk::CommandBuffer,
        mesh: &MeshBuffers,
        list: &CommandList,
    ) {
        for command in &list.commands {
            match command {
                // SAFETY: the caller's obligations.
                Command::Barrier(hazard) => unsafe { barriers::record(&device.raw, cmd, *hazard) },
                // SAFETY: as above.
                Command::Scatter(step) => unsafe { self.record_step(device, cmd, mesh, list, step) },
                Command::Pass(_) | Command::Blocks(_) | Command::Animated(_) => {}
            }
        }
    }

    /// # Safety
    /// As [`record`](Self::record).
    unsafe fn record_step(
        &self,
        device: &Device,
        cmd: vk::CommandBuffer,
        mesh: &MeshBuffers,
        list: &CommandList,
        command: &ScatterCommand,
    ) {
        let pose_bytes = mesh.layout.pose_bytes();
        let set = self.sets.get((command.instance * self.slots + command.destination) as usize);
        match command.step {
            ScatterStep::Clear => {
                let at = u64::from(command.instance) * pose_bytes;
                // SAFETY: the caller's obligations; the range is within the sums.
                unsafe { device.raw.cmd_fill_buffer(cmd, self.sums.raw, at, pose_bytes, 0) };
            }
            ScatterStep::Add => {
                let targets = list.coefficients[command.coefficients.clone()].iter().filter_map(|c| {
                    let (records, weight) = (self.records_of(mesh, c.target), self.grid.steps(c.value));
                    (!records.is_empty() && weight != 0).then_some((records, weight))
                });
                // SAFETY: the caller's obligations; the records are the mesh's.
                unsafe { self.kernel.record_add(cmd, set, targets) };
            }
            ScatterStep::Resolve => {
                let vertices = mesh.layout.padded_vertices() as u32;
                // SAFETY: the caller's obligations.
                unsafe { self.kernel.record_resolve(cmd, set, vertices, self.units) };
            }
        }
    }
}
