//! Memory of buffers and images: from an allocator, or from functions of the host's.

use super::statistics::MemoryKind;
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;
use std::ffi::c_void;
use std::ptr::null_mut;

/// What memory a [`MemorySource`] is asked for: that of one buffer.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct MemoryRequest {
    /// Bytes.
    pub size: u64,
    /// The offset is a multiple of it.
    pub alignment: u64,
    /// The types of memory that will do, as bits (`VkMemoryRequirements::memoryTypeBits`).
    pub type_bits: u32,
    /// Properties that the memory has to have: HOST_VISIBLE and HOST_COHERENT where the host reads or writes, or none.
    pub required: vk::MemoryPropertyFlags,
    /// Properties that make updates faster.
    pub preferred: vk::MemoryPropertyFlags,
}

/// Memory of the host's for one buffer.
#[derive(Clone, Copy, Debug)]
pub struct HostMemory {
    /// The handle.
    pub memory: vk::DeviceMemory,
    /// Offset of the first byte.
    pub offset: u64,
    /// Where the first byte is mapped; null where HOST_VISIBLE was not required. It stays mapped.
    pub mapped: *mut c_void,
    /// Anything that tells [`MemorySource::free`] what to give back.
    pub token: u64,
}

impl HostMemory {
    /// A whole allocation that is not mapped.
    pub fn new(memory: vk::DeviceMemory) -> Self {
        Self { memory, offset: 0, mapped: null_mut(), token: 0 }
    }
}

/// Device memory from the host, which the engine takes for each buffer in place of an allocator's. Called from the
/// threads that make and drop objects of the engine, also from several at once, and only within their calls; it calls
/// nothing of the engine.
///
/// # Safety
/// Memory that `allocate` returns meets the request, is on the engine's device (with
/// [`buffer_device_address`](crate::DeviceDesc::buffer_device_address), allocated for it), and overlaps no other
/// until `free` was called with it.
pub unsafe trait MemorySource: Send + Sync {
    /// Allocates memory.
    ///
    /// # Errors
    /// ERROR_OUT_OF_DEVICE_MEMORY and ERROR_OUT_OF_HOST_MEMORY, or any other result, which is reported as that of
    /// vkAllocateMemory.
    fn allocate(&self, request: &MemoryRequest) -> Result<HostMemory, vk::Result>;

    /// Takes memory back, which the device no longer uses.
    fn free(&self, memory: HostMemory);
}

/// Memory of a buffer or an image.
pub struct Memory {
    pub(super) kind: MemoryKind,
    pub(super) bytes: u64,
    pub(super) source: Source,
}

pub(super) enum Source {
    Allocator(Allocation),
    Host(HostMemory),
}

// SAFETY: what is mapped belongs to this value, and is written through `&mut` only.
unsafe impl Send for Memory {}
// SAFETY: as above.
unsafe impl Sync for Memory {}

impl Memory {
    /// Its handle, and the offset in it.
    pub fn place(&self) -> (vk::DeviceMemory, u64) {
        match &self.source {
            // SAFETY: the handle is bound, and freed by the allocator alone.
            Source::Allocator(allocation) => (unsafe { allocation.memory() }, allocation.offset()),
            Source::Host(HostMemory { memory, offset, .. }) => (*memory, *offset),
        }
    }

    /// The mapped bytes, if it is mapped.
    pub(super) fn mapped(&mut self) -> Option<&mut [u8]> {
        match &mut self.source {
            Source::Allocator(allocation) => allocation.mapped_slice_mut(),
            Source::Host(HostMemory { mapped, .. }) if mapped.is_null() => None,
            Source::Host(HostMemory { mapped, .. }) => {
                // SAFETY: as many bytes are mapped there, says the host, and belong to this value.
                Some(unsafe { std::slice::from_raw_parts_mut(mapped.cast(), self.bytes as usize) })
            }
        }
    }
}

/// The properties of memory at a location: required ones, and preferred ones.
pub(super) fn properties(location: MemoryLocation) -> (vk::MemoryPropertyFlags, vk::MemoryPropertyFlags) {
    use vk::MemoryPropertyFlags as P;
    let written = P::HOST_VISIBLE | P::HOST_COHERENT;
    match location {
        MemoryLocation::CpuToGpu => (written, P::DEVICE_LOCAL),
        MemoryLocation::GpuToCpu => (written, P::HOST_CACHED),
        MemoryLocation::GpuOnly | MemoryLocation::Unknown => (P::empty(), P::DEVICE_LOCAL),
    }
}
