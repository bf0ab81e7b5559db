//! Buffers, each with a name, a checked size and its memory; and rings of lists that the host writes.

use super::allocation::Memory;
use super::descriptors::BufferRange;
use super::device::Device;
use super::statistics::MemoryKind;
use crate::error::{Error, Result, ensure};
use ash::vk::{self, BufferUsageFlags};
use gpu_allocator::vulkan::AllocationScheme;
use std::sync::Arc;

/// A buffer and its memory. The owner of its mesh or crowd must drop it only when the device no longer uses it.
pub struct Buffer {
    device: Arc<Device>,
    /// The handle.
    pub raw: vk::Buffer,
    memory: Option<Memory>,
}

impl Buffer {
    /// Makes a buffer of `bytes`; 0 is rounded up, since Vulkan has no empty buffers.
    pub fn new(
        device: &Arc<Device>,
        name: &str,
        bytes: u64,
        usage: BufferUsageFlags,
        kind: MemoryKind,
    ) -> Result<Self> {
        let bytes = bytes.max(16);
        let most = device.caps.max_allocation.min(device.caps.max_buffer);
        let what = format!("{name} needs {bytes} bytes, but {} allocates at most {most}", device.caps.name);
        let remedy = "use fewer instances, slots or frames in flight, 16-bit poses (fixed16), or a smaller mesh";
        ensure!(bytes <= most, what, remedy);
        let info = vk::BufferCreateInfo { size: bytes, usage, ..shared_by(&device.families) };
        // SAFETY: the device is alive (Device::borrow); size and usage are valid, and the families are the device's.
        let raw = unsafe { device.raw.create_buffer(&info, None) }.map_err(Error::vulkan("vkCreateBuffer"))?;
        device.name(raw, || name.to_owned());
        // From here on, dropping `buffer` destroys everything that was made.
        let mut buffer = Self { device: device.clone(), raw, memory: None };
        // SAFETY: created just now.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(raw) };
        let own = AllocationScheme::DedicatedBuffer(raw);
        let (memory, offset) = buffer.memory.insert(device.allocate(kind, name, requirements, own)?).place();
        // SAFETY: the memory was allocated for this buffer's requirements and is bound once.
        unsafe { device.raw.bind_buffer_memory(raw, memory, offset) }.map_err(Error::vulkan("vkBindBufferMemory"))?;
        Ok(buffer)
    }

    /// Memory that the host writes and copies read.
    pub fn staging(device: &Arc<Device>, name: &str, bytes: u64) -> Result<Self> {
        Self::new(device, name, bytes, BufferUsageFlags::TRANSFER_SRC, MemoryKind::Staging)
    }

    /// Whether it was made on `device`.
    pub fn is_on(&self, device: &Arc<Device>) -> bool {
        Arc::ptr_eq(&self.device, device)
    }

    /// Returns the buffer's bytes, for host-visible locations.
    pub fn mapped(&mut self) -> Result<&mut [u8]> {
        self.memory
            .as_mut()
            .and_then(Memory::mapped)
            .ok_or_else(|| Error::invalid("a host-visible buffer was not mapped", "report this with the device's name"))
    }
}

/// Returns the sharing mode for memory used by queues of these families, each named once: concurrent if there are
/// several. That includes buffers used by one queue only, so that the host may move updates to another queue.
pub fn sharing(families: &[u32]) -> (vk::SharingMode, &[u32]) {
    match families {
        [] | [_] => (vk::SharingMode::EXCLUSIVE, &[]),
        _ => (vk::SharingMode::CONCURRENT, families),
    }
}

fn shared_by(families: &[u32]) -> vk::BufferCreateInfo<'_> {
    let (mode, families) = sharing(families);
    vk::BufferCreateInfo::default().sharing_mode(mode).queue_family_indices(families)
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: created in `new`, destroyed once, and no longer used by the device (see the type).
        unsafe { self.device.raw.destroy_buffer(self.raw, None) };
        // Freed last: the allocator may be the host's, and reuse the memory at once.
        if let Some(memory) = self.memory.take() {
            self.device.free(memory);
        }
    }
}

/// Lists that the host rewrites for each update: host-visible memory, with a part for each frame in flight.
pub struct Ring {
    buffer: Buffer,
    /// Bytes of a part, a multiple of 256.
    part: u64,
}

impl Ring {
    /// Bytes of a part that holds `bytes`: not empty, and a multiple of the largest offset alignment of descriptors.
    pub fn part_bytes(bytes: u64) -> u64 {
        bytes.max(16).next_multiple_of(256)
    }

    /// `frames` parts of [`part_bytes`](Self::part_bytes).
    pub fn new(device: &Arc<Device>, name: &str, part: u64, frames: u32, usage: BufferUsageFlags) -> Result<Self> {
        let bytes = part.saturating_mul(frames.into());
        let mut buffer = Buffer::new(device, name, bytes, usage, MemoryKind::Lists)?;
        buffer.mapped()?;
        Ok(Self { buffer, part })
    }

    /// Returns a frame's part. The caller guarantees that the last update that used it has finished.
    pub fn words(&mut self, frame: u64) -> Result<&mut [u32]> {
        let at = (frame * self.part) as usize;
        let size = self.part as usize;
        Ok(bytemuck::cast_slice_mut(&mut self.buffer.mapped()?[at..at + size]))
    }

    /// Returns the range of a frame's part for a descriptor.
    pub fn range(&self, frame: u64) -> BufferRange {
        BufferRange { buffer: self.buffer.raw, offset: frame * self.part, size: self.part }
    }
}

#[cfg(test)]
mod tests {
    use super::super::device::distinct;
    use super::*;

    /// Drivers that run on the CPU have one family, so the use of several families is checked here.
    #[test]
    fn buffers_are_concurrent_where_several_families_use_them() {
        for (named, shared) in
            [(&[][..], &[][..]), (&[0], &[]), (&[2, 2], &[]), (&[2, 0, 2], &[0, 2]), (&[1, 0], &[0, 1])]
        {
            let families = distinct(named);
            let info = shared_by(&families);
            let mode = if shared.is_empty() { vk::SharingMode::EXCLUSIVE } else { vk::SharingMode::CONCURRENT };
            assert_eq!((info.sharing_mode, info.queue_family_index_count as usize), (mode, shared.len()), "{named:?}");
            assert!(shared.is_empty() || families == shared, "{named:?}: {families:?}");
        }
    }
}
