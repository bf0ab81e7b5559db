//! Steps after the pose, and hosts' draws of their outputs.

#[path = "../common/character.rs"]
mod character;
#[path = "../common/data.rs"]
mod data;
#[allow(dead_code, reason = "its `main` writes a file")]
#[path = "../../examples/draw/main.rs"]
mod draw;
#[allow(dead_code, reason = "this program writes less than the tests of the reader do")]
#[path = "../../src/import/gltf/tests/written.rs"]
mod file;
#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/joints.rs"]
mod joints;
#[path = "../common/numbers.rs"]
mod numbers;
#[path = "../common/skinned.rs"]
mod skinned;
#[path = "../common/written.rs"]
mod written;

mod formulas;
mod gltf_skin;
mod host_vertices;
mod normals;
mod pictures;
mod scenes;
mod steps;

use draw::offscreen;
