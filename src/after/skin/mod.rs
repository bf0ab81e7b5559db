//! Skinning: joints move the vertices of a pose.
//!
//! `weights` packs what a mesh says, once; `step` follows the pose on the device; `reference` does the same in float64.

mod reference;
#[allow(unsafe_code)]
mod step;
mod weights;

pub use reference::skin;
pub(crate) use step::Skin;
pub use step::{GpuSkin, SkinTarget, SkinnedView};
pub use weights::{SkinDesc, SkinMethod};
