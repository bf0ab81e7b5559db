//! The interface between the layer and the tests that link this crate.

use crate::state::{Function, state};
use ash::vk;
use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::ffi::{CStr, CString, c_char};
use std::mem::transmute;
use std::path::Path;
use std::process::Command;

/// The layer's name.
pub const NAME: &str = "VK_LAYER_deltamorph_failing";

/// Counts of the layer.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// Calls that may fail.
    pub calls: u64,
    /// Calls that failed since the last [`Control::arm`].
    pub failed: u64,
    /// Destroyed handles that were not alive.
    pub unknown: u64,
    /// Live objects, without instances, devices, command buffers and descriptor sets.
    pub alive: u64,
    /// Objects that were alive when their device or instance was destroyed.
    pub leaked: u64,
    /// The name of the call that failed last.
    pub(crate) call: [u8; 64],
}

impl Default for Counts {
    fn default() -> Self {
        Self { calls: 0, failed: 0, unknown: 0, alive: 0, leaked: 0, call: [0; 64] }
    }
}

impl Counts {
    /// The name of the call that failed last.
    pub fn call(&self) -> &str {
        CStr::from_bytes_until_nul(&self.call).ok().and_then(|name| name.to_str().ok()).unwrap_or_default()
    }
}

/// Controls the failures of the layer below an instance.
pub struct Control {
    arm: Arm,
    read: Read,
}

type Arm = unsafe extern "system" fn(*const c_char);
type Read = unsafe extern "system" fn(*mut Counts);

impl Control {
    /// Returns the control of the layer that a device was made through.
    ///
    /// # Panics
    /// The layer is not there: see [`enable`].
    ///
    /// # Safety
    /// The device is of this instance, and both are alive.
    pub unsafe fn of(instance: &ash::Instance, device: vk::Device) -> Self {
        let get = |name: &CStr| {
            // SAFETY: the caller's obligation.
            unsafe { instance.get_device_proc_addr(device, name.as_ptr()) }.expect("the layer, which is not there")
        };
        // SAFETY: functions of these names, from this crate, have these types.
        unsafe {
            Self {
                arm: transmute::<Function, Arm>(get(c"failingArm")),
                read: transmute::<Function, Read>(get(c"failingCounts")),
            }
        }
    }

    /// Sets the failure `CALL:N:ERROR[:TIMES]`, counted from now; an empty text sets none.
    pub fn arm(&self, plan: &str) {
        let plan = CString::new(plan).expect("no zeros");
        // SAFETY: the layer stays loaded (build.rs); the text ends with a zero.
        unsafe { (self.arm)(plan.as_ptr()) }
    }

    /// Returns the counts so far.
    pub fn counts(&self) -> Counts {
        let mut counts = Counts::default();
        // SAFETY: as above; there is room for the counts.
        unsafe { (self.read)(&mut counts) };
        counts
    }
}

/// # Safety
/// A text that ends with a zero.
unsafe extern "system" fn arm(plan: *const c_char) {
    // SAFETY: the caller's obligation.
    let plan = unsafe { CStr::from_ptr(plan) };
    state().arm(plan.to_str().expect("ASCII"));
}

/// # Safety
/// There is room for the counts.
unsafe extern "system" fn counts(room: *mut Counts) {
    // SAFETY: the caller's obligation.
    unsafe { *room = state().counts() }
}

/// Returns the functions that [`Control::of`] queries.
pub(crate) fn function(name: &CStr) -> vk::PFN_vkVoidFunction {
    let function = match name.to_bytes() {
        b"failingArm" => arm as *const (),
        b"failingCounts" => counts as *const (),
        _ => return None,
    };
    // SAFETY: it is a function's address; the caller knows its type.
    Some(unsafe { transmute::<*const (), Function>(function) })
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
