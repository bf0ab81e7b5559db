//! The bandwidth of the device's memory, the ceiling that measured rows are compared with, and work that keeps a GPU's
//! clocks up.

use super::Headless;
use super::submit::full_barrier;
use deltamorph::ash::vk;
use deltamorph::internals::abi::modules::READ;
use deltamorph::internals::abi::numbers::WORKGROUP;
use deltamorph::internals::abi::push::ReadPush;
use deltamorph::internals::gpu::descriptors::{BufferRange, Sets};
use deltamorph::internals::gpu::device::Device;
use deltamorph::internals::gpu::memory::Buffer;
use deltamorph::internals::gpu::pipelines::{Objects, Workgroups};
use deltamorph::internals::gpu::statistics::MemoryKind;
use deltamorph::{Error, Result};
use std::cell::Cell;
use std::sync::Arc;
use std::time::{Duration, Instant};

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
struct Reading {
    objects: Objects,
    sets: Sets,
    from: Buffer,
    to: Buffer,
    bytes: u64,
}

impl Reading {
    fn new(device: &Arc<Device>, bytes: u64) -> Result<Self> {
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
        Ok(Self { objects, sets, from, to, bytes })
    }

    /// Records the first write of the buffer.
    fn fill(&self, cmd: vk::CommandBuffer) {
        let device = &self.objects.device.raw;
        // SAFETY: recording; the fill covers the buffer.
        unsafe { device.cmd_fill_buffer(cmd, self.from.raw, 0, self.bytes, 0x3f7f_1234) };
        full_barrier(device, cmd, vk::PipelineStageFlags::ALL_COMMANDS);
    }

    fn read(&self, cmd: vk::CommandBuffer) {
        let push = ReadPush { count: (self.bytes / 16) as u32, stride: INVOCATIONS };
        let workgroups = Workgroups::Of([INVOCATIONS / WORKGROUP, 1]);
        // SAFETY: recording; pipeline, layout and set are ours and fit each other (tests/project/spirv.rs).
        unsafe { self.objects.dispatch(cmd, 0, (self.sets.get(0), &[]), bytemuck::bytes_of(&push), workgroups) };
    }
}

/// Work that runs before what is timed; see [`Headless::keep_clocks_up`].
pub(super) struct Load {
    reading: Reading,
    /// Duration of a pass.
    pass: Duration,
    /// When what was timed last had ended.
    ended: Cell<Instant>,
    /// Milliseconds of the load before it: recording and running.
    pub(super) ms: Cell<f64>,
}

/// Of the load: what remains in the caches of a GPU, beside what is timed.
const LOAD_BYTES: u64 = 4 << 20;
/// How long a GPU that was idle takes to raise its clocks, and more.
const SETTLING: Duration = Duration::from_millis(300);
/// The shortest load.
const LEAST: Duration = Duration::from_millis(2);

impl Load {
    /// Records work for half as long as the device had none.
    pub(super) fn record(&self, cmd: vk::CommandBuffer) {
        let begun = Instant::now();
        let time = (self.ended.get().elapsed() / 2).clamp(LEAST, SETTLING);
        let passes = time.as_nanos().div_ceil(self.pass.as_nanos().max(1));
        (0..passes).for_each(|_| self.reading.read(cmd));
        full_barrier(&self.reading.objects.device.raw, cmd, vk::PipelineStageFlags::ALL_COMMANDS);
        self.ms.set(begun.elapsed().as_secs_f64() * 1e3);
    }

    /// Ends what was timed; `ms`: how long the device worked before.
    pub(super) fn end(&self, ms: f64) {
        self.ms.set(self.ms.get() + ms);
        self.ended.set(Instant::now());
    }
}

impl Headless {
    /// From now on lets the device work before each timed submission, for half as long as it was idle. A GPU lowers its
    /// clocks between frames that leave it idle, to a sixth of their rate, and what it is timed at then depends on how
    /// long the host took. Software drivers have no clocks of their own.
    ///
    /// # Errors
    /// Out of memory; the device fails.
    pub fn keep_clocks_up(&self) -> Result<()> {
        const PASSES: u32 = 100;
        if self.caps().is_software() || self.submitter.load.get().is_some() {
            return Ok(());
        }
        let reading = Reading::new(self.engine.device(), LOAD_BYTES)?;
        self.submitter.run(|cmd| {
            reading.fill(cmd);
            Ok(())
        })?;
        let (begun, mut pass) = (Instant::now(), Duration::MAX);
        while begun.elapsed() < SETTLING {
            let start = Instant::now();
            self.submitter.run(|cmd| {
                (0..PASSES).for_each(|_| reading.read(cmd));
                Ok(())
            })?;
            pass = pass.min(start.elapsed() / PASSES);
        }
        let load = Load { reading, pass, ended: Cell::new(Instant::now()), ms: Cell::new(0.0) };
        self.submitter.load.set(load).map_err(|_| Error::invalid("a second load", "call keep_clocks_up once"))
    }

    /// Measures copy and read bandwidth over `bytes` (a multiple of 16, within the device's limits): the best of a few
    /// runs; `None` on a device without timestamps.
    ///
    /// # Errors
    /// Out of memory; the device fails.
    pub fn bandwidth(&self, bytes: u64) -> Result<Option<Bandwidth>> {
        let device = self.engine.device();
        let most = self.caps().max_storage_range.min(self.caps().max_allocation);
        let bytes = bytes.clamp(16, most) & !15;
        let reading = Reading::new(device, bytes)?;
        let (device, submitter) = (&device.raw, &self.submitter);
        let region = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes }];
        submitter.run(|cmd| {
            reading.fill(cmd);
            Ok(())
        })?;
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
