//! Crowds: instances of one mesh whose weights are set, or that play clips on the GPU.

use super::base::sealed::Sealed;
use super::base::{AnyCrowd, CrowdBase, Ticket};
use super::poses;
use super::views::{PoseBuffer, PoseView, StreamView};
use crate::asset::streams::Semantic;
use crate::error::Result;
use crate::lod::{Camera, Place};
use crate::pack::{PackedLayout, PackedMesh};
use crate::plan::instances::{check_weight, check_weights, target_named};
use crate::update::animated::{Animated, Clips, Playback};
use crate::update::crowd::CrowdDesc;

/// Instances of one mesh on the device, whose weights are set. [`MorphEngine`](crate::MorphEngine)
/// says what the caller is responsible for.
pub struct Crowd {
    pub(crate) base: CrowdBase,
}

/// Instances of one mesh on the device that play clips: weights are sampled, planned and applied on the GPU.
/// [`MorphEngine`](crate::MorphEngine) says what the caller is responsible for.
pub struct AnimatedCrowd {
    pub(crate) base: CrowdBase,
}

/// What every crowd does.
macro_rules! crowd {
    ($crowd:ty) => {
        impl Sealed for $crowd {
            fn base(&self) -> &CrowdBase {
                &self.base
            }

            fn base_mut(&mut self) -> &mut CrowdBase {
                &mut self.base
            }
        }

        impl AnyCrowd for $crowd {}

        impl $crowd {
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
                self.base.pose_buffer(semantic)
            }

            /// How the crowd was made.
            pub fn desc(&self) -> &CrowdDesc {
                &self.base.desc
            }

            /// The next pose of `instance` has no predecessor (it was teleported, say): its previous pose will be the pose
            /// itself, so that motion vectors come out as zero. [`set_hidden`](Self::set_hidden) does this by itself.
            ///
            /// # Errors
            /// An instance out of range or removed.
            pub fn cut(&mut self, instance: u32) -> Result<()> {
                self.base.cut(instance)
            }

            /// Hide `instance`, or show it again. A hidden one is left out of updates, whatever is requested of it, and
            /// keeps its pose; shown again, it catches up in the next update, and its previous pose is the pose itself
            /// then.
            ///
            /// # Errors
            /// An instance out of range or removed.
            pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
                self.base.set_hidden(instance, hidden)
            }

            /// Add an instance, in a place that [`remove`](Self::remove) freed: shown, with all weights 0 and the crowd's
            /// error budget. The next update writes its pose from base. A crowd begins with all its [`CrowdDesc::instances`] in place, and has
            /// no room for more.
            ///
            /// # Errors
            /// No free place.
            pub fn add(&mut self) -> Result<u32> {
                self.base.add()
            }

            /// Take an instance out of the crowd. Its memory stays the crowd's, for the next to be added.
            ///
            /// # Errors
            /// An instance out of range, or removed before.
            pub fn remove(&mut self, instance: u32) -> Result<()> {
                self.base.remove(instance)
            }

            /// The update of `ticket` and all later ones will never run (their command buffers were reset or dropped):
            /// what they would have written is unknown now, and the next update does it again. An update that was
            /// discarded before stays so: nothing changes then.
            ///
            /// That none of them will run is an obligation of the caller, named in the `# Safety` section of
            /// [`record_update`](super::MorphEngine::record_update): the next update takes over the memory of their
            /// lists.
            ///
            /// # Errors
            /// A ticket of another crowd.
            pub fn discard(&mut self, ticket: Ticket) -> Result<()> {
                self.base.discard(ticket)
            }

            /// The instances that are shown, ascending.
            pub fn shown(&self) -> impl Iterator<Item = u32> {
                self.base.shown()
            }

            /// The pose of `instance` once the updates recorded so far have run.
            ///
            /// # Errors
            /// An instance out of range or removed; no update recorded yet, or its update was discarded; a direct path,
            /// which has no pose buffers.
            pub fn pose(&self, instance: u32) -> Result<PoseView> {
                self.base.group_pose(instance, 0)
            }

            /// The pose of `instance` before its last update: the pose itself when nothing changed, on its first
            /// update, and after [`cut`](Self::cut); `None` where the update had to overwrite it (one slot; several
            /// feedback passes in two slots), and on direct paths.
            ///
            /// # Errors
            /// As [`pose`](Self::pose).
            pub fn previous_pose(&self, instance: u32) -> Result<Option<PoseView>> {
                self.base.previous_group_pose(instance, 0)
            }

            /// Vertices that the update recorded last changed in the pose of `instance`, as ranges in the order of pose
            /// buffers: ascending, whole blocks on the path `blocks`; all where only the GPU knows. The last range may
            /// go on behind the last vertex.
            #[cfg(feature = "internals")]
            #[doc(hidden)]
            pub fn changed(&self, instance: u32) -> Vec<std::ops::Range<u32>> {
                self.base.changed(instance)
            }

            /// Count as if so many updates had been recorded and run; epochs begin at the low 32 bits. Lets tests cross the
            /// wraps of numbers, before the first update.
            #[cfg(feature = "internals")]
            #[doc(hidden)]
            pub fn begin_at(&mut self, updates: u64) {
                self.base.begin_at(updates);
            }

            /// A stream of the [pose](Self::pose) of `instance`: any that the mesh has.
            ///
            /// # Errors
            /// As [`pose`](Self::pose); a stream that the mesh does not have, or that is not stored in the host's own
            /// vertices.
            pub fn stream(&self, instance: u32, semantic: Semantic) -> Result<StreamView> {
                let (group, place) = self.base.place(semantic)?;
                self.base.group_pose(instance, group)?.stream(place)
            }

            /// A stream of the [previous pose](Self::previous_pose) of `instance`.
            ///
            /// # Errors
            /// As [`stream`](Self::stream).
            pub fn previous_stream(&self, instance: u32, semantic: Semantic) -> Result<Option<StreamView>> {
                let (group, place) = self.base.place(semantic)?;
                self.base.previous_group_pose(instance, group)?.map(|pose| pose.stream(place)).transpose()
            }
        }
    };
}

