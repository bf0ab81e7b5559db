//! Weights: clips, applied weights, delta weights.

mod clip;
pub mod delta;

pub use clip::{BoundClip, WeightClip};
