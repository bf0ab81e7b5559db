//! Lists that the host writes anew for each update: host-visible memory, a part for each frame in flight.

use super::descriptors::BufferRange;
use super::device::Device;
use super::memory::Buffer;
use crate::error::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// The parts, one after the other.
pub(crate) struct Ring {
    buffer: Buffer,
    /// Bytes of a part, a multiple of 256.
    part: u64,
}

impl Ring {
    /// Bytes of a part that holds `bytes`: not empty, and a multiple of the largest offset alignment of descriptors.
    pub(crate) fn part_bytes(bytes: u64) -> u64 {
        bytes.max(16).next_multiple_of(256)
    }

    /// `frames` parts of [`part_bytes`](Self::part_bytes).
    pub(crate) fn new(
        device: &Arc<Device>,
        name: &str,
        part: u64,
        frames: u32,
        usage: vk::BufferUsageFlags,
    ) -> Result<Self> {
        let bytes = part.saturating_mul(frames.into());
        let mut buffer = Buffer::new(device, name, bytes, usage, MemoryLocation::CpuToGpu)?;
        buffer.mapped()?;
        Ok(Self { buffer, part })
    }

    /// A frame's part. The update that used it last has finished: the contract of whoever records.
    ///
    /// # Errors
    /// Memory that is not mapped.
    pub(crate) fn words(&mut self, frame: u64) -> Result<&mut [u32]> {
        let (at, size) = ((frame * self.part) as usize, self.part as usize);
        Ok(bytemuck::cast_slice_mut(&mut self.buffer.mapped()?[at..at + size]))
    }

    /// What a descriptor of a frame's part covers.
    pub(crate) fn range(&self, frame: u64) -> BufferRange {
        BufferRange { buffer: self.buffer.raw, offset: frame * self.part, size: self.part }
    }
}
