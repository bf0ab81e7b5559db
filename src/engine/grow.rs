//! Crowds that get more places.

use super::MorphEngine;
use super::base::sealed::Sealed;
use super::base::{AnyCrowd, DeviceCrowd, OnDevice, Updater};
use super::crowd::{AnimatedCrowd, Crowd, Playing};
use super::set::CrowdSet;
use super::upload::GpuMesh;
use crate::crowd::{CrowdBase, Kind};
use crate::error::{Error, Result};
use crate::gpu::memory::Buffer;
use crate::plan::instances::check_weights;
use crate::update::Runner;
use crate::update::animated::Animated;
use crate::update::crowd::CrowdDesc;
use crate::update::technique::Context;
use ash::vk;

/// What crowds had before they grew: pose buffers, lists, descriptor sets. To be dropped when the device has finished
/// with the updates and draws that were recorded before.
#[must_use = "it is in use until the updates and draws recorded before have finished"]
pub struct Outgrown {
    _before: Vec<Box<dyn AnyCrowd + Send + Sync>>,
}

impl MorphEngine {
    /// Make a crowd anew with more places: `desc` is how, its [`desc`](Crowd::desc) with more
    /// [`instances`](field@CrowdDesc::instances) as a rule. Instances keep their numbers, what is requested of them,
    /// and whether they are hidden; the new places are free, for [`add`](Crowd::add). Tickets stay good.
    ///
    /// Poses are not copied: the next update writes all of them from base, as full evaluations, and each has itself as
    /// previous pose then, as after a cut. Until that update is recorded there is no pose. (A copy would save that one
    /// evaluation, and would have to carry over what each technique knows of every pose, in memory that is laid out
    /// differently.) Memory of both is taken until what is returned is dropped.
    ///
    /// Nothing is recorded. The host calls it between two updates, whether the earlier ones have finished or not.
    ///
    /// # Errors
    /// A crowd that another engine made; fewer places than there are; targets of steps [after](crate::after) the pose,
    /// which are of the poses there are; poses in the vertices of the host's that the crowd has now; else as
    /// [`create_crowd`](Self::create_crowd), and weights that what `desc` says cannot hold. Nothing changes then.
    pub fn grow_crowd(&self, crowd: &mut Crowd, desc: &CrowdDesc) -> Result<Outgrown> {
        let grown = self.grown_crowd(crowd, desc)?;
        Ok(Outgrown { _before: vec![Box::new(std::mem::replace(crowd, grown))] })
    }

    /// [`grow_crowd`](Self::grow_crowd) for a crowd that is animated on the GPU: its instances play on, at the same
    /// time of the same clips. The clips are uploaded anew, since places of a crowd's state depend on how many it has.
    ///
    /// This records what [`create_animated_crowd`](Self::create_animated_crowd) does, and the caller is responsible for
    /// the same: submitting `cmd` before any later update of the crowd, and calling [`AnimatedCrowd::release_staging`]
    /// once it has run.
    ///
    /// # Errors
    /// As [`grow_crowd`](Self::grow_crowd) and [`create_animated_crowd`](Self::create_animated_crowd); another pose
    /// format or largest weight, since keys are on the grid of both. Nothing is recorded then, and nothing changes.
    ///
    /// # Safety
    /// As [`create_animated_crowd`](Self::create_animated_crowd), for `cmd`.
    pub unsafe fn grow_animated_crowd(
        &self,
        cmd: vk::CommandBuffer,
        crowd: &mut AnimatedCrowd,
        desc: &CrowdDesc,
    ) -> Result<Outgrown> {
        let before = crowd.animated();
        // Weights are the GPU's: none are set.
        let grown = self.grown(crowd, desc, Runner::Animated(Some(&self.device.caps)), 0, |context, poses| {
            if Some(context.grid()) != crowd.kind.grid() {
                let text = "a crowd animated on the GPU that is to grow with poses or weights on another grid";
                return Err(Error::invalid(text, "keep its pose format and weight_max: its keys are on their grid"));
            }
            let mut animated = Animated::new(context, before.clips.clone())?;
            animated.playbacks = before.playbacks.grown(desc.instances);
            Ok(Playing::new(animated, poses))
        })?;
        let before = std::mem::replace(crowd, grown);
        // SAFETY: the caller's obligations.
        unsafe { crowd.animated().upload(cmd) };
        Ok(Outgrown { _before: vec![Box::new(before)] })
    }

    /// [`grow_crowd`](Self::grow_crowd) for all crowds of a set, each with its own description and so many places.
    ///
    /// # Errors
    /// As there. Nothing changes then, in no crowd.
    pub fn grow_set(&self, set: &mut CrowdSet, instances: u32) -> Result<Outgrown> {
        let grown = set.crowds.iter().map(|crowd| self.grown_crowd(crowd, &crowd.desc().instances(instances)));
        let grown = grown.collect::<Result<_>>()?;
        let before = std::mem::replace(&mut set.crowds, grown);
        Ok(Outgrown { _before: before.into_iter().map(|crowd| Box::new(crowd) as _).collect() })
    }

    fn grown_crowd(&self, crowd: &Crowd, desc: &CrowdDesc) -> Result<Crowd> {
        let targets = crowd.layout().targets.len();
        let grown = self.grown(crowd, desc, Runner::Device(&self.device.caps), targets, self.weighted())?;
        for weights in grown.instances.present() {
            check_weights(weights, grown.layout(), grown.kind.grid())?;
            grown.technique().check_weights(weights)?;
        }
        Ok(grown)
    }

    /// A crowd in the place of `before`, updated by what `make` makes; `runner` and `targets` are those of its kind.
    fn grown<U: Updater + 'static>(
        &self,
        before: &CrowdBase<OnDevice<U>>,
        desc: &CrowdDesc,
        runner: Runner<'_>,
        targets: usize,
        make: impl FnOnce(Context<'_>, Vec<Buffer>) -> Result<U>,
    ) -> Result<CrowdBase<OnDevice<U>>> {
        let mesh = self.mesh_to_grow_with(before.base(), desc, runner)?;
        let mut grown = CrowdBase::on_device(&self.device, &self.kernels, &mesh, desc, targets, make)?;
        grown.instances = before.instances.grown(desc.instances as usize, desc.update.slots, desc.frames_in_flight);
        (grown.updates, grown.kind.number, grown.kind.recorded) =
            (before.updates, before.kind.number, before.kind.recorded);
        grown.kind.discarded.clone_from(&before.kind.discarded);
        Ok(grown)
    }

    /// The mesh of a crowd, if it can grow as described.
    fn mesh_to_grow_with(&self, before: &DeviceCrowd, desc: &CrowdDesc, runner: Runner<'_>) -> Result<GpuMesh> {
        before.check_device(&self.device)?;
        if desc.instances < before.desc().instances {
            let text = format!("a crowd of {} instances that is to have {}", before.desc().instances, desc.instances);
            return Err(Error::invalid(text, "grow it, or make another crowd"));
        }
        if !before.kind.after.is_empty() {
            let text = "a crowd with targets of steps after the pose that is to grow";
            return Err(Error::invalid(
                text,
                "take them away with set_decode_target or what else set them, grow, and set them again",
            ));
        }
        if desc.poses.is_some() && desc.poses == before.desc().poses {
            let text = "a crowd that is to grow in the vertices of the host's that it has";
            return Err(Error::invalid(text, "name other ones in CrowdDesc::poses: draws may still read these"));
        }
        let mesh = GpuMesh::of(before.groups().iter().map(|group| group.mesh.clone()).collect());
        self.check_crowd(&mesh, desc, runner)?;
        Ok(mesh)
    }
}
