//! The C API of deltamorph. `include/deltamorph.h` is generated from this crate by the tests in `header.rs`; all that a
//! C caller has to know is in the documentation of the functions, which the header repeats.
//!
//! All of it uses the public API of the Rust library. Properties that C cannot express are checked here: handles
//! ([`handles`]), pointers, sizes and reserved fields of structures ([`memory`]), numbers of
//! enumerations ([`numbers`]); every entry turns errors and panics into a code and a message ([`result`]).

pub mod after;
pub mod allocate;
pub mod arguments;
pub mod attached;
pub mod bounds;
pub mod clip;
pub mod crowd;
pub mod engine;
pub mod handles;
#[cfg(test)]
mod header;
pub mod lifetime;
pub mod memory;
pub mod mesh;
pub mod numbers;
pub mod queries;
pub mod readback;
pub mod record;
pub mod result;
#[cfg(feature = "sample")]
pub mod sample;
pub mod skin;
pub mod structs;
pub mod tickets;
pub mod upload;
pub mod views;
pub mod weights;
