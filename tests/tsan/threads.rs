//! tests/threads.rs, as a program.

#[path = "../common/gpu.rs"]
#[allow(dead_code, reason = "these tests need few of them")]
mod gpu;
#[path = "../common/hazards.rs"]
mod hazards;
#[path = "../common/host.rs"]
mod host;
#[path = "../common/testing.rs"]
mod testing;
#[path = "../threads.rs"]
mod threads;
