//! Targets that come to the device and go.

#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/resident.rs"]
mod resident;

mod refused;
mod swaps;
