//! Dense passes: whole poses, cut into passes of at most a batch of targets, as the chapter does.

pub(crate) mod compute;
pub(crate) mod feedback;
mod plan;
pub(crate) mod technique;

pub(crate) type ComputeTechnique = technique::DenseTechnique<compute::ComputePasses>;
pub(crate) type FeedbackTechnique = technique::DenseTechnique<feedback::FeedbackPasses>;

pub use plan::{DensePlanner, Plan};

#[cfg(test)]
mod tests;
