//! What tests that link this crate do with it.

use crate::layer::find;
use crate::state::{Next, state};
use ash::vk::{self, Handle as _};
use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::ffi::{CStr, c_void};
use std::path::Path;
use std::process::Command;

/// The layer's name.
const NAME: &str = "VK_LAYER_deltamorph_failing";

/// What has happened on devices so far.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// Calls that failed since the last [`arm`].
    pub failed: u64,
    /// The name of the last of them.
    pub call: String,
    /// Destroyed handles that were not alive.
    pub unknown: u64,
    /// Live objects, without instances, devices, command buffers and descriptor sets.
    pub alive: u64,
}

/// Returns a device whose calls may fail, in this process and without the loader.
///
/// # Safety
/// The device is of this instance, and outlives the returned one. Objects that one of the two has made are destroyed
/// through it.
pub unsafe fn device(instance: &ash::Instance, device: vk::Device) -> ash::Device {
    let next = Next::Device(device, instance.fp_v1_0().get_device_proc_addr);
    let load = |name: &CStr| {
        // SAFETY: the device is alive.
        unsafe { find(device.as_raw(), name.as_ptr()) }.map_or(std::ptr::null(), |found| found as *const c_void)
    };
    // SAFETY: the caller's obligation; the functions found have the types of their names.
    unsafe {
        state().made(device.as_raw(), next);
        ash::Device::load_with(load, device)
    }
}

/// Sets the failure `CALL:N:ERROR`, counted from now; an empty text sets none.
pub fn arm(plan: &str) {
    state().arm(plan);
}

/// Returns the counts so far.
pub fn counts() -> Counts {
    state().counts()
}

/// Makes a command load the layer, and writes the layer's manifest to `folder`, for a test program: cargo puts the
/// layer next to it.
pub fn enable<'a>(command: &'a mut Command, folder: &Path) -> &'a mut Command {
    let test = std::env::current_exe().expect("a path to this test");
    let library = test.with_file_name(format!("{DLL_PREFIX}deltamorph_failing{DLL_SUFFIX}"));
    assert!(library.is_file(), "{}: not there", library.display());
    let manifest = format!(
        r#"{{"file_format_version": "1.1.2", "layer": {{"name": "{NAME}", "type": "GLOBAL", "library_path": {library:?},
        "api_version": "1.3.0", "implementation_version": "1", "description": "Makes calls fail"}}}}"#
    );
    std::fs::write(folder.join("failing.json"), manifest).expect("a manifest");
    // Mesa 22.3's layer that chooses devices crashes where vkEnumerateDeviceExtensionProperties fails.
    command.env("VK_ADD_LAYER_PATH", folder).env("VK_INSTANCE_LAYERS", NAME).env("NODEVICE_SELECT", "1")
}
