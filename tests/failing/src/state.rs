//! Planned failures and live objects: one state for the whole process.

use crate::calls::errors;
use crate::control::Counts;
use ash::vk;
use std::collections::BTreeMap;
use std::ffi::CStr;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};

pub(crate) type Function = unsafe extern "system" fn();

/// The functions below the layer.
#[derive(Clone, Copy)]
pub(crate) enum Next {
    Instance(vk::Instance, vk::PFN_vkGetInstanceProcAddr),
    Device(vk::Device, vk::PFN_vkGetDeviceProcAddr),
}

impl Next {
    pub(crate) fn function(self, name: &CStr) -> vk::PFN_vkVoidFunction {
        // SAFETY: the loader gave the functions for these handles, which are alive: they leave the state before they
        // are destroyed.
        unsafe {
            match self {
                Self::Instance(instance, get) => get(instance, name.as_ptr()),
                Self::Device(device, get) => get(device, name.as_ptr()),
            }
        }
    }
}

/// A failing call, the `at`th.
struct Plan {
    /// Name of the call; if empty, any call that may return the error.
    call: String,
    at: u64,
    error: vk::Result,
    matched: u64,
}

impl Plan {
    /// Parses the text of [`arm`](crate::arm).
    fn parse(text: &str) -> Option<Self> {
        let mut parts = text.split(':');
        let call = parts.next()?.trim_start_matches('*').to_owned();
        let at = parts.next()?.parse().ok()?;
        let error = vk::Result::from_raw(parts.next()?.parse().ok()?);
        Some(Self { call, at, error, matched: 0 })
    }

    fn hits(&mut self, call: &str) -> bool {
        if !errors(call).contains(&self.error) || !(self.call.is_empty() || self.call == call) {
            return false;
        }
        self.matched += 1;
        self.matched == self.at
    }
}

/// A dispatch table, which an instance or device shares with all handles dispatched through it.
type Key = usize;