crowd!(Crowd);
crowd!(AnimatedCrowd);

impl Crowd {
    /// Request these weights, one per target in the mesh's order, from the next recorded update on.
    ///
    /// # Errors
    /// An instance out of range or removed; a wrong number of weights; one that is not finite or out of range; more
    /// active targets than a draw of `direct-attributes` takes. Nothing changes then.
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        self.check_weights(instance, weights)?;
        self.base.instances.set_weights(instance, weights)
    }

    pub(super) fn check_weights(&self, instance: u32, weights: &[f32]) -> Result<()> {
        self.base.instances.check(instance)?;
        check_weights(weights, self.base.layout(), self.base.grid())?;
        self.base.technique.check_weights(weights)
    }

    /// Request the weight of one target, from the next recorded update on; the others stay as requested. `target` counts
    /// in the mesh's order, as [`PackedLayout::target_index`](crate::PackedLayout::target_index) does.
    ///
    /// # Errors
    /// A target out of range; else as [`set_weights`](Self::set_weights). Nothing changes then.
    pub fn set_weight(&mut self, instance: u32, target: usize, weight: f32) -> Result<()> {
        let base = &mut self.base;
        base.instances.check(instance)?;
        check_weight(target, weight, base.layout(), base.grid())?;
        let before = base.instances.set_weight(instance, target, weight)?;
        // A weight of 0 asks for nothing, whatever the others do.
        let checked = match weight == 0.0 {
            true => Ok(()),
            false => base.technique.check_weights(base.instances.weights(instance)?),
        };
        if checked.is_err() {
            base.instances.set_weight(instance, target, before)?;
        }
        checked
    }

    /// Request the weight of the target called `name`, of several the first: as [`set_weight`](Self::set_weight), after a
    /// search through the names.
    ///
    /// # Errors
    /// No such target, with the one that was probably meant; else as [`set_weights`](Self::set_weights).
    pub fn set_weight_by_name(&mut self, instance: u32, name: &str, weight: f32) -> Result<()> {
        let target = target_named(name, self.base.layout())?;
        self.set_weight(instance, target, weight)
    }

    /// How far a vertex of `instance` may be from where the requested weights would put it, from the next recorded update on, in
    /// place of [`UpdateDesc::error_budget`](field@crate::UpdateDesc::error_budget), which is the most it can be: in input units.
    /// [`lod::LevelDesc::error_budget`](crate::lod::LevelDesc::error_budget) makes it of pixels. What is deferred beyond a smaller one
    /// is applied in the next update. A crowd that grows starts with the budget that it is made with.
    ///
    /// # Errors
    /// An instance out of range or removed; a number that is not from 0 to the crowd's budget; a path without error budgets.
    pub fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()> {
        self.base.instances.check(instance)?;
        self.base.technique.set_error_budget(instance, budget)
    }

    /// The weights requested of `instance`, one per target in the mesh's order, as they were set: poses of integers round
    /// them to their grid, and an error budget may hold some back.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn weights(&self, instance: u32) -> Result<&[f32]> {
        self.base.instances.weights(instance)
    }

    /// Names, steps and sizes of the mesh: of positions and normals.
    pub fn layout(&self) -> &PackedLayout {
        self.base.layout()
    }
}

