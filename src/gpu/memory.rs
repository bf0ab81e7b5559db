//! Buffers: each with a name, a size that was checked, and memory that goes with it.

use super::device::{Device, allocation_failed};
use super::failed;
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;
use std::sync::Arc;

/// Where staging memory lies: in the host's memory. `CpuToGpu` prefers the small window of a graphics card's memory that the
/// host can write to, which lists that change every frame need more.
pub(crate) const STAGING: MemoryLocation = MemoryLocation::GpuToCpu;

/// A buffer and its memory. Dropped only when the device no longer uses it: the obligation of whoever drops
/// the mesh or crowd that owns it.
pub(crate) struct Buffer {
    device: Arc<Device>,
    pub(crate) raw: vk::Buffer,
    allocation: Option<Allocation>,
}

impl Buffer {
    /// A buffer of `bytes`; 0 is rounded up, since Vulkan has no empty buffers.
    pub(crate) fn new(
        device: &Arc<Device>,
        name: &str,
        bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Self> {
        let bytes = bytes.max(16);
        let most = device.caps.max_allocation.min(device.caps.max_buffer);
        if bytes > most {
            return Err(Error::invalid(
                format!("'{name}' needs {bytes} bytes, but {} allocates at most {most}", device.caps.name),
                "use fewer instances, fewer slots, a smaller mesh or the snorm16 format",
            ));
        }
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        // SAFETY: the device is alive (Device::borrow); size and usage are valid, sharing is exclusive.
        let raw = unsafe { device.raw.create_buffer(&info, None) }.map_err(failed("vkCreateBuffer"))?;
        // From here on dropping `buffer` destroys what there is of it.
        let mut buffer = Self { device: device.clone(), raw, allocation: None };
        let allocation = device.allocate(name, raw, location);
        let allocation = buffer.allocation.insert(allocation.map_err(|e| allocation_failed(name, bytes, &e))?);
        // SAFETY: the allocation was made for this buffer's requirements and is bound once.
        unsafe { device.raw.bind_buffer_memory(raw, allocation.memory(), allocation.offset()) }
            .map_err(failed("vkBindBufferMemory"))?;
        Ok(buffer)
    }

    /// Whether it was made on `device`.
    pub(crate) fn is_on(&self, device: &Arc<Device>) -> bool {
        Arc::ptr_eq(&self.device, device)
    }

    /// The buffer's bytes, for host-visible locations.
    ///
    /// # Errors
    /// A location that the device does not map.
    pub(crate) fn mapped(&mut self) -> Result<&mut [u8]> {
        self.allocation
            .as_mut()
            .and_then(Allocation::mapped_slice_mut)
            .ok_or_else(|| Error::invalid("a host-visible buffer was not mapped", "report this with the device's name"))
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: created in `new`, destroyed once, and no longer used by the device (see the type).
        unsafe { self.device.raw.destroy_buffer(self.raw, None) };
        // Not before: the allocator may be the host's, and hand the memory out again at once.
        if let Some(allocation) = self.allocation.take() {
            self.device.free(allocation);
        }
    }
}
