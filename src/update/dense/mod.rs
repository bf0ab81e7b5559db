//! Dense techniques: whole poses in passes of at most a batch of targets, as in Jones, GPU Pro 5.

#[allow(unsafe_code)]
pub(crate) mod compute;
#[allow(unsafe_code)]
pub mod feedback;
mod plan;
#[allow(unsafe_code)]
pub mod technique;

pub(crate) type ComputeTechnique = technique::DenseTechnique<compute::ComputePasses>;
pub(crate) type FeedbackTechnique = technique::DenseTechnique<feedback::FeedbackPasses>;

pub use plan::{DensePlanner, Plan};

#[cfg(test)]
mod tests;
