//! Crowds on a device: instances of one mesh whose weights are set, or that play clips on the GPU.

use super::base::{OnDevice, Updater};
use super::poses;
use super::views::{PoseBuffer, PoseView, StreamView};
use crate::after::SkinnedView;
use crate::after::skin::Skin;
use crate::asset::streams::Semantic;
use crate::crowd::{CrowdBase, TakesWeights};
use crate::error::Result;
use crate::gpu::memory::Buffer;
use crate::lod::{Camera, Place};
use crate::pack::PackedMesh;
use crate::update::animated::{Animated, Clips, Playback};
use crate::update::crowd::CrowdDesc;
use crate::update::technique::Technique;

/// Instances of one mesh on the device, whose weights are set. [`MorphEngine`](crate::MorphEngine)
/// says what the caller is responsible for.
pub type Crowd = CrowdBase<OnDevice<Weighted>>;

/// Instances of one mesh on the device that play clips: weights are sampled, planned and applied on the GPU.
/// [`MorphEngine`](crate::MorphEngine) says what the caller is responsible for.
pub type AnimatedCrowd = CrowdBase<OnDevice<Playing>>;

/// What updates a [`Crowd`]: the technique of its path.
pub struct Weighted {
    // Before the buffers that its descriptor sets name.
    technique: Box<dyn Technique>,
    _poses: Vec<Buffer>,
}

/// What updates an [`AnimatedCrowd`].
pub struct Playing {
    // As above.
    animated: Animated,
    _poses: Vec<Buffer>,
}

impl Weighted {
    pub(super) fn new(technique: Box<dyn Technique>, poses: Vec<Buffer>) -> Self {
        Self { technique, _poses: poses }
    }
}

impl Playing {
    pub(super) fn new(animated: Animated, poses: Vec<Buffer>) -> Self {
        Self { animated, _poses: poses }
    }
}

impl Updater for Weighted {
    fn technique(&self) -> &dyn Technique {
        &*self.technique
    }

    fn technique_mut(&mut self) -> &mut dyn Technique {
        &mut *self.technique
    }
}

impl Updater for Playing {
    fn technique(&self) -> &dyn Technique {
        &self.animated
    }

    fn technique_mut(&mut self) -> &mut dyn Technique {
        &mut self.animated
    }
}

impl TakesWeights for OnDevice<Weighted> {
    fn check_weights(&self, weights: &[f32]) -> Result<()> {
        self.updater.technique.check_weights(weights)
    }

    fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()> {
        self.updater.technique.set_error_budget(instance, budget)
    }
}

/// What crowds on a device do: [`Crowd`] and [`AnimatedCrowd`].
impl<U: Updater + ?Sized> CrowdBase<OnDevice<U>> {
    /// Bytes of device memory that the poses of a crowd take, in all groups of the mesh: of buffers of ours, or of
    /// the host's ([`CrowdDesc::poses`]). On a direct path that is one, to capture into.
    pub fn pose_bytes(mesh: &PackedMesh, desc: &CrowdDesc) -> u64 {
        poses::bytes(mesh.groups().iter().map(|group| group.layout()), desc)
    }

    /// The buffer that a stream of all poses is in, where each pose is, and how it is stored: known before the first
    /// update, and the same for the life of the crowd. Which slot an instance's pose is in,
    /// [`pose`](Self::pose) says.
    ///
    /// # Errors
    /// A direct path, which has no pose buffers; a stream that the mesh does not have, or that is not stored in the
    /// host's own vertices.
    pub fn pose_buffer(&self, semantic: Semantic) -> Result<PoseBuffer> {
        self.check_has_poses()?;
        let (group, place) = self.place(semantic)?;
        PoseBuffer::new(&self.groups()[group].poses, place)
    }

    /// How the crowd was made.
    pub fn desc(&self) -> &CrowdDesc {
        &self.kind.desc
    }

    /// The pose of `instance` once the updates recorded so far have run.
    ///
    /// # Errors
    /// An instance out of range or removed; no update recorded yet, or its update was discarded; a direct path,
    /// which has no pose buffers.
    pub fn pose(&self, instance: u32) -> Result<PoseView> {
        self.group_pose(instance, 0)
    }

    /// The pose of `instance` before its last update: the pose itself when nothing changed, on its first
    /// update, and after [`cut`](Self::cut); `None` where the update had to overwrite it (one slot; several
    /// feedback passes in two slots), and on direct paths.
    ///
    /// # Errors
    /// As [`pose`](Self::pose).
    pub fn previous_pose(&self, instance: u32) -> Result<Option<PoseView>> {
        self.previous_group_pose(instance, 0)
    }

    /// A stream of the [pose](Self::pose) of `instance`: any that the mesh has.
    ///
    /// # Errors
    /// As [`pose`](Self::pose); a stream that the mesh does not have, or that is not stored in the host's own
    /// vertices.
    pub fn stream(&self, instance: u32, semantic: Semantic) -> Result<StreamView> {
        let (group, place) = self.place(semantic)?;
        self.group_pose(instance, group)?.stream(place)
    }

    /// A stream of the [previous pose](Self::previous_pose) of `instance`.
    ///
    /// # Errors
    /// As [`stream`](Self::stream).
    pub fn previous_stream(&self, instance: u32, semantic: Semantic) -> Result<Option<StreamView>> {
        let (group, place) = self.place(semantic)?;
        self.previous_group_pose(instance, group)?.map(|pose| pose.stream(place)).transpose()
    }

