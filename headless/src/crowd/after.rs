//! Post-morph passes.

use super::HeadlessCrowd;
use deltamorph::Result;
use deltamorph::after::{GpuNormals, OutputTarget};

impl HeadlessCrowd<'_> {
    /// See [`MorphEngine::set_output_target`](deltamorph::MorphEngine::set_output_target).
    ///
    /// # Safety
    /// Those of the linked method. Stepped and submitted updates have finished.
    pub unsafe fn set_output_target(&mut self, instance: u32, target: Option<&OutputTarget<'_>>) -> Result<()> {
        // SAFETY: the caller's obligations.
        unsafe { self.headless.engine.set_output_target(&mut self.crowd, instance, target) }
    }

    /// See [`MorphEngine::set_normals_target`](deltamorph::MorphEngine::set_normals_target).
    ///
    /// # Safety
    /// Those of the linked method. Stepped and submitted updates have finished.
    pub unsafe fn set_normals_target(
        &mut self,
        instance: u32,
        target: Option<(&GpuNormals, &OutputTarget<'_>)>,
    ) -> Result<()> {
        // SAFETY: the caller's obligations.
        unsafe { self.headless.engine.set_normals_target(&mut self.crowd, instance, target) }
    }

    /// See [`Crowd::set_joints`](deltamorph::Crowd::set_joints).
    pub fn set_joints(&mut self, instance: u32, offset: u64) -> Result<()> {
        self.crowd.set_joints(instance, offset)
    }
}
