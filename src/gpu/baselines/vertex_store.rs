//! The `vertex-store` path: the passes of `feedback`, for devices without transform feedback whose vertex shaders may
//! write storage buffers. Binds targets as vertex attributes, discards all primitives, alternates between slots as
//! `feedback` does: a pass must not store where other vertices are still fetched from.

use crate::abi::modules::VERTEX_STORE;
use crate::abi::push::attribute_push_bytes;
use crate::error::Result;
use crate::gpu::descriptors::{Bound, Sets};
use crate::gpu::device::Device;
use crate::gpu::feedback::{FeedbackPass, push_constants, vertex_buffers, vertex_input};
use crate::gpu::pipelines::Objects;
use crate::pack::{DeltaFormat, POSE_STRIDE, PackedLayout};
use crate::plan::BatchSize;
use ash::vk;
use std::sync::Arc;

/// Pipelines for batches 0 (a copy) to the batch size.
pub(crate) struct VertexStore {
    objects: Objects,
    format: DeltaFormat,
    batch: u32,
}

impl VertexStore {
    pub(crate) fn new(device: &Arc<Device>, format: DeltaFormat, batch: u32) -> Result<Self> {
        let mut objects = Objects::none(device);
        objects.add_layout(&[VERTEX_STORE.row], attribute_push_bytes(format, batch))?;
        objects.add_empty_render_pass()?;
        for b in 0..=batch {
            let (bindings, attributes) = vertex_input(format, b);
            objects.add_discarding_vertex(VERTEX_STORE.module(format, b)?, &bindings, &attributes)?;
        }
        Ok(Self { objects, format, batch })
    }

    pub(crate) fn serves(&self, format: DeltaFormat, batch: BatchSize) -> bool {
        (self.format, BatchSize::Targets(self.batch)) == (format, batch)
    }

    /// Record one pass.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on this device, outside a render pass, on a queue with graphics.
    /// - The buffers hold what `pass.layout` says at the offsets given, and live until the pass has run; source
    ///   and destination are not the same slot. `sets` are those of the destination, one for each chunk.
    pub(crate) unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        pass: &FeedbackPass<'_>,
        sets: impl Iterator<Item = vk::DescriptorSet>,
    ) {
        let device = &self.objects.device.raw;
        let (point, layout) = (vk::PipelineBindPoint::GRAPHICS, self.objects.layout);
        let push = push_constants(pass.layout, pass.coefficients);
        // SAFETY: the caller's obligations; pipeline, layout and render pass are ours; the push constants are within
        // the layout's range (batch ≤ self.batch).
        unsafe {
            self.objects.begin_render_pass(cmd);
            device.cmd_bind_pipeline(cmd, point, self.objects.pipelines[pass.coefficients.len()]);
            if !push.is_empty() {
                let bytes = bytemuck::cast_slice(&push);
                device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, bytes);
            }
        }
        for (chunk, set) in pass.layout.chunks().zip(sets) {
            let (buffers, offsets) = vertex_buffers(pass.layout, chunk, pass.source, pass.deltas, pass.coefficients);
            // SAFETY: as above; each binding reads the chunk's vertices within its buffer, and as many are stored.
            unsafe {
                device.cmd_bind_vertex_buffers(cmd, 0, &buffers, &offsets);
                device.cmd_bind_descriptor_sets(cmd, point, layout, 0, &[set], &[]);
                device.cmd_draw(cmd, chunk.1 as u32, 1, 0, 0);
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }
}

/// Where passes store: a set for each pose of a buffer and each chunk, not dynamic offsets (see `compute`).
pub(crate) struct StoreSets {
    sets: Sets,
    chunks: usize,
}

impl StoreSets {
    /// For `count` poses in `poses`.
    pub(crate) fn new(kernel: &VertexStore, layout: &PackedLayout, poses: vk::Buffer, count: u32) -> Result<Self> {
        let bound: Vec<Vec<Bound>> = (0..u64::from(count))
            .flat_map(|pose| {
                layout.chunks().map(move |(first, vertices)| {
                    let offset = pose * layout.pose_bytes() + (first * POSE_STRIDE) as u64;
                    vec![Bound::new(poses, offset, (vertices * POSE_STRIDE) as u64)]
                })
            })
            .collect();
        let sets = Sets::new(&kernel.objects.device, kernel.objects.set_layout, &bound)?;
        Ok(Self { sets, chunks: layout.chunks().count() })
    }

    /// The sets of a pose, one for each chunk.
    pub(crate) fn of(&self, pose: u32) -> impl Iterator<Item = vk::DescriptorSet> + '_ {
        let first = pose as usize * self.chunks;
        (first..first + self.chunks).map(|set| self.sets.get(set))
    }
}
