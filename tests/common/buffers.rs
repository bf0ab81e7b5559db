//! Buffers of a host, in memory that host and device share.

use crate::prelude::*;
use deltamorph::internals::gpu::memory::Buffer;
use deltamorph::internals::gpu::statistics::MemoryKind;
use std::cell::RefCell;

/// A buffer, as one of [`Buffers`].
#[derive(Clone, Copy)]
pub struct Shared {
    pub buffer: vk::Buffer,
    index: usize,
    bytes: usize,
}

/// A scope of a barrier: all accesses on the device.
const ALL: (vk::PipelineStageFlags, vk::AccessFlags) = (
    vk::PipelineStageFlags::ALL_COMMANDS,
    vk::AccessFlags::from_raw(vk::AccessFlags::MEMORY_READ.as_raw() | vk::AccessFlags::MEMORY_WRITE.as_raw()),
);

/// Buffers that are destroyed together.
pub struct Buffers<'a> {
    headless: &'a Headless,
    pub device: &'a ash::Device,
    all: RefCell<Vec<Buffer>>,
}

impl<'a> Buffers<'a> {
    pub fn new(headless: &'a Headless) -> Self {
        Self { headless, device: headless.handles().2, all: RefCell::default() }
    }

    /// Makes a buffer of `bytes` bytes, for all that tests do with one.
    pub fn shared(&self, bytes: usize) -> Shared {
        use vk::BufferUsageFlags as Usage;
        let copies = Usage::TRANSFER_SRC | Usage::TRANSFER_DST;
        let usage = Usage::STORAGE_BUFFER | Usage::VERTEX_BUFFER | copies;
        let device = self.headless.engine().device();
        let made = Buffer::new(device, "a buffer of the host's", bytes as u64, usage, MemoryKind::Readback);
        let (made, mut all) = (made.expect("a buffer"), self.all.borrow_mut());
        let shared = Shared { buffer: made.raw, index: all.len(), bytes };
        all.push(made);
        shared
    }

    /// Records `f` after all memory accesses before and before all after, and waits.
    fn alone(&self, to: (vk::PipelineStageFlags, vk::AccessFlags), f: impl FnOnce(vk::CommandBuffer)) {
        let done = self.headless.run(|cmd| {
            self.barrier(cmd, ALL, ALL);
            f(cmd);
            self.barrier(cmd, ALL, to);
            Ok(())
        });
        done.expect("a device that works");
    }

    /// Fills `shared` with a word.
    pub fn fill(&self, shared: &Shared, word: u32) {
        // SAFETY: `cmd` is recording; the buffer is alive.
        self.alone(ALL, |cmd| unsafe { self.device.cmd_fill_buffer(cmd, shared.buffer, 0, vk::WHOLE_SIZE, word) });
    }

    /// Writes numbers into `shared`.
    pub fn write(&self, shared: &Shared, offset: u64, numbers: &[f32]) {
        let bytes = bytemuck::cast_slice(numbers);
        // SAFETY: as above; there is room for as much.
        self.alone(ALL, |cmd| unsafe { self.device.cmd_update_buffer(cmd, shared.buffer, offset, bytes) });
    }

    /// Returns the contents of `shared`, after all work before.
    pub fn contents<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(&self, shared: &Shared) -> Vec<T> {
        self.alone((vk::PipelineStageFlags::HOST, vk::AccessFlags::HOST_READ), |_| ());
        let mut all = self.all.borrow_mut();
        let bytes = all[shared.index].mapped().expect("mapped");
        bytes[..shared.bytes].chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
    }

    /// Records a memory barrier.
    pub fn barrier(
        &self,
        cmd: vk::CommandBuffer,
        from: (vk::PipelineStageFlags, vk::AccessFlags),
        to: (vk::PipelineStageFlags, vk::AccessFlags),
    ) {
        let memory = [vk::MemoryBarrier::default().src_access_mask(from.1).dst_access_mask(to.1)];
        // SAFETY: `cmd` is recording outside a render pass.
        unsafe { self.device.cmd_pipeline_barrier(cmd, from.0, to.0, Default::default(), &memory, &[], &[]) };
    }
}
