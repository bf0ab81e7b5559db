//! Device memory from functions of the host's.

use crate::structs::{DmHostMemory, DmMemoryRequest};
use deltamorph::ash::vk;
use deltamorph::memory::{HostMemory, MemoryRequest, MemorySource};
use std::ffi::c_void;

/// The host's functions, and what they are called with.
pub struct Functions {
    pub(crate) allocate: unsafe extern "C" fn(*mut c_void, *const DmMemoryRequest, *mut DmHostMemory) -> i32,
    pub(crate) free: unsafe extern "C" fn(*mut c_void, *const DmHostMemory),
    pub(crate) user: *mut c_void,
}

// SAFETY: the host promised that any thread may call its functions with `user`, also several at once.
unsafe impl Send for Functions {}
// SAFETY: as above.
unsafe impl Sync for Functions {}

// SAFETY: the host promised that its functions hand out memory as the trait requires.
unsafe impl MemorySource for Functions {
    fn allocate(&self, request: &MemoryRequest) -> Result<HostMemory, vk::Result> {
        let asked = DmMemoryRequest {
            size: request.size,
            alignment: request.alignment,
            type_bits: request.type_bits,
            required: request.required.as_raw(),
            preferred: request.preferred.as_raw(),
            reserved: 0,
        };
        let memory = vk::DeviceMemory::null();
        let mut found = DmHostMemory { memory, offset: 0, mapped: std::ptr::null_mut(), token: 0 };
        // SAFETY: the host promised that this pointer is a function of this signature, callable with these arguments.
        vk::Result::from_raw(unsafe { (self.allocate)(self.user, &raw const asked, &raw mut found) }).result()?;
        let DmHostMemory { memory, offset, mapped, token } = found;
        Ok(HostMemory { offset, mapped, token, ..HostMemory::new(memory) })
    }

    fn free(&self, HostMemory { memory, offset, mapped, token, .. }: HostMemory) {
        let given = DmHostMemory { memory, offset, mapped, token };
        // SAFETY: as above; the memory is what `allocate` returned.
        unsafe { (self.free)(self.user, &raw const given) };
    }
}
