//! The same of a crowd that is animated on the GPU, and what the GPU has planned.

use super::HeadlessCrowd;
use crate::engine::AnimatedCrowd;
use crate::error::Result;
use crate::headless::Headless;
use crate::pack::PackedMesh;
use crate::plan::CrowdDesc;
use crate::update::animated::{AnimationDesc, PlannedGroup, Playback};

impl<'a> HeadlessCrowd<'a, AnimatedCrowd> {
    /// Upload `mesh` and make a crowd that is animated on the GPU. Each [`step`](Self::step), of no weights, goes to the
    /// time last set.
    ///
    /// # Errors
    /// As [`MorphEngine::upload`](crate::engine::MorphEngine::upload) and
    /// [`MorphEngine::create_animated_crowd`](crate::engine::MorphEngine::create_animated_crowd).
    pub fn animated(
        headless: &'a Headless,
        mesh: &PackedMesh,
        desc: &CrowdDesc,
        animation: &AnimationDesc<'_>,
    ) -> Result<Self> {
        let (engine, submitter) = (&headless.engine, &headless.submitter);
        // SAFETY: the submitter hands out a recording buffer of the engine's device; it waits for the device.
        let mesh = headless.upload(|cmd| unsafe { engine.upload(cmd, mesh) })?;
        // SAFETY: as above.
        let mut crowd = submitter.run(|cmd| unsafe { engine.create_animated_crowd(cmd, &mesh, desc, animation) })?;
        // SAFETY: as above.
        unsafe { crowd.release_staging() };
        Self::with(headless, mesh, crowd)
    }

    /// See [`AnimatedCrowd::play`].
    pub fn play(&mut self, instance: u32, playback: &Playback) -> Result<()> {
        self.crowd.play(instance, playback)
    }

    /// See [`AnimatedCrowd::set_time`].
    pub fn set_time(&mut self, seconds: f64) -> Result<()> {
        self.crowd.set_time(seconds)
    }

    /// What the GPU planned for the last update.
    ///
    /// # Errors
    /// A device that fails; a crowd that is planned on the CPU.
    #[doc(hidden)]
    pub fn read_plan(&mut self) -> Result<Vec<PlannedGroup>> {
        let Self { crowd, readback, headless, .. } = self;
        crowd.animated().read_plan(|range| readback.read(headless, range))
    }

    /// The weights of an instance on the GPU, in steps of the grid.
    ///
    /// # Errors
    /// As [`read_plan`](Self::read_plan).
    #[doc(hidden)]
    pub fn read_weights(&mut self, instance: u32) -> Result<Vec<i32>> {
        let range = self.crowd.animated().weights_of(instance);
        self.read(range)
    }
}
