//! Waiting: a barrier between all commands, and for a device whose waits may fail.

use deltamorph::ash::{self, vk};
use std::time::Duration;

/// Number of attempts, and the pause between them: ten seconds in all.
const TRIES: usize = 1000;
const PAUSE: Duration = Duration::from_millis(10);

/// Waits until the device has finished. A wait may run out of memory while the device is still working, when resources
/// in use must not be destroyed, so it is repeated.
///
/// # Errors
/// The device is lost, and uses no resources any more; or waits ran out of memory for ten seconds.
///
/// # Safety
/// No other thread uses the device's queues meanwhile.
pub unsafe fn wait_idle(device: &ash::Device) -> Result<(), vk::Result> {
    // SAFETY: the caller's obligation.
    again(|| unsafe { device.device_wait_idle() }, PAUSE)
}

/// Repeats the wait until it succeeds or the device is lost.
fn again(mut wait: impl FnMut() -> Result<(), vk::Result>, pause: Duration) -> Result<(), vk::Result> {
    let mut waited = wait();
    for _ in 1..TRIES {
        match waited {
            Ok(()) | Err(vk::Result::ERROR_DEVICE_LOST) => break,
            Err(_) => std::thread::sleep(pause),
        }
        waited = wait();
    }
    waited
}

/// Records a global memory barrier from all earlier commands to the stages `next`.
pub fn full_barrier(device: &ash::Device, cmd: vk::CommandBuffer, next: vk::PipelineStageFlags) {
    let memory = [vk::MemoryBarrier::default()
        .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
        .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE)];
    let (all, none) = (vk::PipelineStageFlags::ALL_COMMANDS, vk::DependencyFlags::empty());
    // SAFETY: all callers are in this folder, and pass a buffer that is recording outside a render pass.
    unsafe { device.cmd_pipeline_barrier(cmd, all, next, none, &memory, &[], &[]) };
}

#[cfg(test)]
mod tests {
    use super::*;
    use vk::Result as Vk;

    #[test]
    fn a_wait_that_fails_is_tried_until_it_says_that_the_device_has_finished_or_is_lost() {
        let memory = Err(Vk::ERROR_OUT_OF_HOST_MEMORY);
        let lost = Err(Vk::ERROR_DEVICE_LOST);
        for (results, ends, tries) in [
            (&[Ok(())][..], Ok(()), 1),
            (&[memory, memory, Ok(())], Ok(()), 3),
            (&[memory, lost, Ok(())], lost, 2),
            (&[lost, Ok(())], lost, 1),
            (&[memory], memory, TRIES),
        ] {
            let mut tried = 0;
            let wait = || {
                tried += 1;
                results[(tried - 1).min(results.len() - 1)]
            };
            assert_eq!((again(wait, Duration::ZERO), tried), (ends, tries), "{results:?}");
        }
    }
}
