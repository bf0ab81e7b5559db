//! Crowds: instances, sets, and poses of several meshes.

#[path = "../common/data.rs"]
mod data;
#[path = "../common/gpu.rs"]
mod gpu;
#[allow(dead_code, reason = "uploads here keep their staging memory")]
#[path = "../common/host.rs"]
mod host;
#[path = "../common/joints.rs"]
mod joints;
#[allow(dead_code, reason = "buffers are all that is needed of it")]
#[path = "../../examples/draw/offscreen.rs"]
mod offscreen;
#[path = "../common/picture.rs"]
mod picture;
#[path = "../common/written.rs"]
mod written;

mod lifetimes;
mod places;
mod pose_buffers;
mod seams;
mod sets;
mod together;
