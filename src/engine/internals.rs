//! Accessors for packages of this repository.

use super::base::{OnDevice, Updater};
use super::{AnyCrowd, DeviceCrowd, GpuMesh, MorphEngine, Update};
use crate::crowd::{CrowdBase, Kind};
use crate::error::Result;
use crate::gpu::device::Device;
use crate::plan::schedule::Entry;
use ash::vk;
use std::ops::Range;
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
        crowds: &mut [&mut dyn AnyCrowd],
        tamper: impl FnOnce(&mut Vec<Entry>),
    ) -> Result<Vec<Update>> {
        let mut crowds: Vec<&mut DeviceCrowd> = crowds.iter_mut().map(|crowd| crowd.base_mut()).collect();
        let mut updates = vec![];
        let mut planned = self.plan(&mut crowds, |update| updates.push(update))?;
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

impl<K: Kind + ?Sized> CrowdBase<K> {
    /// Vertices that the last update changed in the pose of `instance`, as ascending ranges in pose-buffer order: whole
    /// blocks in block formats, all vertices if only the GPU knows. The last range may extend beyond the last vertex.
    #[doc(hidden)]
    pub fn changed(&mut self, instance: u32) -> Vec<Range<u32>> {
        let mut changed = vec![];
        if self.updates > 0 && self.instances.check(instance).is_ok() {
            self.kind.state().changed(&self.instances, self.updates, instance, &mut changed);
        }
        changed
    }
}

impl<U: Updater + ?Sized> CrowdBase<OnDevice<U>> {
    /// Starts as if `updates` updates had been recorded and had finished. For tests of counter
    /// wraparound, before the first update.
    #[doc(hidden)]
    pub fn begin_at(&mut self, updates: u64) {
        (self.updates, self.kind.recorded) = (updates, updates);
        self.kind.updater.technique_mut().begin_at(updates);
    }

    /// See [`Technique::sums`](crate::update::technique::Technique::sums).
    #[doc(hidden)]
    pub fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        self.technique().sums(instance)
    }
}
