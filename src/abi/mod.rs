//! What host and shaders share, written once.
//!
//! - [`formats`], [`kernels`], [`steps`] and [`numbers`] are plain data that build.rs includes as well: it compiles the
//!   modules that the table of kernels asks for, and writes the numbers into the shaders' `abi.glsl`.
//! - [`modules`]: the SPIR-V.
//! - [`push`] and [`worklist`]: what is pushed and what lies in buffers, word by word.
//!
//! `tests/project/spirv.rs` reflects every module and compares it with what is stated here.

pub mod formats;
pub mod kernels;
pub mod modules;
pub mod numbers;
pub mod push;
pub mod steps;
pub mod worklist;
