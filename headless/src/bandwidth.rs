//! The bandwidth of the device's memory, the ceiling that measured rows are compared with.

use super::Headless;
use super::wait::full_barrier;
use crate::abi::modules::READ;
use crate::abi::numbers::WORKGROUP;
use crate::abi::push::ReadPush;
use crate::gpu::descriptors::{BufferRange, Sets};
use crate::gpu::memory::Buffer;
use crate::gpu::pipelines::{Objects, Workgroups};
use crate::gpu::statistics::MemoryKind;
use deltamorph::Result;
use deltamorph::ash::vk;

/// Bandwidth in GB/s (10⁹ bytes).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bandwidth {
    /// A buffer copy; bytes read plus bytes written.
    pub copy: f64,
    /// A compute pass that reads a buffer.
    pub read: f64,
}

/// Invocations of the reading pass: enough to fill a GPU, few enough that each reads a long run.
const INVOCATIONS: u32 = 256 * 1024;

/// A compute pass that reads a buffer, and another buffer.
pub struct Reading {
    pub objects: Objects,
    sets: Sets,
    from: Buffer,
    to: Buffer,
    bytes: u64,
}

impl Reading {
    /// Makes the buffers, of which the first is written.
    pub fn new(headless: &Headless, bytes: u64) -> Result<Self> {
        let device = headless.engine.device();
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        let buffer = |name| Buffer::new(device, name, bytes, usage, MemoryKind::Poses);
        let (from, to) = (buffer("bandwidth source")?, buffer("bandwidth target")?);
        let mut objects = Objects::none(device);
        objects.add_layout(&[READ.kernel], 0)?;
        objects.add_compute(READ, &[&[]])?;
        let bound = [&from, &to].map(|buffer| BufferRange::new(buffer.raw, 0, bytes));
        let sets = objects.sets(&[bound])?;
        headless.submitter.run(|cmd| {
            // SAFETY: recording; the fill covers the buffer.
            unsafe { device.raw.cmd_fill_buffer(cmd, from.raw, 0, bytes, 0x3f7f_1234) };
            full_barrier(&device.raw, cmd, vk::PipelineStageFlags::ALL_COMMANDS);
            Ok(())
        })?;
        Ok(Self { objects, sets, from, to, bytes })
    }

    /// Records the pass.
    pub fn read(&self, cmd: vk::CommandBuffer) {
        let push = ReadPush { count: (self.bytes / 16) as u32, stride: INVOCATIONS };
        let workgroups = Workgroups::Of([INVOCATIONS / WORKGROUP, 1]);
        // SAFETY: recording; pipeline, layout and set are ours and fit each other.
        unsafe { self.objects.dispatch(cmd, 0, (self.sets.get(0), &[]), bytemuck::bytes_of(&push), workgroups) };
    }
}

impl Headless {
    /// Measures copy and read bandwidth over `bytes` (a multiple of 16, within the device's limits): the best of a few
    /// runs; `None` on a device without timestamps.
    ///
    /// # Errors
    /// Out of memory; the device fails.
    pub fn bandwidth(&self, bytes: u64) -> Result<Option<Bandwidth>> {
        let most = self.caps().max_storage_range.min(self.caps().max_allocation);
        let bytes = bytes.clamp(16, most) & !15;
        let reading = Reading::new(self, bytes)?;
        let (device, submitter) = (&self.engine.device().raw, &self.submitter);
        let region = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes }];
        let mut best = [f64::INFINITY; 2];
        for _ in 0..6 {
            let ((), [copy, read]) = submitter.run_timed(|cmd, next_part| {
                // SAFETY: recording; the region lies within both buffers.
                unsafe { device.cmd_copy_buffer(cmd, reading.from.raw, reading.to.raw, &region) };
                next_part();
                reading.read(cmd);
                Ok(())
            })?;
            let (Some(copy), Some(read)) = (copy, read) else { return Ok(None) };
            best = [best[0].min(copy), best[1].min(read)];
        }
        // No less than a tick, in nanoseconds.
        let rate = |bytes: u64, ms: f64| bytes as f64 / (ms * 1e6).max(self.caps().timestamp_period.into());
        Ok(Some(Bandwidth { copy: rate(2 * bytes, best[0]), read: rate(bytes, best[1]) }))
    }
}
