//! Skinning of poses by joints.
//!
//! `weights`: packing of joints and weights. `step`: the device side. `reference`: the same in float64.

mod reference;
#[allow(unsafe_code)]
mod step;
mod weights;

pub use reference::skin;
pub(crate) use step::Skin;
pub use step::{GpuSkin, SkinTarget, SkinnedView};
pub use weights::{SkinDesc, SkinMethod};
