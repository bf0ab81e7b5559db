//! Buffers of a host, in memory that host and device share.

use deltamorph::ash::{self, vk};
use deltamorph::internals::gpu::memory::Buffer;
use deltamorph::internals::gpu::statistics::MemoryKind;
use deltamorph_headless::Headless;
use std::cell::RefCell;

/// A buffer, as one of [`Buffers`].
#[derive(Clone, Copy)]
pub struct Shared {
    pub buffer: vk::Buffer,
    index: usize,
    bytes: usize,
}

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

    /// Returns the contents of `shared`, whose writes have finished.
    pub fn contents<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(&self, shared: &Shared) -> Vec<T> {
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
