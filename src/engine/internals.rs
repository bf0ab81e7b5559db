//! What packages of this repository ask of engines, meshes and crowds, beside what hosts do.

use super::base::{OnDevice, Updater};
use super::{AnimatedCrowd, GpuMesh, MorphEngine};
use crate::crowd::CrowdBase;
use crate::error::Result;
use crate::gpu::device::Device;
use crate::update::animated::PlannedGroup;
use ash::vk;
use std::sync::Arc;

impl MorphEngine {
    /// The host's device, and the memory that is allocated of it.
    #[doc(hidden)]
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }
}

impl GpuMesh {
    /// The same mesh, with the same buffers.
    #[doc(hidden)]
    pub fn shared(&self) -> Self {
        Self::of(self.groups.clone())
    }
}

impl<U: Updater + ?Sized> CrowdBase<OnDevice<U>> {
    /// See [`Technique::sums`](crate::update::technique::Technique::sums).
    #[doc(hidden)]
    pub fn sums(&self, instance: u32) -> Option<(vk::Buffer, u64)> {
        self.technique().sums(instance)
    }
}

impl AnimatedCrowd {
    /// What the last update planned for the first group of the mesh, by `read`, which takes buffer, offset and size.
    ///
    /// # Errors
    /// Those of `read`.
    #[doc(hidden)]
    pub fn read_plan(&self, read: impl FnMut((vk::Buffer, u64, u64)) -> Result<Vec<u32>>) -> Result<Vec<PlannedGroup>> {
        self.animated().read_plan(read)
    }

    /// Where the level of detail of an instance is, if it follows the camera: buffer, offset, size of words as
    /// `glsl/level.comp` writes them.
    #[doc(hidden)]
    pub fn level_of(&self, instance: u32) -> Option<(vk::Buffer, u64, u64)> {
        self.animated().level_of(instance)
    }

    /// Where the weights of an instance are: buffer, offset, size.
    #[doc(hidden)]
    pub fn weights_of(&self, instance: u32) -> (vk::Buffer, u64, u64) {
        self.animated().weights_of(instance)
    }
}
