//! What comes after the pose: steps that follow those of an update, read the poses that it wrote, and write what the host
//! asked for into buffers of its own, for each instance that has a target.
//!
//! - [`DecodeTarget`]: a pose as float32, for whoever cannot decode it.
//! - [`SkinTarget`]: a pose that joints move, by linear blend or dual quaternions.
//! - [`NormalsTarget`]: normals of the morphed surface, instead of morphed ones.
//! - [`BoundsTarget`]: the least bounds of a pose. [`WeightBounds`] knows some that hold without a GPU.
//!
//! A step writes what the update changed, and nothing where nothing did. What it wrote is ready for the
//! [consumers](crate::Consumers) of the crowd, and waits for their reads, as poses do.

#[allow(unsafe_code)]
mod attached;
pub(crate) mod bounds;
#[allow(unsafe_code)]
mod decode;
#[allow(unsafe_code)]
mod follower;
pub(crate) mod normals;
mod output;
mod pieces;
pub(crate) mod skin;
#[allow(unsafe_code)]
mod steps;

pub use bounds::{Bounds, BoundsTarget, WeightBounds};
pub(crate) use decode::Decode;
pub use decode::DecodeTarget;
pub(crate) use follower::Place;
pub use normals::{GpuNormals, NormalsDesc, NormalsTarget};
pub use skin::{GpuSkin, SkinDesc, SkinMethod, SkinTarget, SkinnedView};
pub(crate) use steps::After;
