//! Poses used through wgpu, under the validation layers: `../../with-vulkan cargo test`.

mod common;
mod fates;
#[allow(dead_code, reason = "its `main` is for `cargo run --example head`")]
#[path = "../../examples/head.rs"]
mod head;
mod layers;
mod lifetimes;
mod poses;
#[path = "../../../../tests/common/testing.rs"]
mod testing;
