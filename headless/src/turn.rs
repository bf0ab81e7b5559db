//! A lock, so that only one thread at a time has the validation layers loaded.
//!
//! Each call into the layers looks its device up in a map without a lock, while other threads may insert theirs
//! (KhronosGroup/Vulkan-ValidationLayers, issue 4391). Tests on two threads crashed once in hundreds of runs.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{ThreadId, current};

/// The thread that has the layers loaded, and how many times.
static OWNER: Mutex<Option<(ThreadId, usize)>> = Mutex::new(None);
static FREE: Condvar = Condvar::new();

/// The right to have the layers loaded. Other threads wait until it is dropped; the thread that holds it does not.
pub struct Turn(());

fn owner() -> MutexGuard<'static, Option<(ThreadId, usize)>> {
    OWNER.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Turn {
    pub fn wait() -> Self {
        let me = current().id();
        let others = |owner: &mut Option<(ThreadId, usize)>| owner.is_some_and(|(thread, _)| thread != me);
        let mut owner = FREE.wait_while(owner(), others).unwrap_or_else(PoisonError::into_inner);
        owner.get_or_insert((me, 0)).1 += 1;
        Self(())
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut owner = owner();
        *owner = owner.map(|(thread, times)| (thread, times - 1)).filter(|(_, times)| *times > 0);
        FREE.notify_all();
    }
}
