//! deltamorph: a morph-target (blend shape) engine that applies only the changed weights.

pub mod error;
pub mod mesh;
pub mod plan;
pub mod weights;

pub use error::{Error, Result};
