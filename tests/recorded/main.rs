//! Recorded commands, and refused calls.

#[path = "../common/gpu.rs"]
mod gpu;
#[allow(dead_code, reason = "buffers are all that is needed of it")]
#[path = "../../examples/draw/offscreen.rs"]
mod offscreen;

mod errors;
mod memory;
mod pipelines;
mod queues;
mod slots;
mod soundness;
mod watched;
