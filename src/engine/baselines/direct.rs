//! A crowd on the path `direct`: weights in a ring of host-visible memory, which the draws read.

use crate::engine::crowd::CrowdDesc;
use crate::engine::{MeshBuffers, delta_range};
use crate::error::{Error, Result};
use crate::gpu::baselines::direct::{Direct, DirectBuffers, DirectHead};
use crate::gpu::descriptors::Sets;
use crate::gpu::device::Device;
use crate::gpu::memory::{Buffer, BufferDesc};
use crate::pack::PackedLayout;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// Bytes of a target's weight: coefficients of positions and of normals.
const WEIGHT_BYTES: usize = 8;

pub(super) struct DirectCrowd {
    pub(super) kernel: Arc<Direct>,
    ring: Buffer,
    /// Bytes of one instance's weights.
    stride: u64,
    sets: Sets,
    /// Where each instance's weights are, as written last.
    heads: Vec<DirectHead>,
    poses: vk::Buffer,
}

impl DirectCrowd {
    pub(super) fn new(
        device: &Arc<Device>,
        mesh: &Arc<MeshBuffers>,
        kernel: &Arc<Direct>,
        desc: &CrowdDesc,
        poses: &Buffer,
    ) -> Result<Self> {
        let stride = ((mesh.layout.targets.len() * WEIGHT_BYTES) as u64).max(16).next_multiple_of(256);
        let bytes = stride.saturating_mul(u64::from(desc.instances) * u64::from(desc.frames_in_flight));
        if bytes > u64::from(u32::MAX) {
            return Err(Error::invalid(
                format!("the weights of {} instances take {bytes} bytes", desc.instances),
                "make several crowds, or use fewer frames in flight",
            ));
        }
        let mut ring = Buffer::new(
            device,
            &BufferDesc {
                name: "deltamorph weights",
                bytes,
                usage: vk::BufferUsageFlags::STORAGE_BUFFER,
                location: MemoryLocation::CpuToGpu,
            },
        )?;
        ring.mapped()?;
        let sets = kernel.sets(&buffers(mesh, (ring.raw, stride), poses.raw))?;
        let heads = vec![DirectHead::default(); desc.instances as usize];
        Ok(Self { kernel: kernel.clone(), ring, stride, sets, heads, poses: poses.raw })
    }

    /// Write the weights of all instances, none for one that has no pose, into this frame's part of the ring; the update
    /// that used it last has finished by contract.
    pub(super) fn write<'a>(
        &mut self,
        layout: &PackedLayout,
        weights: impl Iterator<Item = &'a [f32]>,
        frame: u64,
    ) -> Result<()> {
        let frame_bytes = self.stride as usize * self.heads.len();
        let at = frame as usize * frame_bytes;
        let part = &mut self.ring.mapped()?[at..at + frame_bytes];
        for (i, (weights, out)) in weights.zip(part.chunks_exact_mut(self.stride as usize)).enumerate() {
            for ((weight, target), out) in weights.iter().zip(&layout.targets).zip(out.chunks_exact_mut(WEIGHT_BYTES)) {
                let coefficient = weight * target.position_step;
                out.copy_from_slice(bytemuck::bytes_of(&[coefficient, coefficient * target.normal_ratio()]));
            }
            let active = weights.iter().filter(|w| **w != 0.0).count() as u32;
            // Fits 32 bits: checked in `new`.
            self.heads[i] = DirectHead { weights: (at + i * self.stride as usize) as u32, active };
        }
        Ok(())
    }

    /// Record draws of these instances; `captured` for one whose draw is captured.
    ///
    /// # Safety
    /// As [`super::super::MorphEngine::record_draws`]; `mesh` is the one that this was made with.
    pub(super) unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &MeshBuffers,
        instances: impl Iterator<Item = u32>,
        captured: bool,
    ) {
        let heads: Vec<DirectHead> = instances.map(|i| self.heads[i as usize]).collect();
        let buffers = buffers(mesh, (self.ring.raw, self.stride), self.poses);
        // SAFETY: the caller's obligations; the weights were written by `write`, since there is an update.
        unsafe { self.kernel.record(cmd, &buffers, &self.sets, &heads, captured) };
    }
}

/// Bytes of the weights that a draw reads: up to the last active target.
pub(super) fn bytes_read(weights: &[f32]) -> u64 {
    weights.iter().rposition(|w| *w != 0.0).map_or(0, |last| (WEIGHT_BYTES * (last + 1)) as u64)
}

fn buffers(mesh: &MeshBuffers, weights: (vk::Buffer, u64), pose: vk::Buffer) -> DirectBuffers<'_> {
    let deltas = (mesh.deltas.raw, delta_range(&mesh.layout));
    DirectBuffers { layout: &mesh.layout, base: mesh.base.raw, deltas, weights, pose }
}
