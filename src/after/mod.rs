//! What comes after the pose: steps that follow those of an update, read the poses that it wrote, and write what the
//! host asked for into buffers of its own, for each instance that has a target.
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
#[allow(unsafe_code)]
mod follower;
mod output;
mod pieces;
#[allow(unsafe_code)]
mod steps;

use crate::abi::steps::after_steps;
pub(crate) use follower::Place;
pub(crate) use steps::After;

/// The modules of the steps.
macro_rules! declared {
    (() $(
        $(#[doc = $doc:literal])*
        $kind:ident $module:ident::$step:ident [$($public:ident),*] $set:tt $dispatches:tt
    )*) => {
        $(
            pub(crate) mod $module;
            pub use $module::{$($public),*};
        )*
    };
}
after_steps!(declared());
