//! The `compute` path: dense passes, with coefficients in push constants (batch sizes 1 to 16) or listed in a
//! buffer ("all in one pass").

use super::descriptors::{Bound, Sets};
use super::device::Device;
use super::pipelines::Objects;
use crate::abi::modules::{DENSE, DENSE_LIST};
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::{DenseListEntry, DenseListPush, DensePush};
use crate::error::Result;
use crate::pack::{DeltaFormat, POSE_STRIDE, PackedLayout};
use crate::plan::{BatchSize, Source};
use crate::weights::delta::Coefficient;
use ash::vk;
use bytemuck::bytes_of;
use std::sync::Arc;

/// Pipelines for batches 0 (a copy) to the batch size, or the one that reads a list.
pub(crate) struct Compute {
    pub(crate) objects: Objects,
    format: DeltaFormat,
    batch: BatchSize,
}

/// The buffers of one pass.
pub(crate) struct ComputePass<'a> {
    pub(crate) layout: &'a PackedLayout,
    /// A set for each chunk: [`PassSets::get`].
    pub(crate) sets: &'a [vk::DescriptorSet],
    /// Dynamic offset of the coefficient list.
    pub(crate) list: u32,
    pub(crate) coefficients: &'a [Coefficient],
}

impl Compute {
    pub(crate) fn new(device: &Arc<Device>, format: DeltaFormat, batch: BatchSize) -> Result<Self> {
        let mut objects = Objects::none(device);
        objects.add_layout(&[DENSE.row, DENSE_LIST.row], 0)?;
        match batch {
            BatchSize::All => objects.add_compute(DENSE_LIST.module(format, 0)?, &[&[]])?,
            BatchSize::Targets(most) => {
                let batches: Vec<[u32; 1]> = (0..=most).map(|batch| [batch]).collect();
                let constants: Vec<&[u32]> = batches.iter().map(<[u32; 1]>::as_slice).collect();
                objects.add_compute(DENSE.module(format, 0)?, &constants)?;
            }
        }
        Ok(Self { objects, format, batch })
    }

    pub(crate) fn serves(&self, format: DeltaFormat, batch: BatchSize) -> bool {
        (self.format, self.batch) == (format, batch)
    }

