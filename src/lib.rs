//! deltamorph: a morph-target (blend shape) engine that applies only the changed weights.

#![deny(unsafe_code)] // below the gpu line it is allowed, each time with its reason

#[cfg(test)]
extern crate self as deltamorph; // testing.rs is shared with tests/

pub mod cpu;
#[allow(unsafe_code)]
pub mod engine;
pub mod error;
mod files;
#[allow(unsafe_code)]
pub mod gpu;
#[cfg(feature = "headless")]
#[allow(unsafe_code)]
pub mod headless;
pub mod mesh;
pub mod plan;
pub mod reference;
mod rng;
#[cfg(test)]
mod testing;
pub mod weights;

pub use ash;
pub use error::{Error, Result};
pub use gpu_allocator;
