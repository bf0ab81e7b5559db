//! Below the gpu line: everything that calls Vulkan.
//!
//! Files by Vulkan concern: [`caps`] (what a device can do), `tuning` (what suits it), [`device`] (the host's device,
//! borrowed), `memory` (buffers, rings of lists), `mesh` (an uploaded mesh), `parts` (of an asset that is too large for a
//! descriptor), `descriptors`, `pipelines`, `barriers`; of baselines `images` and `blending`. No file here knows a technique.

pub(crate) mod barriers;
#[cfg(feature = "baselines")]
mod blending;
pub mod caps;
pub(crate) mod descriptors;
pub mod device;
#[cfg(feature = "baselines")]
pub(crate) mod images;
pub(crate) mod memory;
pub(crate) mod mesh;
pub(crate) mod parts;
pub(crate) mod pipelines;
pub(crate) mod tuning;

use crate::error::Error;
use ash::vk;

/// An [`Error::Vulkan`] for `call`.
pub(crate) fn failed(call: &'static str) -> impl Fn(vk::Result) -> Error {
    Error::vulkan(call)
}
