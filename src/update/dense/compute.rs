//! The `compute` path: dense passes, with coefficients in push constants (batch sizes 1 to 16) or listed in a
//! buffer ("all in one pass"). The first pass of an update reads the current slot and writes the next, the rest run in
//! place there.

use super::plan::COMPUTE_PASS;
#[cfg(any(test, feature = "internals"))]
use super::plan::PassAccess;
use super::technique::{DensePass, Passes};
use crate::abi::modules::{DENSE, DENSE_LIST};
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::{DenseListEntry, DenseListPush, DensePush};
use crate::error::Result;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::device::Device;
use crate::gpu::kernels::Kernel;
use crate::gpu::mesh::delta_range;
use crate::gpu::pipelines::Objects;
use crate::gpu::ring::Ring;
use crate::pack::{BASE_STRIDE, DeltaFormat, PackedLayout, PoseFormat};
use crate::plan::BatchSize;
#[cfg(any(test, feature = "internals"))]
use crate::plan::steps::{Access, Stage};
use crate::plan::steps::{Source, Use, Work};
use crate::update::technique::Context;
use crate::weights::delta::Coefficient;
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// Pipelines for batches 0 (a copy) to the batch size, or the one that reads a list.
struct Compute {
    objects: Objects,
    key: (DeltaFormat, PoseFormat, BatchSize),
}

impl Kernel for Compute {
    type Key = (DeltaFormat, PoseFormat, BatchSize);

    fn new(device: &Arc<Device>, key: Self::Key) -> Result<Self> {
        let (format, pose, batch) = key;
        let mut objects = Objects::none(device);
        objects.add_layout(&[DENSE.row, DENSE_LIST.row], 0)?;
        match batch {
            BatchSize::All => objects.add_compute(DENSE_LIST.module(format, pose, 0)?, &[&[]])?,
            BatchSize::Targets(most) => {
                let batches: Vec<[u32; 1]> = (0..=most).map(|batch| [batch]).collect();
                let constants: Vec<&[u32]> = batches.iter().map(<[u32; 1]>::as_slice).collect();
                objects.add_compute(DENSE.module(format, pose, 0)?, &constants)?;
            }
        }
        Ok(Self { objects, key })
    }

    fn key(&self) -> Self::Key {
        self.key
    }
}

/// What a crowd's compute passes take.
pub(crate) struct ComputePasses {
    kernel: Arc<Compute>,
    instances: u32,
    /// Coefficient lists of all instances.
    ring: Ring,
    /// Bytes of one instance's list.
    stride: u64,
    sets: PassSets,
}

impl Passes for ComputePasses {
    const USES: &'static [Use] = COMPUTE_PASS;

    #[cfg(any(test, feature = "internals"))]
    const ACCESS: PassAccess = PassAccess {
        reads: (Stage::Compute, Access::ShaderRead),
        writes: (Stage::Compute, Access::ShaderWrite),
        in_place: true,
    };

    fn new(context: Context<'_>) -> Result<Self> {
        let (layout, desc) = (context.layout(), context.desc);
        let batch = desc.update.batch;
        let kernel = context.kernels.get::<Compute>((layout.format, desc.update.pose, batch))?;
        // Only `All` reads lists; the kernels that do not still have one bound.
        let (entries, instances, frames) = match batch {
            BatchSize::All => (layout.targets.len(), desc.instances, desc.frames_in_flight),
            BatchSize::Targets(_) => (0, 1, 1),
        };
        let stride = Ring::part_bytes((entries * size_of::<DenseListEntry>()) as u64);
        let part = stride.saturating_mul(instances.into());
        let bytes = part.saturating_mul(frames.into());
        context.check_offsets("coefficient lists", bytes, "make several crowds, or use a batch size of 1 to 16")?;
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let ring = Ring::new(context.device, "deltamorph coefficient lists", part, frames, usage)?;
        let sets = PassSets::new(&kernel, &context, ring.range(0).buffer, stride)?;
        Ok(Self { kernel, instances, ring, stride, sets })
    }

