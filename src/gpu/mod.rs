//! Below the gpu line: everything that calls Vulkan.
//!
//! Files by Vulkan concern: [`caps`] (what a device can do), `tuning` (what suits it), [`device`] (the host's device,
//! borrowed), `memory` (buffers, rings of lists), `mesh` (an uploaded mesh), `parts` (of an asset that is too large for a
//! descriptor), `descriptors`, `pipelines`, `barriers`. No file here knows a technique.

pub mod barriers;
pub mod caps;
pub mod descriptors;
pub mod device;
pub mod memory;
pub mod mesh;
pub(crate) mod parts;
pub mod pipelines;
pub(crate) mod tuning;

use crate::error::Error;
use ash::vk;

/// An [`Error::Vulkan`] for `call`.
pub(crate) fn failed(call: &'static str) -> impl Fn(vk::Result) -> Error {
    Error::vulkan(call)
}
