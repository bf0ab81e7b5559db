//! Codes and messages: the return value of an entry, and the message for `dm_last_error`.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard};

/// Result of a function: `DM_OK`, or a code for the kind of failure. Codes are never reused; later versions may return
/// further ones. `dm_last_error` has the message.
pub type DmResult = u32;

/// Success.
pub const DM_OK: DmResult = 0;
/// A file or folder could not be read or written.
pub const DM_ERROR_IO: DmResult = 1;
/// The content of a file cannot be used.
pub const DM_ERROR_INPUT: DmResult = 2;
/// An argument cannot be used: a value out of range, a null pointer, a structure of an unknown size.
pub const DM_ERROR_INVALID: DmResult = 3;
/// The device lacks a feature that an update path needs.
pub const DM_ERROR_UNSUPPORTED: DmResult = 4;
/// The host or the device is out of memory. Less may still fit.
pub const DM_ERROR_OUT_OF_MEMORY: DmResult = 5;
/// The device is lost, and has to be created again.
pub const DM_ERROR_DEVICE_LOST: DmResult = 6;
/// Another Vulkan call failed.
pub const DM_ERROR_VULKAN: DmResult = 7;
/// A handle is null, of another kind, or of an object that was destroyed.
pub const DM_ERROR_HANDLE: DmResult = 1000;
/// A bug of the library stopped the call. Objects that it was changing can only be destroyed. A library that was built
/// to end the process instead (the profile `small`) never returns it.
pub const DM_ERROR_PANIC: DmResult = 1001;

/// Why a call failed.
#[derive(Debug)]
pub struct Failure {
    /// The code.
    pub code: DmResult,
    /// The failure, and the remedy.
    pub message: String,
}

impl Failure {
    /// An argument that cannot be used.
    pub fn invalid(message: impl Into<String>) -> Self {
        Self { code: DM_ERROR_INVALID, message: message.into() }
    }

    /// A handle that names no object.
    pub fn handle(message: impl Into<String>) -> Self {
        Self { code: DM_ERROR_HANDLE, message: message.into() }
    }

    fn panic(message: impl Into<String>) -> Self {
        Self { code: DM_ERROR_PANIC, message: message.into() }
    }
}

impl From<deltamorph::Error> for Failure {
    fn from(error: deltamorph::Error) -> Self {
        Self { code: error.number(), message: in_c(error.to_string()) }
    }
}

/// Names in the library's messages, and their names in C. Replaced in this order.
const NAMES: [(&str, &str); 13] = [
    ("AnimationDesc::importance", "DmAnimationDesc::level"),
    ("CrowdDesc::pose_usage", "DmCrowdDesc::pose_usage"),
    ("DeviceDesc::buffer_device_address", "DmEngineDesc::buffer_device_address"),
    ("DeviceDesc::queue_families", "DmEngineDesc::queue_families"),
    ("MorphEngine::pack_desc", "DmMeshDesc::engine"),
    ("MorphEngine::set_output_target", "dm_crowd_set_output_target"),
    ("MorphEngine::upload", "dm_mesh_upload"),
    ("MorphEngine", "DmEngine"),
    ("Mesh::weld", "DM_MESH_WELD"),
    ("PoseFormat::Fixed16 or Fixed32", "DM_POSE_FIXED16 or DM_POSE_FIXED32"),
    ("PoseFormat::Fixed32", "DM_POSE_FIXED32"),
    ("Semantic::Normal", "DM_STREAM_NORMAL"),
    ("Semantic::Position", "DM_STREAM_POSITION"),
];

fn in_c(message: String) -> String {
    NAMES.iter().fold(message, |text, (rust, c)| text.replace(rust, c))
}

/// Refuses an argument unless a condition holds, with what is wrong and the remedy, as for `format!`.
macro_rules! ensure {
    ($holds:expr, $($message:tt)+) => {
        let holds: bool = $holds;
        if !holds {
            return Err($crate::result::Failure::invalid(format!($($message)+)));
        }
    };
}
pub(crate) use ensure;

/// `Result` with a [`Failure`].
pub type Result<T> = std::result::Result<T, Failure>;

thread_local! {
    static LAST: RefCell<CString> = RefCell::new(CString::default());
}

/// Runs the body of the entry `function`: failures and panics become a code, and leave a message.
pub fn enter(function: &str, body: impl FnOnce() -> Result<()>) -> DmResult {
    // No code sees the state after a panic: objects are behind locks, which are poisoned then (`lock`).
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => DM_OK,
        Ok(Err(failure)) => failed(function, failure),
        Err(payload) => failed(function, panicked(payload)),
    }
}

fn panicked(payload: Box<dyn Any + Send>) -> Failure {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default();
    // Dropping the payload of the panic could panic again.
    std::mem::forget(payload);
    Failure::panic(format!("a defect of the library: {text}; destroy what was handed in, and report this"))
}

/// Stores the message. Not inlined into each entry: it would be a fifth of all of them.
#[cold]
#[inline(never)]
fn failed(function: &str, failure: Failure) -> DmResult {
    let message = c_string(&format!("{function}: {}", failure.message));
    // A thread that is ending may have no storage for a message.
    let _ = LAST.try_with(|last| *last.borrow_mut() = message);
    failure.code
}

/// A text for C; zeros in it are replaced.
pub fn c_string(text: &str) -> CString {
    CString::new(text.replace('\0', "\u{fffd}")).unwrap_or_default()
}

/// Locks an object's state, which a call that panicked may have left half changed.
pub fn lock<T>(mutex: &Mutex<T>) -> Result<MutexGuard<'_, T>> {
    mutex.lock().map_err(|_| Failure::panic("an earlier call with this object ran into a defect; destroy the object"))
}

/// The message of the last function that failed on this thread: UTF-8, ended by a zero; empty if none has failed. It
/// says what was refused, and the remedy. Valid until the next function fails on this thread, or the thread ends.
#[unsafe(no_mangle)]
pub extern "C" fn dm_last_error() -> *const c_char {
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    fn last() -> String {
        // SAFETY: a string that is valid until the next failure on this thread.
        unsafe { CStr::from_ptr(dm_last_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn panics_and_errors_become_codes_with_a_message_of_this_thread() {
        assert_eq!((enter("dm_a", || Ok(())), last()), (DM_OK, String::new()));
        assert_eq!(enter("dm_b", || Err(Failure::invalid("x\0y; z"))), DM_ERROR_INVALID);
        assert_eq!(last(), "dm_b: x\u{fffd}y; z");
        std::thread::spawn(|| assert_eq!(last(), "")).join().unwrap();
        for (body, text) in [((|| panic!("a {}", 1)) as fn() -> Result<()>, "a 1"), (|| panic!("b"), "b")] {
            assert_eq!(enter("dm_c", body), DM_ERROR_PANIC);
            assert!(last().starts_with("dm_c: a defect of the library: ") && last().contains(text), "{}", last());
        }
        assert_eq!(enter("dm_d", || std::panic::panic_any(7)), DM_ERROR_PANIC);
        // A successful call keeps the message.
        assert_eq!((enter("dm_e", || Ok(())), last().starts_with("dm_d: ")), (DM_OK, true));
    }

    #[test]
    fn what_a_panic_left_half_changed_is_refused() {
        let mutex = Mutex::new(0);
        assert_eq!(enter("dm_a", || lock(&mutex).map(|_guard| panic!("half"))), DM_ERROR_PANIC);
        assert_eq!(enter("dm_b", || lock(&mutex).map(drop)), DM_ERROR_PANIC);
        assert!(last().contains("destroy the object"), "{}", last());
    }
}
