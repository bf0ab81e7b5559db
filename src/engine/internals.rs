//! Accessors for packages of this repository.

use super::{Crowd, GpuMesh, MorphEngine, Update};
use crate::error::Result;
use crate::gpu::device::Device;
use crate::plan::schedule::Entry;
use ash::vk;
use std::sync::Arc;

impl MorphEngine {
    /// The host's device, with its allocator.
    #[doc(hidden)]
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Like [`record_updates`](Self::record_updates), with the recorded entries changed by `tamper`, so that tests can
    /// plant faults, or see what is recorded.
    ///
    /// # Errors
    /// Those of [`record_updates`](Self::record_updates).
    ///
    /// # Safety
    /// See [`record_updates`](Self::record_updates); `tamper` may break its guarantees.
    #[doc(hidden)]
    pub unsafe fn record_tampered(
        &self,
        cmd: vk::CommandBuffer,
        crowds: &mut [&mut Crowd],
        tamper: impl FnOnce(&mut Vec<Entry>),
    ) -> Result<Vec<Update>> {
        let mut updates = vec![];
        let mut planned = self.plan(crowds, |update| updates.push(update))?;
        tamper(&mut planned.schedule.entries);
        // SAFETY: the caller's obligations.
        unsafe { planned.record(&self.device, cmd) };
        Ok(updates)
    }
}

impl GpuMesh {
    /// Another handle of the same mesh and buffers.
    #[doc(hidden)]
    pub fn shared(&self) -> Self {
        Self { groups: self.groups.clone(), staging: vec![] }
    }
}

impl Crowd {
    /// Starts as if `updates` updates had been recorded and had finished. For tests of counter
    /// wraparound, before the first update.
    #[doc(hidden)]
    pub fn begin_at(&mut self, updates: u64) {
        (self.updates, self.recorded) = (updates, updates);
        self.technique.begin_at(updates);
    }

    /// See [`Technique::sums`](crate::update::technique::Technique::sums).
    #[doc(hidden)]
    pub fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        self.technique().sums(instance)
    }
}
