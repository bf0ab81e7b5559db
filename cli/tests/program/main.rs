//! The program as users start it, each command in a process of its own.

#[path = "../common/arm.rs"]
mod arm;
#[path = "../common/cli.rs"]
mod cli;
#[path = "../../../tests/common/data.rs"]
mod data;

mod bench;
mod commands;
mod errors;
mod far;
mod gltf;
mod info;
mod lod;
mod outputs;
mod play;
mod refused;
mod render;
mod suite;
mod weights;
