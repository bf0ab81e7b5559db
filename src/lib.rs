//! deltamorph: a morph-target (blend shape) engine that applies only the changed weights.
#![warn(missing_docs)]

pub mod error;
mod files;
pub mod mesh;
mod rng;
pub mod weights;

pub use error::{Error, Result};
