//! Dense passes: whole poses, cut into passes of at most a batch of targets, as the chapter does.

pub(crate) mod compute;
pub(crate) mod feedback;
mod plan;
pub(crate) mod technique;

pub(crate) type ComputeTechnique = technique::DenseTechnique<compute::ComputePasses>;
pub(crate) type FeedbackTechnique = technique::DenseTechnique<feedback::FeedbackPasses>;

#[cfg(all(feature = "baselines", any(test, feature = "internals")))]
pub(crate) use plan::pass_accesses;
pub use plan::{COMPUTE_PASS, DensePlanner};
#[cfg(any(test, feature = "internals"))]
pub use plan::{Pass, Plan};

#[cfg(test)]
mod tests;
