//! Bounds of poses: `weights` knows some that hold, without a GPU; `step` finds the least there are, on the device.

#[allow(unsafe_code)]
mod step;
mod weights;

pub use step::BoundsTarget;
pub(crate) use step::TightBounds;
pub use weights::{Bounds, WeightBounds};
