//! Record, submit, wait: one command buffer, one fence, three timestamps; and readback of buffers.

use super::load::Load;
use super::wait::{full_barrier, wait_idle};
use crate::gpu::device::Device;
use crate::gpu::memory::Buffer;
use crate::gpu::statistics::MemoryKind;
use deltamorph::ash::{self, vk};
use deltamorph::{Error, Result};
use std::cell::{Cell, OnceCell};
use std::sync::Arc;

/// Timestamps: before, between and after two parts, and before the load, if there is one.
const QUERIES: u32 = BEFORE_LOAD + 1;
const BEFORE_LOAD: u32 = 3;

/// Runs command buffers on a queue and waits for them. Queue, pool and fence are used through `&self` without a lock,
/// so it must not be shared between threads; the cell prevents that.
pub struct Submitter {
    pub device: ash::Device,
    /// The queue and its family.
    pub queue: (vk::Queue, u32),
    pool: vk::CommandPool,
    /// The command buffer that `run` records into; taken while `run` is recording, so that a nested `run` allocates
    /// another.
    cmd: Cell<Option<vk::CommandBuffer>>,
    fence: vk::Fence,
    /// Work before what is timed.
    pub load: OnceCell<Load>,
    queries: Option<vk::QueryPool>,
    /// Valid bits of a timestamp.
    mask: u64,
    /// Milliseconds per tick.
    tick: f64,
}

