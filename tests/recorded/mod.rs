//! Recorded commands, and refused calls.

mod errors;
mod memory;
mod queues;
mod soundness;
mod watched;
