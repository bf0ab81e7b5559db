//! Interfaces between host and shaders, each defined once.
//!
//! - [`formats`], [`kernels`] and [`numbers`] are plain data that build.rs includes too: it compiles the
//!   modules of the kernel table, and writes the numbers into the shaders' `abi.glsl`.
//! - [`modules`]: the SPIR-V, whose [`ids`] build.rs has replaced by differences.
//! - [`push`] and [`worklist`]: push constants and buffer contents, word by word.
//!
//! The validation layers compare pipelines with the modules, tests poses with the reference.

pub mod formats;
pub mod ids;
pub mod kernels;
pub mod modules;
pub mod numbers;
pub mod push;
pub mod worklist;
