//! deltamorph: a morph-target (blend shape) engine that applies only the changed weights.

pub mod error;
mod files;
pub mod mesh;
pub mod plan;
mod rng;
pub mod weights;

pub use error::{Error, Result};
