//! Poses used through wgpu, under the validation layers: `../../with-vulkan cargo test`.

mod common;
mod fates;
mod layers;
mod lifetimes;
#[path = "../../examples/head/play.rs"]
mod play;
mod poses;
#[path = "../../examples/head/scene.rs"]
mod scene;
#[path = "../../../../tests/common/testing.rs"]
mod testing;