    /// Record one pass.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with compute.
    /// - `pass.sets` were written for `pass.layout` (see [`PassSets`]) and live until the pass has run; for
    ///   [`BatchSize::All`] the list at its offset holds [`list_entries`] of `pass.coefficients` by then.
    pub(crate) unsafe fn record(&self, cmd: vk::CommandBuffer, pass: &ComputePass<'_>) {
        let device = &self.objects.device.raw;
        let pipeline = match self.batch {
            BatchSize::All => self.objects.pipelines[0],
            BatchSize::Targets(_) => self.objects.pipelines[pass.coefficients.len()],
        };
        // SAFETY: the caller's obligation; the pipeline is ours.
        unsafe { device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::COMPUTE, pipeline) };
        let dense = dense_push(pass.layout, pass.coefficients);
        for ((first, vertices), set) in pass.layout.chunks().zip(pass.sets) {
            let offsets = [(pass.layout.row_start(0, first, vertices) * 4) as u32, pass.list];
            let chunk_vertices = vertices as u32;
            let list = DenseListPush { chunk_vertices, entry_count: pass.coefficients.len() as u32 };
            let dense = DensePush { chunk_vertices, ..dense };
            let push = match self.batch {
                BatchSize::All => bytes_of(&list),
                BatchSize::Targets(_) => bytes_of(&dense),
            };
            // SAFETY: the caller's obligations; the push constants are within the layout's range; offsets are
            // multiples of 64 vertices × 12 bytes or of the list's stride, which satisfy the device's alignment;
            // padded vertices fill whole workgroups, no more than the device has (checked at upload).
            unsafe {
                device.cmd_bind_descriptor_sets(
                    cmd,
                    vk::PipelineBindPoint::COMPUTE,
                    self.objects.layout,
                    0,
                    &[*set],
                    &offsets,
                );
                device.cmd_push_constants(cmd, self.objects.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
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

/// The coefficient list of `dense_list.comp`.
pub(crate) fn list_entries<'a>(
    layout: &'a PackedLayout,
    coefficients: &'a [Coefficient],
) -> impl Iterator<Item = DenseListEntry> + 'a {
    coefficients.iter().map(|c| {
        let target = &layout.targets[c.target as usize];
        let coefficient = c.value * target.position_step;
        let normal_coefficient = coefficient * target.normal_ratio();
        DenseListEntry { target: c.target, coefficient, normal_coefficient, unused: 0 }
    })
}

/// The buffers that a crowd's descriptor sets point to.
pub(crate) struct SetBuffers<'a> {
    pub(crate) layout: &'a PackedLayout,
    pub(crate) base: vk::Buffer,
    /// Poses, `[instance][slot]`.
    pub(crate) poses: vk::Buffer,
    pub(crate) instances: u32,
    pub(crate) slots: u32,
    /// Deltas, and the bytes of a chunk.
    pub(crate) deltas: (vk::Buffer, u64),
    /// Coefficient lists, and the bytes of one.
    pub(crate) lists: (vk::Buffer, u64),
}

/// The descriptor sets of a crowd: source, destination, deltas, coefficient list. Poses are bound where they are, one
/// set for each pair, and not by dynamic offset: synchronization validation does not see dynamic offsets and would take
/// the poses of two heads for one piece of memory. For each instance and destination slot, one per source (the base
/// pose, the slot itself, the slot before) and chunk.
pub(crate) struct PassSets {
    slots: u32,
    chunks: usize,
    sets: Sets,
}

/// Sources of a destination slot.
const SOURCES: u32 = 3;

impl PassSets {
    pub(crate) fn new(compute: &Compute, buffers: &SetBuffers<'_>) -> Result<Self> {
        let mut bound = vec![];
        for instance in 0..buffers.instances {
            for slot in 0..buffers.slots {
                for source in [Source::Base, Source::Slot(slot), Source::Slot(before(slot, buffers.slots))] {
                    bound.extend(buffers.bound(instance, source, slot));
                }
            }
        }
        let sets = Sets::new(&compute.objects.device, compute.objects.set_layout, &bound)?;
        Ok(Self { slots: buffers.slots, chunks: buffers.layout.chunks().count(), sets })
    }

    /// The sets of a pass, one for each chunk.
    pub(crate) fn get(&self, instance: u32, source: Source, destination: u32) -> &[vk::DescriptorSet] {
        let source = match source {
            Source::Base => 0,
            Source::Slot(slot) if slot == destination => 1,
            // The plan reads no other slot than the one before.
            Source::Slot(_) => 2,
        };
        let first = ((instance * self.slots + destination) * SOURCES + source) as usize * self.chunks;
        self.sets.range(first..first + self.chunks)
    }
}

impl SetBuffers<'_> {
    /// What a pass binds, chunk by chunk.
    fn bound(&self, instance: u32, source: Source, destination: u32) -> impl Iterator<Item = Vec<Bound>> {
        let layout = self.layout;
        let pose = |slot| u64::from(instance * self.slots + slot) * layout.pose_bytes();
        let (source, from) = match source {
            Source::Base => (self.base, 0),
            Source::Slot(slot) => (self.poses, pose(slot)),
        };
        let to = pose(destination);
        layout.chunks().map(move |(first, vertices)| {
            let (at, size) = ((first * POSE_STRIDE) as u64, (vertices * POSE_STRIDE) as u64);
            vec![
                Bound::new(source, from + at, size),
                Bound::new(self.poses, to + at, size),
                Bound::dynamic(self.deltas.0, self.deltas.1),
                Bound::dynamic(self.lists.0, self.lists.1),
            ]
        })
    }
}

/// The slot that the ring fills before `slot`.
fn before(slot: u32, slots: u32) -> u32 {
    (slot + slots - 1) % slots
}
