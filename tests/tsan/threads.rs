//! tests/threads.rs, as a program.

#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/hazards.rs"]
mod hazards;
#[path = "../common/host.rs"]
mod host;
#[path = "../common/testing.rs"]
mod testing;
#[path = "../threads.rs"]
mod threads;
