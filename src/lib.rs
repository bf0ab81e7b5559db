//! deltamorph: a morph-target (blend shape) engine that applies only the changed weights, on raw Vulkan.
//!
//! The engine borrows your device and records into your command buffers; it never submits, waits, or creates a queue or
//! thread. What to call, in order:
//!
//! 1. Mesh: [`import::obj::import_folder`], [`import::sample::head`] or an [`asset::MorphSource`] of your own, then
//!    [`to_mesh`](asset::MorphSource::to_mesh) and [`PackedMesh::pack`](pack::PackedMesh::pack); or
//!    [`Asset::read`](pack::file::Asset::read) of what was packed before.
//! 2. Device: [`engine::requirements`] before you create it, [`engine::MorphEngine::new`] after.
//! 3. [`upload`](engine::MorphEngine::upload) the mesh, [`create_crowd`](engine::MorphEngine::create_crowd).
//! 4. Each frame: [`set_weights`](engine::Crowd::set_weights),
//!    [`record_update`](engine::MorphEngine::record_update), and draw from [`pose`](engine::Crowd::pose); motion vectors
//!    take [`previous_pose`](engine::Crowd::previous_pose).
//!
//! The [`engine`] module says what the caller is responsible for; `examples/minimal.rs` is a complete host. Without
//! Vulkan, [`cpu::CpuCrowd`] takes the same descriptions. [`mod@reference`] tells how far a pose is from the truth.
//!
//! # Features
//! None is on by default.
//! - `headless`: instance, device and queue of our own (`deltamorph::headless`), for the command line and tests.
//! - `csv`: weight clips from CSV files.
//! - `threads`: the path `cpu` and the importer on several threads.
//! - `baselines`: the techniques of others, to compare with.
//! - `compile-shaders`: compile `glsl/` at build time, which needs a C++ compiler; without it the modules checked in
//!   under `spirv/` are linked.

#![deny(unsafe_code)] // below the gpu line it is allowed, each time with its reason

pub mod abi;
pub mod asset;
#[cfg(feature = "baselines")]
#[allow(unsafe_code)]
mod baselines;
pub mod cpu;
#[allow(unsafe_code)]
pub mod engine;
pub mod error;
#[allow(unsafe_code)]
pub mod gpu;
#[cfg(feature = "headless")]
#[allow(unsafe_code)]
pub mod headless;
pub mod import;
mod io;
mod math;
pub mod mesh;
pub mod pack;
pub mod plan;
pub mod reference;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod testing;
#[allow(unsafe_code)]
pub mod update;
pub mod weights;

/// What the command line and tests share with the library; no part of the API.
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod internals {
    pub use crate::import::sample::rng::Rng;
    pub use crate::io::write_replacing;
}

pub use ash;
pub use error::{Error, ErrorKind, Result};
pub use gpu_allocator;

/// The README's code has to compile.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
