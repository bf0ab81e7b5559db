//! The techniques of others.

#[path = "../common/baselines.rs"]
mod baselines;
#[path = "../common/data.rs"]
mod data;
#[path = "../common/gpu.rs"]
mod gpu;

mod halves;
mod normalised;
mod poses;
mod recorded;
