//! Buffers: each with a name, a size that was checked, and memory that goes with it.

use super::device::{Device, allocation_failed};
use super::failed;
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::sync::Arc;

/// How to make a [`Buffer`].
pub(crate) struct BufferDesc<'a> {
    pub(crate) name: &'a str,
    /// 0 is rounded up: Vulkan has no empty buffers.
    pub(crate) bytes: u64,
    pub(crate) usage: vk::BufferUsageFlags,
    pub(crate) location: MemoryLocation,
}

/// A buffer and its memory. Dropped only when the device no longer uses it: the obligation of whoever drops
/// the mesh or crowd that owns it.
pub(crate) struct Buffer {
    device: Arc<Device>,
    pub(crate) raw: vk::Buffer,
    allocation: Option<Allocation>,
}

impl Buffer {
    pub(crate) fn new(device: &Arc<Device>, desc: &BufferDesc<'_>) -> Result<Self> {
        let bytes = desc.bytes.max(16);
        if bytes > device.caps.max_allocation {
            return Err(Error::invalid(
                format!(
                    "'{}' needs {bytes} bytes, but {} allocates at most {}",
                    desc.name, device.caps.name, device.caps.max_allocation
                ),
                "use fewer instances, fewer slots, a smaller mesh or the snorm16 format",
            ));
        }
        let info = vk::BufferCreateInfo::default().size(bytes).usage(desc.usage);
        // SAFETY: the device is alive (Device::borrow); size and usage are valid, sharing is exclusive.
        let raw = unsafe { device.raw.create_buffer(&info, None) }.map_err(failed("vkCreateBuffer"))?;
        // From here on dropping `buffer` destroys what there is of it.
        let mut buffer = Self { device: device.clone(), raw, allocation: None };
        // SAFETY: `raw` was created on this device just now.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(raw) };
        let allocation = device
            .allocator()
            .allocate(&AllocationCreateDesc {
                name: desc.name,
                requirements,
                location: desc.location,
                linear: true,
                allocation_scheme: AllocationScheme::GpuAllocatorManaged,
            })
            .map_err(|e| allocation_failed(desc.name, bytes, &e))?;
        let allocation = buffer.allocation.insert(allocation);
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
        if let Some(allocation) = self.allocation.take() {
            // An error here means that the allocator lost track of it; there is nobody to tell.
            let _ = self.device.allocator().free(allocation);
        }
        // SAFETY: created in `new`, destroyed once, and no longer used by the device (see the type).
        unsafe { self.device.raw.destroy_buffer(self.raw, None) };
    }
}
