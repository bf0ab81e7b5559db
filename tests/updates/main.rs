//! Poses of every path, format and driver, against float64 and each other.

#[path = "../common/data.rs"]
mod data;
#[path = "../common/gpu.rs"]
mod gpu;
#[allow(dead_code, reason = "buffers are all that is needed of it")]
#[path = "../../examples/draw/offscreen.rs"]
mod offscreen;
#[path = "../common/scene.rs"]
mod scene;
#[path = "../common/written.rs"]
mod written;

mod blocks_data;
mod bounds;
mod clamps;
mod fixed16;
mod integers;
mod readback;
mod real_data;
mod tunings;