    /// The joints of a skinned instance moved: from the next recorded update on they are those at `offset` of the
    /// buffer of joints that its [target](crate::after::SkinTarget) names, in bytes, a multiple of 16. It may be
    /// the same place, where the host's barriers see to that; with several frames in flight and joints that the host
    /// writes it has to be one of several in turn.
    ///
    /// # Errors
    /// An instance out of range or removed, or one that is not skinned; joints that reach beyond their buffer.
    /// Nothing changes then.
    pub fn set_joints(&mut self, instance: u32, offset: u64) -> Result<()> {
        self.instances.check(instance)?;
        Skin::set_joints(&mut self.kind.after, instance, offset)
    }

    /// Where the skinned pose of an instance is once the updates recorded so far have run.
    ///
    /// # Errors
    /// An instance out of range or removed, or one that is not skinned; no update recorded yet, or its update was
    /// discarded.
    pub fn skinned(&self, instance: u32) -> Result<SkinnedView> {
        self.instances.check(instance)?;
        Skin::view(&self.kind.after, instance)
    }
}

/// What only crowds do that play clips: [`AnimatedCrowd`].
impl AnimatedCrowd {
    /// Play a clip from the next recorded update on.
    ///
    /// # Errors
    /// An instance or clip out of range; a speed or start that is no number or too large.
    pub fn play(&mut self, instance: u32, playback: &Playback) -> Result<()> {
        self.instances.check(instance)?;
        let Animated { playbacks, clips, .. } = self.animated_mut();
        playbacks.play(instance, playback, clips)
    }

    /// Keep only the first so many targets of the [order](field@crate::AnimationDesc::importance) that the crowd was
    /// made with, from the next recorded update on: what [`lod::Level::step`](crate::lod::Level::step) returns for the
    /// head. The GPU multiplies the weights of clips by the targets' [factors](crate::lod::Importance::factor), in
    /// steps of 2⁻¹⁶. As many as there are, or more, are all of them, as at the beginning.
    ///
    /// A level that changes brings 64 bytes to the device; one that stays is no work. Of a head that [has a
    /// place](Self::set_place) this is the most that is kept.
    ///
    /// # Errors
    /// An instance out of range; a number below 0, or none; a crowd that was made without an order of importance.
    pub fn set_level(&mut self, instance: u32, level: f32) -> Result<()> {
        self.instances.check(instance)?;
        let Animated { playbacks, clips, .. } = self.animated_mut();
        playbacks.set_level(instance, level, clips)
    }

    /// Levels of detail follow this camera from the next recorded update on: those of heads that
    /// [have a place](Self::set_place). Before there is one, they keep all targets.
    ///
    /// # Errors
    /// An invalid camera (non-finite, height or angle out of range); a crowd that was made without
    /// [`AnimationDesc::level`](field@crate::AnimationDesc::level).
    pub fn set_camera(&mut self, camera: &Camera) -> Result<()> {
        let Animated { playbacks, clips, .. } = self.animated_mut();
        playbacks.set_camera(camera, clips)
    }

    /// The camera of the next recorded update looks at something else than before: levels of detail are at their goals
    /// at once, since nothing can pop.
    pub fn cut_camera(&mut self) {
        self.animated_mut().playbacks.cut_camera();
    }

    /// Where `instance` is from the next recorded update on. With its first place it begins to follow the camera: in
    /// each update the GPU works out how many targets it keeps from the pixels that an input unit takes up
    /// ([`lod::Camera::pixels_per_unit`](crate::lod::Camera::pixels_per_unit)), as
    /// [`lod::Level::step`](crate::lod::Level::step) does without weights, in steps of 2⁻¹⁶ targets. With an [error
    /// budget](field@crate::UpdateDesc::error_budget) in the crowd's description, the instance's own is that of its
    /// pixels ([`lod::LevelDesc::error_budget`](crate::lod::LevelDesc::error_budget)), or the crowd's where that is
    /// less.
    ///
    /// A place that changes brings 64 bytes to the device; a camera that moves, nothing but push constants. The
    /// commands stay the same. [`cut`](Self::cut) takes the level to its goal at once.
    ///
    /// # Errors
    /// An instance out of range; an invalid place (non-finite); a crowd that was made without
    /// [`AnimationDesc::level`](field@crate::AnimationDesc::level).
    pub fn set_place(&mut self, instance: u32, place: &Place) -> Result<()> {
        self.instances.check(instance)?;
        let Animated { playbacks, clips, .. } = self.animated_mut();
        playbacks.set_place(instance, place, clips)
    }

    /// The clock is at `seconds` when the next recorded update runs.
    ///
    /// # Errors
    /// No number, or one too large; more than 4.5 hours before some instance starts.
    pub fn set_time(&mut self, seconds: f64) -> Result<()> {
        self.animated_mut().playbacks.set_time(seconds)
    }

    /// Give the staging memory of the clips back.
    ///
    /// # Safety
    /// The upload that [`create_animated_crowd`](super::MorphEngine::create_animated_crowd) recorded has run, or never
    /// will: its copies read the memory.
    pub unsafe fn release_staging(&mut self) {
        self.animated_mut().release_staging();
    }

    /// The clips that instances can play: what their keys lost, and how long they are.
    pub fn clips(&self) -> &Clips {
        &self.animated().clips
    }

    pub(crate) fn animated(&self) -> &Animated {
        &self.kind.updater.animated
    }

    fn animated_mut(&mut self) -> &mut Animated {
        &mut self.kind.updater.animated
    }
}
