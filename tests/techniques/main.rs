//! Every update technique, ours and those of others, held to the same: a table of paths, and a test for each column.

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
