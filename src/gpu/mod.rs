//! The GPU layer: all code that calls Vulkan.
//!
//! Files by Vulkan concern: [`caps`] (limits and features of a device), `tuning` (kernel choices that suit it),
//! [`device`] (the host's device, borrowed), `allocation` (its memory), `statistics` (memory by kind), `memory`
//! (buffers, rings of lists), `mesh` (an uploaded mesh), `descriptors`, `pipelines`, `barriers`. No file here knows a
//! technique.

pub mod allocation;
pub mod barriers;
pub mod caps;
pub mod descriptors;
pub mod device;
pub mod memory;
pub mod mesh;
pub mod pipelines;
pub mod statistics;
pub mod tuning;
