//! Animation and levels of detail on the GPU.

#[path = "../common/data.rs"]
mod data;
#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/scene.rs"]
mod scene;

mod animation;
mod heads;
mod lod;