impl AnimatedCrowd {
    /// Play a clip from the next recorded update on.
    ///
    /// # Errors
    /// An instance or clip out of range; a speed or start that is no number or too large.
    pub fn play(&mut self, instance: u32, playback: &Playback) -> Result<()> {
        self.base.instances.check(instance)?;
        let Animated { playbacks, clips, .. } = self.animated_mut();
        playbacks.play(instance, playback, clips)
    }

    /// Keep only the first so many targets of the [order](field@crate::AnimationDesc::importance) that the crowd was made with,
    /// from the next recorded update on: what [`lod::Level::step`](crate::lod::Level::step) returns for the head. The GPU
    /// multiplies the weights of clips by the targets' [factors](crate::lod::Importance::factor), in steps of 2⁻¹⁶. As many as
    /// there are, or more, are all of them, as at the beginning.
    ///
    /// A level that changes brings 64 bytes to the device; one that stays is no work. Of a head that [has a
    /// place](Self::set_place) this is the most that is kept.
    ///
    /// # Errors
    /// An instance out of range; a number below 0, or none; a crowd that was made without an order of importance.
    pub fn set_level(&mut self, instance: u32, level: f32) -> Result<()> {
        self.base.instances.check(instance)?;
        let Animated { playbacks, clips, .. } = self.animated_mut();
        playbacks.set_level(instance, level, clips)
    }

    /// Levels of detail follow this camera from the next recorded update on: those of heads that
    /// [have a place](Self::set_place). Before there is one, they keep all targets.
    ///
    /// # Errors
    /// A camera that there cannot be; a crowd that was made without [`AnimationDesc::level`](field@crate::AnimationDesc::level).
    pub fn set_camera(&mut self, camera: &Camera) -> Result<()> {
        let Animated { playbacks, clips, .. } = self.animated_mut();
        playbacks.set_camera(camera, clips)
    }

    /// The camera of the next recorded update looks at something else than before: levels of detail are at their goals at
    /// once, since nothing can pop.
    pub fn cut_camera(&mut self) {
        self.animated_mut().playbacks.cut_camera();
    }

    /// Where `instance` is from the next recorded update on. With its first place it begins to follow the camera: in each
    /// update the GPU works out how many targets it keeps from the pixels that an input unit takes up
    /// ([`lod::Camera::pixels_per_unit`](crate::lod::Camera::pixels_per_unit)), as
    /// [`lod::Level::step`](crate::lod::Level::step) does without weights, in steps of 2⁻¹⁶ targets. With an
    /// [error budget](field@crate::UpdateDesc::error_budget) in the crowd's description, the instance's own is that of its
    /// pixels ([`lod::LevelDesc::error_budget`](crate::lod::LevelDesc::error_budget)), or the crowd's where that is less.
    ///
    /// A place that changes brings 64 bytes to the device; a camera that moves, nothing but push constants. The commands
    /// stay the same. [`cut`](Self::cut) takes the level to its goal at once.
    ///
    /// # Errors
    /// An instance out of range; a place that there cannot be; a crowd that was made without
    /// [`AnimationDesc::level`](field@crate::AnimationDesc::level).
    pub fn set_place(&mut self, instance: u32, place: &Place) -> Result<()> {
        self.base.instances.check(instance)?;
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
        let Some(animated) = self.base.technique() else { unreachable!("made so in `create_animated_crowd`") };
        animated
    }

    fn animated_mut(&mut self) -> &mut Animated {
        let Some(animated) = self.base.technique_mut() else { unreachable!("made so in `create_animated_crowd`") };
        animated
    }
}
