//! The engine on devices, one module for each subject. It is one program, since each links the whole engine.

#[path = "common/buffers.rs"]
mod buffers;
#[path = "common/data.rs"]
mod data;
#[allow(dead_code, reason = "this program writes less than the tests of the reader do")]
#[path = "../src/import/gltf/tests/written.rs"]
mod file;
#[path = "common/gpu.rs"]
mod gpu;
#[path = "common/hazards.rs"]
mod hazards;
#[path = "common/host.rs"]
mod host;
#[path = "common/joints.rs"]
mod joints;
#[path = "common/planned.rs"]
mod planned;
#[path = "common/prelude.rs"]
mod prelude;
#[path = "common/scene.rs"]
mod scene;
#[path = "common/testing.rs"]
mod testing;
#[path = "common/twin.rs"]
mod twin;
#[path = "common/watched.rs"]
mod watched;
#[path = "common/written.rs"]
mod written;

mod after;
mod allocations;
mod animated;
mod assets;
mod budgets;
mod crowds;
mod failing_calls;
mod long;
mod recorded;
mod techniques;
mod threads;
mod updates;