pub(crate) struct State {
    plan: Option<Plan>,
    /// Calls that may fail.
    calls: u64,
    /// Without the number of those alive.
    counts: Counts,
    next: BTreeMap<Key, Next>,
    /// Functions below the layer, queried when the instance or device was made: later the loader returns the layer's
    /// own for instances.
    below: BTreeMap<(Key, &'static CStr), Function>,
    lost: Vec<Key>,
    /// Type and handle: the parent, and the number of calls before its creation.
    alive: BTreeMap<(&'static str, u64), (Key, u64)>,
    log: Option<File>,
}

static STATE: LazyLock<Mutex<State>> = LazyLock::new(|| {
    let file = std::env::var_os("DELTAMORPH_FAIL_LOG");
    let log = file.map(|path| OpenOptions::new().append(true).create(true).open(path).expect("DELTAMORPH_FAIL_LOG"));
    let plan = std::env::var("DELTAMORPH_FAIL").ok();
    let plan = plan.map(|text| Plan::parse(&text).expect("DELTAMORPH_FAIL=CALL:N:ERROR"));
    let (counts, next, below, alive) = (Counts::default(), BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
    Mutex::new(State { plan, calls: 0, counts, next, below, lost: vec![], alive, log })
});

pub(crate) fn state() -> MutexGuard<'static, State> {
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// # Safety
/// `handle` is a live dispatchable handle.
unsafe fn key(handle: u64) -> Key {
    // SAFETY: a dispatchable handle points to the address of its dispatch table.
    unsafe { *(handle as *const Key) }
}

/// Returns the functions below the layer for a handle, if it was made through the layer.
///
/// # Safety
/// `handle` is a live dispatchable handle.
pub(crate) unsafe fn next(handle: u64) -> Option<Next> {
    // SAFETY: the caller's obligation.
    let key = unsafe { key(handle) };
    state().next.get(&key).copied()
}

/// Returns the function `call` below the layer.
///
/// # Safety
/// `handle` is a live dispatchable handle, made through the layer.
pub(crate) unsafe fn below(call: &'static CStr, handle: u64) -> Function {
    // SAFETY: the caller's obligation.
    let key = unsafe { key(handle) };
    *state().below.get(&(key, call)).expect("a function that the program was given")
}

/// Returns the function `call` below the layer, unless the call fails.
///
/// # Safety
/// Those of [`below`].
pub(crate) unsafe fn enter(call: &'static CStr, handle: u64) -> Result<Function, vk::Result> {
    // SAFETY: the caller's obligation; a function of this name has this type; the device is used no more than by the
    // program's own call.
    unsafe {
        let Some(error) = fails(call, handle) else { return Ok(below(call, handle)) };
        if let (vk::Result::ERROR_DEVICE_LOST, Some(Next::Device(device, _))) = (error, next(handle)) {
            // A lost device has finished its work.
            let wait = below(c"vkDeviceWaitIdle", handle);
            let _ = std::mem::transmute::<Function, vk::PFN_vkDeviceWaitIdle>(wait)(device);
        }
        Err(error)
    }
}

/// Counts a call, and returns its planned error, if any; `handle` is 0 if there is none yet.
///
/// # Safety
/// `handle` is a live dispatchable handle, or 0.
pub(crate) unsafe fn fails(call: &'static CStr, handle: u64) -> Option<vk::Result> {
    // SAFETY: the caller's obligation.
    let key = if handle == 0 { 0 } else { unsafe { key(handle) } };
    let call = call.to_str().expect("ASCII");
    let mut state = state();
    state.calls += 1;
    if state.log.is_some() {
        let place = place();
        state.say(&format!("CALL {call} {place:x}"));
    }
    if state.lost.contains(&key) && errors(call).contains(&vk::Result::ERROR_DEVICE_LOST) {
        return Some(vk::Result::ERROR_DEVICE_LOST);
    }
    let error = state.plan.as_mut().and_then(|plan| plan.hits(call).then_some(plan.error))?;
    state.counts.failed += 1;
    state.counts.call = call.to_owned();
    let text = format!("FAILED {call} {error:?}, call {}", state.calls);
    state.say(&text);
    if error == vk::Result::ERROR_DEVICE_LOST && matches!(state.next.get(&key), Some(Next::Device(..))) {
        state.lost.push(key);
    }
    Some(error)
}

impl State {
    fn say(&mut self, line: &str) {
        match &mut self.log {
            // Written at once, so that a crash loses nothing. An error cannot be reported here.
            Some(file) => _ = writeln!(file, "{line}"),
            None => eprintln!("deltamorph-failing: {line}"),
        }
    }

    /// See [`arm`](crate::arm).
    pub(crate) fn arm(&mut self, plan: &str) {
        self.plan = (!plan.is_empty()).then(|| Plan::parse(plan).expect("CALL:N:ERROR"));
        self.counts.failed = 0;
    }

    pub(crate) fn counts(&self) -> Counts {
        Counts { alive: self.alive.len() as u64, ..self.counts.clone() }
    }

    /// # Safety
    /// `handle` is a dispatchable handle that is alive, as is that of `next`.
    pub(crate) unsafe fn made(&mut self, handle: u64, next: Next) {
        // SAFETY: the caller's obligation.
        let key = unsafe { key(handle) };
        self.next.insert(key, next);
        for name in crate::layer::ALL.concat() {
            self.below.extend(next.function(name).map(|function| ((key, name), function)));
        }
        self.say("MADE an instance or device");
    }

    /// Reports the objects left in an instance or device that is about to be destroyed, and removes them.
    ///
    /// # Safety
    /// Those of [`made`](Self::made).
    pub(crate) unsafe fn unmade(&mut self, handle: u64) {
        // SAFETY: the caller's obligation.
        let key = unsafe { key(handle) };
        self.next.remove(&key);
        self.below.retain(|(of, _), _| *of != key);
        self.lost.retain(|lost| *lost != key);
        let left: Vec<_> = self.alive.iter().filter(|(_, (owner, _))| *owner == key).map(|(k, v)| (*k, *v)).collect();
        for ((kind, handle), (_, call)) in left {
            self.alive.remove(&(kind, handle));
            self.say(&format!("LEAKED {kind}, made after call {call}"));
        }
        self.say("UNMADE an instance or device");
    }

    /// # Safety
    /// `owner` is a dispatchable handle that is alive.
    pub(crate) unsafe fn born(&mut self, kind: &'static str, handle: u64, owner: u64) {
        // SAFETY: the caller's obligation.
        self.alive.insert((kind, handle), (unsafe { key(owner) }, self.calls));
    }

    /// Removes an object; returns whether it was alive, since others are not passed on. Null never is.
    pub(crate) fn gone(&mut self, kind: &'static str, handle: u64) -> bool {
        let known = self.alive.remove(&(kind, handle)).is_some();
        if !known && handle != 0 {
            self.counts.unknown += 1;
            self.say(&format!("UNKNOWN {kind} {handle:#x}: destroyed twice, or never made"));
        }
        known
    }
}

#[cfg(target_os = "linux")]
use linux::place;

/// Call sites are told apart where the C library has `backtrace`.
#[cfg(not(target_os = "linux"))]
fn place() -> u64 {
    0
}

#[cfg(target_os = "linux")]
mod linux {
    use std::ffi::{c_int, c_void};

    #[repr(C)]
    struct Module {
        path: *const c_void,
        base: *mut c_void,
        symbol: *const c_void,
        at: *const c_void,
    }

    unsafe extern "C" {
        fn backtrace(frames: *mut *mut c_void, most: c_int) -> c_int;
        fn dladdr(address: *const c_void, module: *mut Module) -> c_int;
    }

    /// Returns a number for the call site, the same in each run: computed from the return addresses, each relative to
    /// its module.
    pub(super) fn place() -> u64 {
        let mut frames = [std::ptr::null_mut(); 48];
        // SAFETY: there is room for this many.
        let count = unsafe { backtrace(frames.as_mut_ptr(), frames.len() as c_int) } as usize;
        frames[..count].iter().fold(0xcbf2_9ce4_8422_2325, |hash: u64, frame| {
            let mut module = Module {
                path: std::ptr::null(),
                base: std::ptr::null_mut(),
                symbol: std::ptr::null(),
                at: std::ptr::null(),
            };
            // SAFETY: any address may be queried.
            let found = unsafe { dladdr(*frame, &mut module) } != 0;
            let offset = if found { *frame as u64 - module.base as u64 } else { 0 };
            (hash ^ offset).wrapping_mul(0x0000_0100_0000_01b3)
        })
    }
}
