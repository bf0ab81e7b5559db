//! Recorded commands, and refused calls.

mod errors;
mod memory;
mod pipelines;
mod queues;
mod slots;
mod soundness;
mod watched;
