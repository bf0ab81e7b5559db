//! Crowds that get more places.

use super::MorphEngine;
use super::base::CrowdBase;
use super::crowd::Crowd;
use super::set::CrowdSet;
use super::upload::GpuMesh;
use crate::error::{Error, Result};
use crate::plan::instances::check_weights;
use crate::update::crowd::CrowdDesc;
use crate::update::{Runner, technique};

/// What crowds had before they grew: pose buffers, lists, descriptor sets. To be dropped when the device has finished with the
/// updates and draws that were recorded before.
#[must_use = "it is in use until the updates and draws recorded before have finished"]
pub struct Outgrown {
    _before: Vec<CrowdBase>,
}

impl MorphEngine {
    /// Make a crowd anew with more places: `desc` is how, its [`desc`](Crowd::desc) with more
    /// [`instances`](field@CrowdDesc::instances) as a rule. Instances keep their numbers, what is requested of them, and
    /// whether they are hidden; the new places are free, for [`add`](Crowd::add). Tickets stay good.
    ///
    /// Poses are not copied: the next update writes all of them from base, as full evaluations, and each has itself as
    /// previous pose then, as after a cut. Until that update is recorded there is no pose. (A copy would save that one
    /// evaluation, and would have to carry over what each technique knows of every pose, in memory that is laid out
    /// differently.) Memory of both is taken until what is returned is dropped.
    ///
    /// Nothing is recorded. The host calls it between two updates, whether the earlier ones have finished or not.
    ///
    /// # Errors
    /// A crowd that another engine made; fewer places than there are; targets of steps [after](crate::after) the pose, which are of the poses there are; poses
    /// in the vertices of the host's that the crowd has now; else as [`create_crowd`](Self::create_crowd), and weights that what `desc` says cannot hold. Nothing changes then.
    pub fn grow_crowd(&self, crowd: &mut Crowd, desc: &CrowdDesc) -> Result<Outgrown> {
        let grown = self.grown(crowd, desc)?;
        Ok(Outgrown { _before: vec![std::mem::replace(&mut crowd.base, grown)] })
    }

    /// [`grow_crowd`](Self::grow_crowd) for all crowds of a set, each with its own description and so many places.
    ///
    /// # Errors
    /// As there. Nothing changes then, in no crowd.
    pub fn grow_set(&self, set: &mut CrowdSet, instances: u32) -> Result<Outgrown> {
        let grown = set.crowds.iter().map(|crowd| self.grown(crowd, &crowd.desc().instances(instances)));
        let grown: Vec<CrowdBase> = grown.collect::<Result<_>>()?;
        let crowds = set.crowds.iter_mut().zip(grown);
        Ok(Outgrown { _before: crowds.map(|(crowd, grown)| std::mem::replace(&mut crowd.base, grown)).collect() })
    }

    fn grown(&self, crowd: &Crowd, desc: &CrowdDesc) -> Result<CrowdBase> {
        let before = &crowd.base;
        before.check_device(&self.device)?;
        if desc.instances < before.desc.instances {
            let text = format!("a crowd of {} instances that is to have {}", before.desc.instances, desc.instances);
            return Err(Error::invalid(text, "grow it, or make another crowd"));
        }
        if !before.after.is_empty() {
            let text = "a crowd with targets of steps after the pose that is to grow";
            return Err(Error::invalid(
                text,
                "take them away with set_decode_target or what else set them, grow, and set them again",
            ));
        }
        if desc.poses.is_some() && desc.poses == before.desc.poses {
            let text = "a crowd that is to grow in the vertices of the host's that it has";
            return Err(Error::invalid(text, "name other ones in CrowdDesc::poses: draws may still read these"));
        }
        let mesh = GpuMesh::of(before.groups().iter().map(|group| group.mesh.clone()).collect());
        self.check_crowd(&mesh, desc, Runner::Device(&self.device.caps))?;
        let targets = mesh.layout().targets.len();
        let mut grown = CrowdBase::new(&self.device, &self.kernels, &mesh, desc, targets, technique)?;
        grown.take_over(before)?;
        Ok(grown)
    }
}

impl CrowdBase {
    /// Take the place of `before`, which has no more places than this, and no poses that this has.
    ///
    /// # Errors
    /// Weights that this cannot hold.
    fn take_over(&mut self, before: &Self) -> Result<()> {
        self.instances = before.instances.grown(self.desc.instances as usize, self.desc.update.slots);
        for weights in self.instances.present() {
            check_weights(weights, self.layout(), self.grid())?;
            self.technique.check_weights(weights)?;
        }
        let Self { crowd, updates, recorded, discarded, .. } = before;
        (self.crowd, self.updates, self.recorded, self.discarded) = (*crowd, *updates, *recorded, discarded.clone());
        Ok(())
    }
}
