//! Path `compute`: dense passes with coefficients in push constants (batch sizes 1 to 16) or in a list (all in one
//! pass). The first pass of an update reads the current slot and writes the next; the others run
//! in place.

use super::technique::{ChunkSets, DensePass, Passes};
use crate::abi::modules::{DENSE, DENSE_LIST};
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::{DenseListEntry, DenseListPush, DensePush};
use crate::error::Result;
use crate::gpu::descriptors::BufferRange;
use crate::gpu::memory::Ring;
use crate::gpu::mesh::delta_range;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines, Workgroups};
use crate::pack::{DeltaFormat, PackedLayout, PackedTarget, PoseFormat};
use crate::plan::BatchSize;
use crate::plan::steps::{Resource, Source, Use, Work};
use crate::update::technique::Context;
use crate::weights::delta::Coefficient;
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// Pipelines for batches 0 (a copy) to the batch size, or the one that reads a list.
#[derive(Clone, Copy, PartialEq)]
struct Compute {
    format: DeltaFormat,
    batch: BatchSize,
}

impl PipelineKey for Compute {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let (format, pose) = (self.format.row(), PoseFormat::Float32.row());
        objects.add_layout(&[DENSE.row, DENSE_LIST.row], 0)?;
        match self.pushed() {
            None => objects.add_compute(DENSE_LIST.module(format, pose, 0)?, &[&[]]),
            Some(most) => {
                let batches: Vec<[u32; 1]> = (0..=most).map(|batch| [batch]).collect();
                let constants: Vec<&[u32]> = batches.iter().map(<[u32; 1]>::as_slice).collect();
                objects.add_compute(DENSE.module(format, pose, 0)?, &constants)
            }
        }
    }
}

impl Compute {
    /// Most targets of a pass with coefficients in push constants; `None`: coefficients are in a list.
    fn pushed(self) -> Option<u32> {
        match self.batch {
            BatchSize::Targets(most) => Some(most),
            BatchSize::All => None,
        }
    }
}

/// Device state of a crowd's compute passes.
pub(crate) struct ComputePasses {
    kernel: Arc<Pipelines<Compute>>,
    instances: u32,
    slots: u32,
    /// Coefficient lists, `[frame][instance]`.
    ring: Ring,
    stride: u64,
    /// `[instance][destination slot][source]`, where the source is the base pose, the same slot, or the slot before.
    sets: ChunkSets,
}

impl Passes for ComputePasses {
    const USES: &'static [Use] = &[Use::read(Resource::Asset), Use::read(Resource::Poses), Use::write(Resource::Poses)];

    fn new(context: Context<'_>) -> Result<Self> {
        let layout = context.layout();
        let desc = context.desc;
        let mesh = context.mesh;
        let poses = context.poses;
        let batch = desc.update.batch;
        let slots = poses.slots;
        let kernel = context.kernels.get(Compute { format: layout.format, batch })?;
        // Kernels that read no list still have one bound.
        let (entries, instances, frames) = match kernel.key.pushed() {
            None => (layout.targets.len(), desc.instances, desc.frames_in_flight),
            Some(_) => (0, 1, 1),
        };
        let stride = Ring::part_bytes((entries * size_of::<DenseListEntry>()) as u64);
        let part = stride.saturating_mul(instances.into());
        let bytes = part.saturating_mul(frames.into());
        context.check_offsets("coefficient lists", bytes, "make several crowds, or use a batch size of 1 to 16")?;
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let ring = Ring::new(context.device, "deltamorph coefficient lists", part, frames, usage)?;
        let lists = [(mesh.deltas.raw, delta_range(layout)), (ring.range(0).buffer, stride)]
            .map(|(buffer, size)| BufferRange::new(buffer, 0, size));
        let base = mesh.base.raw;
        let poses_of = |instance| (0..slots).map(move |slot| (instance, slot));
        let bound = (0..desc.instances).flat_map(poses_of).flat_map(|(instance, slot)| {
            let pose = move |slot| (poses.buffer, poses.offset(instance, slot), poses.format.stride());
            let sources = [(base, 0, poses.format.stride()), pose(slot), pose((slot + slots - 1) % slots)];
            sources.map(|source| {
                move |first: usize, vertices: usize| {
                    let chunk = |(buffer, from, stride): (vk::Buffer, u64, usize)| {
                        BufferRange::new(buffer, from + (first * stride) as u64, (vertices * stride) as u64)
                    };
                    vec![chunk(source), chunk(pose(slot)), lists[0], lists[1]]
                }
            })
        });
        let sets = ChunkSets::new(&kernel.objects, layout, bound)?;
        Ok(Self { kernel, instances, slots, ring, stride, sets })
    }

