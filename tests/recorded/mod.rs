//! Recorded commands, and refused calls.

mod errors;
mod memory;
mod queues;
mod slots;
mod soundness;
mod watched;
