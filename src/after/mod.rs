//! Post-morph passes: they read the poses that an update wrote, and write output buffers of the host, for each
//! instance that has a target.
//!
//! - [`DecodeTarget`]: a pose as float32, for readers that cannot decode it.
//! - [`SkinTarget`]: the pose skinned by joints, with linear blending or dual quaternions.
//! - [`NormalsTarget`]: normals of the morphed surface, instead of morphed ones.
//!
//! A pass writes what the update changed, or nothing if nothing changed. Its output is ready for the
//! [consumers](crate::Consumers) of the crowd, and waits for their reads, like poses.

#[allow(unsafe_code)]
mod attached;
mod output;
mod pieces;
#[allow(unsafe_code)]
mod step;
#[allow(unsafe_code)]
mod steps;

use crate::abi::steps::after_steps;
pub(crate) use step::TargetContext;
pub(crate) use steps::After;

macro_rules! declared {
    (() $(
        $(#[doc = $doc:literal])*
        $kind:ident $module:ident::$step:ident [$($public:ident),*] $set:tt $dispatch:tt
    )*) => {
        $(
            pub(crate) mod $module;
            pub use $module::{$($public),*};
        )*
    };
}
after_steps!(declared());