    fn write_list(&mut self, frame: u64, work: &Work, pass: &DensePass<'_>) -> Result<()> {
        if self.kernel.key.pushed().is_none() {
            let words = &mut self.ring.words(frame)?[work.instance as usize * self.stride as usize / 4..];
            let words = &mut words[..pass.layout.targets.len() * size_of::<DenseListEntry>() / 4];
            let entries: &mut [DenseListEntry] = bytemuck::cast_slice_mut(words);
            for (entry, c) in entries[work.items.start as usize..].iter_mut().zip(pass.coefficients) {
                *entry = listed(c, &pass.layout.targets[c.target as usize]);
            }
        }
        Ok(())
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, frame: u64, work: &Work, pass: &DensePass<'_>) {
        let pushed = self.kernel.key.pushed().is_some();
        let count = pass.coefficients.len();
        let (pipeline, list) = match pushed {
            false => (0, (frame * u64::from(self.instances) + u64::from(work.instance)) * self.stride),
            true => (count, 0),
        };
        let dense = dense_push(pass.layout, pass.coefficients);
        let source = match work.source {
            Source::Base => 0,
            Source::Slot(slot) if slot == work.destination => 1,
            // The plan reads no other slot.
            Source::Slot(_) => 2,
        };
        let sets = self.sets.get((work.instance * self.slots + work.destination) * 3 + source);
        for ((first, vertices), set) in pass.layout.chunks().zip(sets) {
            // Fits 32 bits: checked in `new` and, for deltas, at upload.
            let offsets = [(pass.layout.row_start(0, first, vertices) * 4) as u32, list as u32];
            let chunk_vertices = vertices as u32;
            let list = DenseListPush { chunk_vertices, first_entry: work.items.start, entry_count: count as u32 };
            let dense = DensePush { chunk_vertices, ..dense };
            let push = if pushed { bytes_of(&dense) } else { bytes_of(&list) };
            let workgroups = Workgroups::Of([chunk_vertices / WORKGROUP, 1]);
            // SAFETY: the caller's obligations; the sets were written for this mesh and crowd, and this frame's lists
            // are complete; offsets are multiples of 64 vertices × 12 bytes or of the list's stride, which satisfy the
            // device's alignment; padded vertices fill whole workgroups, no more than the device has (checked at
            // upload).
            unsafe { self.kernel.objects.dispatch(cmd, pipeline, (*set, &offsets), push, workgroups) };
        }
    }
}

fn listed(c: &Coefficient, target: &PackedTarget) -> DenseListEntry {
    let coefficient = c.value * target.position_step;
    DenseListEntry { target: c.target, coefficient, normal_coefficient: coefficient * target.normal_ratio() }
}

/// Coefficients and targets in the layout of `dense.comp`.
fn dense_push(layout: &PackedLayout, coefficients: &[Coefficient]) -> DensePush {
    let mut push = DensePush::default();
    // A list pass may have more coefficients, and ignores these.
    for (i, c) in coefficients.iter().enumerate().take(push.coefficients.len()) {
        let target = &layout.targets[c.target as usize];
        push.coefficients[i] = c.value * target.position_step;
        push.targets[i / 2] |= c.target << (16 * (i % 2));
        push.normal_exponents[i / 4] |= u32::from(target.normal_exponent as u8) << (8 * (i % 4));
    }
    push
}
