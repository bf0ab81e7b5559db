//! Device times of the steps of an update.

use super::{Draws, HeadlessCrowd};
use deltamorph::ash::vk;
use deltamorph::{Error, Result};
use std::slice::from_mut;

/// More than any update has steps.
const QUERIES: u32 = 256;

impl HeadlessCrowd<'_> {
    /// Updates as [`step`](Self::step) without weights does, and returns the name of each step with its device time in
    /// milliseconds; none without timestamps.
    ///
    /// # Errors
    /// Those of [`step`](Self::step); more than 255 steps.
    pub fn step_times(&mut self) -> Result<Vec<(&'static str, f64)>> {
        let headless = self.headless;
        if !headless.submitter.has_timestamps() {
            return self.step(&[]).map(|_| vec![]);
        }
        let device = &headless.owned.device;
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(QUERIES);
        // SAFETY: the device is alive.
        let pool = unsafe { device.create_query_pool(&info, None) }.map_err(Error::vulkan("vkCreateQueryPool"))?;
        let step = Self::step_all(from_mut(self), &[], Draws::default(), |headless, crowds, cmd| {
            // SAFETY: as in `step_together`; the queue has timestamps, and the pool is reset before its only use and
            // lives until that has ended.
            unsafe {
                device.cmd_reset_query_pool(cmd, pool, 0, QUERIES);
                crowds[0].set_queries(pool, 0, QUERIES);
                headless.engine.record_updates(cmd, crowds)
            }
        });
        let times = step.and_then(|step| {
            let mut at = vec![0u64; step.update.timestamps as usize];
            if !at.is_empty() {
                // SAFETY: as many queries were written by commands that have finished.
                unsafe { device.get_query_pool_results(pool, 0, &mut at, vk::QueryResultFlags::TYPE_64) }
                    .map_err(Error::vulkan("vkGetQueryPoolResults"))?;
            }
            let names = self.crowd.step_names();
            Ok(names.zip(at.windows(2)).map(|(name, at)| (name, headless.submitter.ms(at[0], at[1]))).collect())
        });
        // SAFETY: the step has waited for the only use.
        unsafe { device.destroy_query_pool(pool, None) };
        times
    }
}
