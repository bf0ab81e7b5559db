//! What every way to update has in common, as data: descriptions, instances, steps and their barriers, statistics.
//!
//! Pure: no Vulkan here. A [technique](crate::update) turns requested weights into [`steps`], [`schedule`] derives the
//! barriers, and what is recorded is data, so that tests hold it to [`hazards`]: every access has to be ordered.

mod desc;
#[cfg(any(test, feature = "internals"))]
pub mod hazards;
pub mod history;
pub mod instances;
pub(crate) mod paths;
pub mod schedule;
mod stats;
pub mod steps;

pub use desc::{Accumulate, BatchSize, CrowdDesc, UpdateDesc, UpdateMode};
pub use paths::UpdatePath;
pub use stats::UpdateStats;
pub use steps::Consumers;
#[cfg(any(test, feature = "internals"))]
pub use steps::Source;

#[cfg(test)]
pub(crate) mod tests;
