//! tests/threads.rs, as a program.

#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/host.rs"]
mod host;
#[path = "../threads.rs"]
mod threads;
