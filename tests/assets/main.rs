//! File import, and the built-in head.

#[path = "../common/data.rs"]
mod data;

mod gltf;
mod head;
mod import;
mod import_real;
mod memory;
mod names;
