//! What hosts read of crowds on a device, and what crowds that play clips are told.

use super::base::Crowd;
use super::poses;
use super::views::{PoseBuffer, PoseView, StreamView};
use crate::after::OutputView;
use crate::asset::streams::Semantic;
use crate::error::{Error, Result};
use crate::pack::PackedMesh;
use crate::update::animated::{Animated, Clips, Playback};
use crate::update::crowd::CrowdDesc;
use crate::update::technique::place_of;
use std::any::Any;

impl Crowd {
    /// Bytes of device memory for the poses of a crowd, in all groups of the mesh. On a direct path one pose,
    /// for captures.
    pub fn pose_bytes(mesh: &PackedMesh, desc: &CrowdDesc) -> u64 {
        poses::bytes(mesh.layouts(), desc)
    }

    /// The buffer of a stream of all poses, with the location and format of each pose. Known before the first update,
    /// and fixed for the crowd's life; [`pose`](Self::pose) returns the current slot of an instance.
    ///
    /// # Errors
    /// A direct path, which has no pose buffers; a stream that the mesh does not have.
    pub fn pose_buffer(&self, semantic: Semantic) -> Result<PoseBuffer> {
        self.check_has_poses()?;
        let (group, place) = place_of(&self.groups, semantic)?;
        Ok(PoseBuffer::new(&self.groups[group].poses, place))
    }

    /// The description that the crowd was created with.
    pub fn desc(&self) -> &CrowdDesc {
        &self.desc
    }

    /// The pose of `instance` after the updates recorded so far.
    ///
    /// # Errors
    /// An instance out of range or removed; no update recorded yet, or its update was discarded; a direct path, which
    /// has no pose buffers.
    pub fn pose(&self, instance: u32) -> Result<PoseView> {
        self.group_pose(instance, 0)
    }

    /// The pose of `instance` before its last update. Equal to the pose if nothing changed, on its first update and
    /// after [`reset_history`](Self::reset_history); `None` if the update had to overwrite it (one slot; several
    /// feedback passes in two slots), and on direct paths.
    ///
    /// # Errors
    /// Those of [`pose`](Self::pose).
    pub fn previous_pose(&self, instance: u32) -> Result<Option<PoseView>> {
        self.previous_group_pose(instance, 0)
    }

    /// A stream of the [pose](Self::pose) of `instance`.
    ///
    /// # Errors
    /// Those of [`pose`](Self::pose); a stream that the mesh does not have.
    pub fn stream(&self, instance: u32, semantic: Semantic) -> Result<StreamView> {
        let (group, place) = place_of(&self.groups, semantic)?;
        Ok(self.group_pose(instance, group)?.stream(place))
    }

    /// A stream of the [previous pose](Self::previous_pose) of `instance`.
    ///
    /// # Errors
    /// Those of [`stream`](Self::stream).
    pub fn previous_stream(&self, instance: u32, semantic: Semantic) -> Result<Option<StreamView>> {
        let (group, place) = place_of(&self.groups, semantic)?;
        Ok(self.previous_group_pose(instance, group)?.map(|pose| pose.stream(place)))
    }

    /// Sets new joints of a skinned instance from the next recorded update on: those at byte `offset` (a multiple of
    /// 16) of the buffer of joints of its [target](crate::after::OutputTarget). The offset may stay the same if the
    /// host's barriers order the writes; for joints written by the host with several frames in flight, it has to
    /// alternate.
    ///
    /// # Errors
    /// An instance out of range or removed, or not skinned; a misaligned offset; joints beyond the end of
    /// their buffer. Nothing changes then.
    pub fn set_joints(&mut self, instance: u32, offset: u64) -> Result<()> {
        self.instances.check(instance)?;
        self.after.set_joints(instance, offset)
    }

    /// Locations of the [output](crate::after::OutputTarget) of an instance after the updates recorded so far.
    ///
    /// # Errors
    /// An instance out of range or removed, or without an output target; no update recorded yet, or its update was
    /// discarded.
    pub fn output(&self, instance: u32) -> Result<OutputView> {
        self.instances.check(instance)?;
        self.after.output(instance)
    }
}

/// Methods of crowds that play clips: others refuse them.
impl Crowd {
    /// Plays a clip from the next recorded update on.
    ///
    /// # Errors
    /// A crowd that plays no clips; an instance or clip out of range; a speed or start that is not finite or too large.
    pub fn play(&mut self, instance: u32, playback: &Playback) -> Result<()> {
        self.instances.check(instance)?;
        let Animated { playbacks, clips, .. } = self.animated_mut()?;
        playbacks.play(instance, playback, clips)
    }

    /// Keeps only the first `level` targets in the crowd's [order of importance](crate::AnimationDesc::importance),
    /// from the next recorded update on; [`lod::Level::step`](crate::lod::Level::step) returns a value for `level`. The
    /// GPU multiplies the weights of clips by the targets' [factors](crate::lod::Importance::factor), in steps of 2⁻¹⁶.
    /// At or above the number of targets all are kept, which is the default.
    ///
    /// A changed level sends 32 bytes to the device, an unchanged one nothing.
    ///
    /// # Errors
    /// A crowd that plays no clips; an instance out of range; a level that is negative or NaN; a crowd created without
    /// an order of importance.
    pub fn set_level(&mut self, instance: u32, level: f32) -> Result<()> {
        self.instances.check(instance)?;
        let Animated { playbacks, clips, .. } = self.animated_mut()?;
        playbacks.set_level(instance, level, clips)
    }

    /// Sets the clock of the next recorded update.
    ///
    /// # Errors
    /// A crowd that plays no clips; `seconds` is not finite or too large; more than 4.5 hours before the start of an
    /// instance's clip.
    pub fn set_time(&mut self, seconds: f64) -> Result<()> {
        self.animated_mut()?.playbacks.set_time(seconds)
    }

    /// Frees the staging memory. Call it when the upload has finished, or if it will never run:
    /// [`create_animated_crowd`](super::MorphEngine::create_animated_crowd) requires that.
    pub fn release_staging(&mut self) {
        if let Ok(animated) = self.animated_mut() {
            animated.staging = None;
        }
    }

    /// The clips of the crowd: lengths, frame rates, and rounding of keys; `None` if it plays none.
    pub fn clips(&self) -> Option<&Clips> {
        self.animated().map(|animated| &animated.clips)
    }

    /// What the device samples and plans with.
    #[doc(hidden)]
    pub fn animated(&self) -> Option<&Animated> {
        let technique: &dyn Any = &*self.technique;
        technique.downcast_ref()
    }

    fn animated_mut(&mut self) -> Result<&mut Animated> {
        let technique: &mut dyn Any = &mut *self.technique;
        let none = || Error::invalid("a crowd that plays no clips", "make it with create_animated_crowd");
        technique.downcast_mut().ok_or_else(none)
    }
}