    fn write_list(&mut self, frame: u64, work: &Work, pass: &DensePass<'_>) -> Result<()> {
        if self.kernel.key.2 == BatchSize::All {
            let words = &mut self.ring.words(frame)?[work.instance as usize * self.stride as usize / 4..];
            let entries: &mut [DenseListEntry] = bytemuck::cast_slice_mut(&mut words[..self.stride as usize / 4]);
            for (entry, coefficient) in entries.iter_mut().zip(pass.coefficients) {
                *entry = list_entry(pass.layout, coefficient);
            }
        }
        Ok(())
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work, pass: &DensePass<'_>) {
        let (objects, batch) = (&self.kernel.objects, self.kernel.key.2);
        let (device, point, stage) =
            (&objects.device.raw, vk::PipelineBindPoint::COMPUTE, vk::ShaderStageFlags::COMPUTE);
        let entry_count = pass.coefficients.len();
        let (pipeline, list) = match batch {
            BatchSize::All => (0, (frame * u64::from(self.instances) + u64::from(work.instance)) * self.stride),
            BatchSize::Targets(_) => (entry_count, 0),
        };
        // SAFETY: the caller's obligation; the pipeline is ours.
        unsafe { device.cmd_bind_pipeline(cmd, point, objects.pipelines[pipeline]) };
        let dense = dense_push(pass.layout, pass.coefficients);
        for ((first, vertices), set) in pass.layout.chunks().zip(self.sets.get(work)) {
            // Fits 32 bits: checked in `new`, and of deltas at upload.
            let offsets = [(pass.layout.row_start(0, first, vertices) * 4) as u32, list as u32];
            let chunk_vertices = vertices as u32;
            let list = DenseListPush { chunk_vertices, entry_count: entry_count as u32 };
            let dense = DensePush { chunk_vertices, ..dense };
            let push = match batch {
                BatchSize::All => bytes_of(&list),
                BatchSize::Targets(_) => bytes_of(&dense),
            };
            // SAFETY: the caller's obligations; the sets were written for this mesh and crowd, and this frame's lists
            // are complete; the push constants are within the layout's range; offsets are multiples of 64 vertices × 12
            // bytes or of the list's stride, which satisfy the device's alignment; padded vertices fill whole
            // workgroups, no more than the device has (checked at upload).
            unsafe {
                device.cmd_bind_descriptor_sets(cmd, point, objects.layout, 0, &[*set], &offsets);
                device.cmd_push_constants(cmd, objects.layout, stage, 0, push);
                device.cmd_dispatch(cmd, chunk_vertices / WORKGROUP, 1, 1);
            }
        }
    }
}

/// Coefficients and targets as `dense.comp` declares them.
fn dense_push(layout: &PackedLayout, coefficients: &[Coefficient]) -> DensePush {
    let mut push = DensePush::default();
    // A list pass has more, and pushes none of this.
    for (i, c) in coefficients.iter().enumerate().take(push.coefficients.len()) {
        let target = &layout.targets[c.target as usize];
        push.coefficients[i] = c.value * target.position_step;
        push.targets[i / 2] |= c.target << (16 * (i % 2));
        push.normal_exponents[i / 4] |= u32::from(target.normal_exponent as u8) << (8 * (i % 4));
    }
    push
}

/// An entry of the coefficient list of `dense_list.comp`.
fn list_entry(layout: &PackedLayout, c: &Coefficient) -> DenseListEntry {
    let target = &layout.targets[c.target as usize];
    let coefficient = c.value * target.position_step;
    let normal_coefficient = coefficient * target.normal_ratio();
    DenseListEntry { target: c.target, coefficient, normal_coefficient, unused: 0 }
}

/// The descriptor sets of a crowd. Poses are bound where they are, and not by dynamic offset: synchronization
/// validation does not see dynamic offsets and would take the poses of two instances for one piece of memory. So there
/// is for each instance and destination slot, one per source (the base pose, the slot itself, the slot before) and
/// chunk.
struct PassSets {
    slots: u32,
    chunks: usize,
    sets: Sets,
}

/// Sources of a destination slot.
const SOURCES: u32 = 3;

impl PassSets {
    /// Sets with the lists of `stride` bytes each in `lists`.
    fn new(kernel: &Compute, context: &Context<'_>, lists: vk::Buffer, stride: u64) -> Result<Self> {
        let (mesh, poses) = (context.mesh, context.poses);
        let deltas = delta_range(&mesh.layout);
        let mut bound = vec![];
        for instance in 0..context.desc.instances {
            for slot in 0..poses.slots {
                let before = (slot + poses.slots - 1) % poses.slots;
                let pose = |slot| (poses.buffer, poses.offset(instance, slot), poses.format.stride());
                for source in [(mesh.base.raw, 0, BASE_STRIDE), pose(slot), pose(before)] {
                    bound.extend(mesh.layout.chunks().map(|(first, vertices)| {
                        let chunk = |(buffer, from, stride)| {
                            BufferRange::new(buffer, from + (first * stride) as u64, (vertices * stride) as u64)
                        };
                        let lists = BufferRange::new(lists, 0, stride);
                        [chunk(source), chunk(pose(slot)), BufferRange::new(mesh.deltas.raw, 0, deltas), lists]
                    }));
                }
            }
        }
        let sets = kernel.objects.sets(&bound)?;
        Ok(Self { slots: poses.slots, chunks: mesh.layout.chunks().count(), sets })
    }

    /// The sets of a pass, one for each chunk.
    fn get(&self, work: &Work) -> &[vk::DescriptorSet] {
        let source = match work.source {
            Source::Base => 0,
            Source::Slot(slot) if slot == work.destination => 1,
            // The plan reads no other slot than the one before.
            Source::Slot(_) => 2,
        };
        let first = ((work.instance * self.slots + work.destination) * SOURCES + source) as usize * self.chunks;
        self.sets.range(first..first + self.chunks)
    }
}
