//! deltamorph: a morph-target (blend shape) engine that applies only the changed weights.

pub mod cpu;
pub mod error;
pub mod gpu;
pub mod mesh;
pub mod plan;
pub mod reference;
#[cfg(test)]
mod testing;
pub mod weights;

pub use error::{Error, Result};