impl Submitter {
    /// Makes a submitter with timestamps of this many bits, in units of nanoseconds; without timestamps if either is 0.
    pub fn new(device: &ash::Device, family: u32, (timestamp_bits, nanoseconds): (u32, f32)) -> Result<Self> {
        let info = vk::CommandPoolCreateInfo::default()
            .queue_family_index(family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device is alive here and below, and has a queue of this family.
        let (queue, pool) = unsafe { (device.get_device_queue(family, 0), device.create_command_pool(&info, None)) };
        let pool = pool.map_err(Error::vulkan("vkCreateCommandPool"))?;
        let (cmd, fence) = (Cell::new(None), vk::Fence::null());
        let mask = u64::MAX.checked_shr(64 - timestamp_bits).unwrap_or(0);
        let (tick, queries) = (f64::from(nanoseconds) * 1e-6, None);
        let (queue, load) = ((queue, family), OnceCell::new());
        let mut this = Self { device: device.clone(), queue, pool, cmd, fence, load, queries, mask, tick };
        // SAFETY: as above.
        this.fence = unsafe { device.create_fence(&vk::FenceCreateInfo::default(), None) }
            .map_err(Error::vulkan("vkCreateFence"))?;
        if timestamp_bits > 0 && nanoseconds > 0.0 {
            let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(QUERIES);
            // SAFETY: as above; the queue family has timestamps.
            let queries =
                unsafe { device.create_query_pool(&info, None) }.map_err(Error::vulkan("vkCreateQueryPool"))?;
            this.queries = Some(queries);
        }
        Ok(this)
    }

    /// Allocates a further command buffer, freed by [`free`](Self::free) or with the submitter.
    pub fn allocate(&self) -> Result<vk::CommandBuffer> {
        let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        // SAFETY: the pool is ours.
        let made = unsafe { self.device.allocate_command_buffers(&info) };
        Ok(made.map_err(Error::vulkan("vkAllocateCommandBuffers"))?[0])
    }

    /// Frees allocated command buffers that have run.
    pub fn free(&self, cmds: &[vk::CommandBuffer]) {
        // SAFETY: they are of our pool, and not pending: `submit` has waited.
        unsafe { self.device.free_command_buffers(self.pool, cmds) };
    }

    /// Records a command buffer. Beginning resets it, unless it is still recording: a buffer left in that state by a
    /// panic is not used again.
    pub fn record<R>(&self, cmd: vk::CommandBuffer, f: impl FnOnce(vk::CommandBuffer) -> Result<R>) -> Result<R> {
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the buffer is from our pool, which allows resets, and is not pending: `submit` waits.
        unsafe { self.device.begin_command_buffer(cmd, &info) }.map_err(Error::vulkan("vkBeginCommandBuffer"))?;
        let result = f(cmd);
        // SAFETY: begun above.
        unsafe { self.device.end_command_buffer(cmd) }.map_err(Error::vulkan("vkEndCommandBuffer"))?;
        result
    }

    /// Submits and waits. After an error nothing has run, or the device is lost or cannot be waited for
    /// ([`wait_idle`]).
    pub fn submit(&self, cmds: &[vk::CommandBuffer]) -> Result<()> {
        let info = [vk::SubmitInfo::default().command_buffers(cmds)];
        // SAFETY: the buffers were recorded by us and are not pending; the fence is ours and in no queue.
        unsafe {
            self.device.reset_fences(&[self.fence]).map_err(Error::vulkan("vkResetFences"))?;
            self.device.queue_submit(self.queue.0, &info, self.fence).map_err(Error::vulkan("vkQueueSubmit"))?;
            match self.device.wait_for_fences(&[self.fence], true, u64::MAX) {
                Ok(()) => Ok(()),
                Err(lost @ vk::Result::ERROR_DEVICE_LOST) => Err(Error::vulkan("vkWaitForFences")(lost)),
                // A wait may run out of memory, but callers rely on all commands having finished.
                Err(_) => wait_idle(&self.device).map_err(Error::vulkan("vkDeviceWaitIdle")),
            }
        }
    }

    /// Records, submits and waits.
    pub fn run<R>(&self, f: impl FnOnce(vk::CommandBuffer) -> Result<R>) -> Result<R> {
        let cmd = self.cmd.take().map_or_else(|| self.allocate(), Ok)?;
        let recorded = self.record(cmd, f);
        if recorded.is_ok() {
            // After an error it may be pending, and is not used again.
            self.submit(&[cmd])?;
        }
        self.cmd.set(Some(cmd));
        recorded
    }

    /// [`run`](Self::run) that also returns device times in milliseconds, if the device has timestamps: of the commands
    /// that `f` records before it calls its second argument (at most once), and of those after.
    pub fn run_timed<R>(
        &self,
        f: impl FnOnce(vk::CommandBuffer, &dyn Fn()) -> Result<R>,
    ) -> Result<(R, [Option<f64>; 2])> {
        let result = self.run(|cmd| {
            if let Some(queries) = self.queries {
                // SAFETY: the buffer is recording; the query pool is ours and not in use.
                unsafe { self.device.cmd_reset_query_pool(cmd, queries, 0, QUERIES) };
            }
            if let Some(load) = self.load.get() {
                self.stamp(cmd, BEFORE_LOAD);
                load.record(cmd);
            }
            let written = Cell::new(0);
            let stamp = || self.stamp(cmd, written.replace(written.get() + 1));
            stamp();
            let result = f(cmd, &stamp)?;
            (written.get()..BEFORE_LOAD).for_each(|_| stamp());
            Ok(result)
        })?;
        let Some(queries) = self.queries else { return Ok((result, [None; 2])) };
        let mut at = [0u64; QUERIES as usize];
        let written = if self.load.get().is_some() { QUERIES } else { BEFORE_LOAD } as usize;
        // SAFETY: the queries were written by the commands that have finished.
        let read = unsafe {
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
            self.device.get_query_pool_results(queries, 0, &mut at[..written], flags)
        };
        // An error here would claim that nothing ran.
        let ms = |from, to| read.is_ok().then(|| self.ms(from, to));
        if let Some(load) = self.load.get() {
            load.end(ms(at[BEFORE_LOAD as usize], at[0]).unwrap_or(0.0));
        }
        Ok((result, [ms(at[0], at[1]), ms(at[1], at[2])]))
    }

    /// Milliseconds from one timestamp to another.
    fn ms(&self, from: u64, to: u64) -> f64 {
        (to.wrapping_sub(from) & self.mask) as f64 * self.tick
    }

    /// Writes a timestamp after all earlier commands have finished and before any later one begins.
    fn stamp(&self, cmd: vk::CommandBuffer, query: u32) {
        let Some(queries) = self.queries else { return };
        // SAFETY: the buffer is recording; the query pool is ours and was reset in it.
        unsafe { self.device.cmd_write_timestamp(cmd, vk::PipelineStageFlags::BOTTOM_OF_PIPE, queries, query) };
        // Without this barrier Mesa 22.3.6 (lavapipe) excludes the first feedback pass from the time.
        full_barrier(&self.device, cmd, vk::PipelineStageFlags::ALL_COMMANDS);
    }
}

impl Drop for Submitter {
    fn drop(&mut self) {
        // SAFETY: made in `new`, destroyed once; nothing is pending, since every submit waits (on a lost device the
        // wait fails at once, and destroying is allowed).
        unsafe {
            let _ = wait_idle(&self.device);
            if let Some(queries) = self.queries {
                self.device.destroy_query_pool(queries, None);
            }
            self.device.destroy_fence(self.fence, None);
            self.device.destroy_command_pool(self.pool, None);
        }
    }
}

/// Host memory that device buffers are copied to.
pub struct Readback {
    buffer: Buffer,
    bytes: u64,
}

impl Readback {
    /// Makes memory for `bytes` bytes, a multiple of 4 (≥ 4).
    pub fn new(device: &Arc<Device>, bytes: u64) -> Result<Self> {
        let (usage, kind) = (vk::BufferUsageFlags::TRANSFER_DST, MemoryKind::Readback);
        Ok(Self { buffer: Buffer::new(device, "readback", bytes, usage, kind)?, bytes })
    }

    /// Reads `size` bytes of `buffer`, which is not in use, from `offset` on.
    pub fn read<T: bytemuck::Pod>(
        &mut self,
        submitter: &Submitter,
        (buffer, offset, size): (vk::Buffer, u64, u64),
    ) -> Result<Vec<T>> {
        let (device, mut words) = (&submitter.device, vec![]);
        for at in (0..size).step_by(self.bytes as usize) {
            let here = self.bytes.min(size - at);
            let region = [vk::BufferCopy { src_offset: offset + at, dst_offset: 0, size: here }];
            submitter.run(|cmd| {
                full_barrier(device, cmd, vk::PipelineStageFlags::TRANSFER);
                // SAFETY: the buffer is recording; the region lies within both buffers, which are alive.
                unsafe { device.cmd_copy_buffer(cmd, buffer, self.buffer.raw, &region) };
                // A fence does not make writes visible to the host.
                full_barrier(device, cmd, vk::PipelineStageFlags::HOST);
                Ok(())
            })?;
            let bytes = &self.buffer.mapped()?[..here as usize];
            words.extend(bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned::<T>));
        }
        Ok(words)
    }
}
