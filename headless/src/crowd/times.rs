//! Device times of the steps of an update.

use super::HeadlessCrowd;
use deltamorph::ash::vk;
use deltamorph::{AnyCrowd, Error, Result};

/// More than any update has steps.
const QUERIES: u32 = 256;

impl<C: AnyCrowd + 'static> HeadlessCrowd<'_, C> {
    /// Updates as [`step`](Self::step) without weights does, and returns the name of each step with its device time in
    /// milliseconds; none without timestamps.
    ///
    /// # Errors
    /// Those of [`step`](Self::step); more than 255 steps.
    pub fn step_times(&mut self) -> Result<Vec<(&'static str, f64)>> {
        let Self { headless, crowd, .. } = self;
        let device = &headless.owned.device;
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(QUERIES);
        // SAFETY: the device is alive.
        let pool = unsafe { device.create_query_pool(&info, None) }.map_err(Error::vulkan("vkCreateQueryPool"))?;
        let ran = headless.submitter.run_timed(|cmd, _| {
            // SAFETY: recording on the engine's device, on a queue whose timestamps `run_timed` uses too; submitted
            // once, and waited for, before anything else happens. The pool is reset before its only use.
            unsafe {
                device.cmd_reset_query_pool(cmd, pool, 0, QUERIES);
                crowd.base_mut().set_queries(pool, 0, QUERIES);
                headless.engine.record_update(cmd, crowd)
            }
        });
        let times = ran.and_then(|(update, [total, _])| {
            let mut at = vec![0u64; update.timestamps as usize];
            if total.is_none() || at.is_empty() {
                return Ok(vec![]);
            }
            // SAFETY: as many queries were written by commands that have finished.
            unsafe { device.get_query_pool_results(pool, 0, &mut at, vk::QueryResultFlags::TYPE_64) }
                .map_err(Error::vulkan("vkGetQueryPoolResults"))?;
            let names = crowd.base().step_names();
            Ok(names.zip(at.windows(2)).map(|(name, at)| (name, headless.submitter.ms(at[0], at[1]))).collect())
        });
        // SAFETY: `run_timed` has waited for the only use.
        unsafe { device.destroy_query_pool(pool, None) };
        times
    }
}
