//! Weights: clips, applied weights, delta weights.

mod clip;
pub mod delta;

#[cfg(feature = "csv")]
pub use crate::import::csv;
pub use clip::{BoundClip, WeightClip};
