//! Buffers of the device, read by the host.

use super::Headless;
use super::submit::full_barrier;
use crate::error::Result;
use crate::gpu::memory::Buffer;
use ash::vk;
use gpu_allocator::MemoryLocation;

/// Where the host reads what was copied from elsewhere.
pub(super) struct Readback {
    buffer: Buffer,
    bytes: u64,
}

impl Readback {
    /// Room for so many bytes at once, a multiple of 4 (≥ 4).
    pub(super) fn new(headless: &Headless, bytes: u64) -> Result<Self> {
        let (usage, location) = (vk::BufferUsageFlags::TRANSFER_DST, MemoryLocation::GpuToCpu);
        Ok(Self { buffer: Buffer::new(&headless.engine.device, "readback", bytes, usage, location)?, bytes })
    }

    /// `size` bytes of `buffer` from `offset` on, which are there and not in use, as words.
    pub(super) fn read<T: bytemuck::Pod>(
        &mut self,
        headless: &Headless,
        (buffer, offset, size): (vk::Buffer, u64, u64),
    ) -> Result<Vec<T>> {
        let (submitter, device) = (&headless.submitter, &headless.submitter.device);
        let mut words = vec![];
        for at in (0..size).step_by(self.bytes as usize) {
            let here = self.bytes.min(size - at);
            let region = [vk::BufferCopy { src_offset: offset + at, dst_offset: 0, size: here }];
            submitter.run(|cmd| {
                full_barrier(device, cmd);
                // SAFETY: the buffer is recording; the region lies within both buffers, which are alive.
                unsafe { device.cmd_copy_buffer(cmd, buffer, self.buffer.raw, &region) };
                host_barrier(device, cmd);
                Ok(())
            })?;
            let bytes = &self.buffer.mapped()?[..here as usize];
            words.extend(bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned::<T>));
        }
        Ok(words)
    }
}

/// What copies wrote, to the host: a fence makes nothing visible to it.
fn host_barrier(device: &ash::Device, cmd: vk::CommandBuffer) {
    let memory = [vk::MemoryBarrier::default()
        .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
        .dst_access_mask(vk::AccessFlags::HOST_READ)];
    let (from, to) = (vk::PipelineStageFlags::TRANSFER, vk::PipelineStageFlags::HOST);
    // SAFETY: as in `full_barrier`.
    unsafe { device.cmd_pipeline_barrier(cmd, from, to, vk::DependencyFlags::empty(), &memory, &[], &[]) };
}
