//! Tracks the command buffers of updates after they were returned to the caller.

use super::raw_device;
use deltamorph::ash::{self, vk};
use deltamorph::{Error, Result};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// A command buffer with updates.
///
/// wgpu does not report whether a command buffer was submitted: its callback comes when the work has finished, but also
/// if the submit failed. So the last command sets an event, which proves that the GPU has run it.
pub struct Submission {
    raw: ash::Device,
    event: vk::Event,
    /// The position at which wgpu finished with it, counted by [`OVER`]; 0: not yet.
    over: AtomicU64,
    _device: wgpu::Device,
}

/// The number of command buffers that have ended.
static OVER: AtomicU64 = AtomicU64::new(0);

/// The state of a command buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// Held by the caller, or running on the GPU.
    Waiting,
    /// It ran, as the n-th command buffer to end.
    Ran(u64),
    /// It did not run, and never will.
    Lost,
}

impl Submission {
    pub fn new(device: &wgpu::Device) -> Result<Arc<Self>> {
        // The clone of `device` keeps it alive.
        let raw = raw_device(device)?;
        // SAFETY: the device is alive.
        let event = unsafe { raw.create_event(&vk::EventCreateInfo::default(), None) };
        let failed =
            |result| Error::Vulkan { call: "vkCreateEvent", result, remedy: "free memory, or create the device anew" };
        Ok(Arc::new(Self { event: event.map_err(failed)?, raw, over: AtomicU64::new(0), _device: device.clone() }))
    }

    /// Records the command that sets the event.
    ///
    /// # Safety
    /// `cmd` is recording on the device, outside a render pass. It is in a [`Flight`] of this submission.
    pub unsafe fn record(&self, cmd: vk::CommandBuffer) {
        // SAFETY: the caller's obligations.
        unsafe { self.raw.cmd_set_event(cmd, self.event, vk::PipelineStageFlags::COMPUTE_SHADER) };
    }

    pub fn fate(&self) -> Fate {
        match self.over.load(Ordering::Acquire) {
            0 => Fate::Waiting,
            // SAFETY: the event is alive. On a lost device the call returns an error.
            nth => match unsafe { self.raw.get_event_status(self.event) } {
                Ok(true) => Fate::Ran(nth),
                Ok(false) | Err(_) => Fate::Lost,
            },
        }
    }
}

impl Drop for Submission {
    fn drop(&mut self) {
        // SAFETY: created in `new`, and destroyed once. The GPU has finished with it: `Flight` holds it until then.
        unsafe { self.raw.destroy_event(self.event, None) };
    }
}

/// The resources that a command buffer uses. It is part of the callback that wgpu calls when the work has finished, or
/// drops along with a command buffer that is dropped.
pub struct Flight {
    _crowds: Vec<Arc<Mutex<deltamorph::Crowd>>>,
    submission: Arc<Submission>,
}

impl Flight {
    pub fn new(submission: &Arc<Submission>, crowds: Vec<Arc<Mutex<deltamorph::Crowd>>>) -> Self {
        Self { _crowds: crowds, submission: submission.clone() }
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        self.submission.over.store(OVER.fetch_add(1, Ordering::Relaxed) + 1, Ordering::Release);
    }
}

/// Returns the first of these command buffers (the oldest first) that did not run before all later ones.
pub fn first_astray(fates: &[Fate]) -> Option<usize> {
    (0..fates.len()).find(|&i| match fates[i] {
        Fate::Lost => true,
        Fate::Waiting => fates[i..].iter().any(|later| matches!(later, Fate::Ran(_))),
        Fate::Ran(nth) => fates[i..].iter().any(|later| matches!(later, Fate::Ran(before) if *before < nth)),
    })
}

#[cfg(test)]
mod tests {
    use super::Fate::{Lost, Ran, Waiting};
    use super::first_astray;

    #[test]
    fn updates_are_astray_where_they_are_lost_or_a_later_one_runs_before() {
        assert_eq!(first_astray(&[]), None);
        assert_eq!(first_astray(&[Ran(3), Ran(5), Waiting, Waiting]), None);
        assert_eq!(first_astray(&[Ran(3), Lost, Waiting]), Some(1));
        assert_eq!(first_astray(&[Waiting, Ran(5)]), Some(0));
        assert_eq!(first_astray(&[Ran(1), Ran(5), Ran(4)]), Some(1));
        assert_eq!(first_astray(&[Waiting, Lost, Ran(7)]), Some(0));
    }
}
