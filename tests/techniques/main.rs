//! Every update technique, of the library and of others, under the same tests: a table of paths, and a test per column.

#[path = "../common/data.rs"]
mod data;
#[path = "../common/gpu.rs"]
mod gpu;

mod faults;
mod halves;
mod normalised;
mod poses;
mod recording;
mod refused;
mod streams;
mod table;
