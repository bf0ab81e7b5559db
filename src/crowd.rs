//! `CrowdBase`: instances and their requested weights, for crowds of all kinds. Independent of devices.

use crate::error::Result;
use crate::pack::PackedLayout;
use crate::pack::blocks::PoseGrid;
use crate::plan::instances::{InstanceState, Instances, OutputChange, check_weight, check_weights};

/// Instances of one mesh, updated together: the common type of [`Crowd`](crate::Crowd),
/// [`AnimatedCrowd`](crate::AnimatedCrowd) and [`CpuCrowd`](crate::CpuCrowd), which differ in `K`. Lists the methods of
/// all three: first those of every crowd, then those of some kinds.
///
/// Instances are numbered from 0. A new crowd has all its instances, all shown.
pub struct CrowdBase<K: ?Sized> {
    pub(crate) instances: Instances,
    /// Updates planned so far.
    pub(crate) updates: u64,
    pub(crate) kind: K,
}

/// A kind of crowd: the storage of its poses, and its update. Its methods are called after arguments were checked.
pub trait Kind {
    /// The layout of positions and normals.
    fn layout(&self) -> &PackedLayout;

    /// The grid of the first group, if poses are fixed-point. Other groups have the same weights, but may have other
    /// units.
    fn grid(&self) -> Option<PoseGrid>;

    /// What the planner of updates keeps of each instance.
    fn state(&mut self) -> &mut dyn InstanceState;

    /// Tells steps after the pose what becomes of the outputs of an instance.
    fn change_outputs(&mut self, _instance: u32, _change: OutputChange) {}
}

/// Marks a kind of crowd whose weights the host sets.
pub trait TakesWeights: Kind {}

/// Methods of every crowd.
impl<K: Kind + ?Sized> CrowdBase<K> {
    /// The mesh's layout of positions and normals: names, steps and sizes.
    pub fn layout(&self) -> &PackedLayout {
        self.kind.layout()
    }

    /// Makes the next pose of `instance` its own previous pose, so that its motion vectors are zero, such as after a
    /// teleport. [`set_hidden`](Self::set_hidden) implies it.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn reset_history(&mut self, instance: u32) -> Result<()> {
        self.instances.reset_history(instance)?;
        self.kind.state().reset_history(instance);
        self.kind.change_outputs(instance, OutputChange::Reset);
        Ok(())
    }

    /// Hides or shows `instance`. A hidden instance keeps its pose and is left out of updates. Once shown, the next
    /// update applies its requested weights, with the new pose as previous pose.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
        if self.instances.set_hidden(instance, hidden)? {
            self.kind.state().set_hidden(instance, hidden);
            self.kind.change_outputs(instance, OutputChange::Renewed);
        }
        Ok(())
    }

    /// Adds an instance, in a place that [`remove`](Self::remove) freed, and returns its number: shown, with all
    /// weights 0 and the crowd's error budget. The next update writes its pose from base. A new crowd has no free
    /// places.
    ///
    /// # Errors
    /// No free place.
    pub fn add(&mut self) -> Result<u32> {
        let instance = self.instances.add()?;
        self.kind.state().add(instance);
        Ok(instance)
    }

    /// Removes an instance. The crowd keeps its memory for the next one added.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.instances.remove(instance)?;
        self.kind.state().set_hidden(instance, true);
        self.kind.change_outputs(instance, OutputChange::Removed);
        Ok(())
    }

    /// The instances that are shown, ascending.
    pub fn shown(&self) -> impl Iterator<Item = u32> {
        self.instances.requested().zip(0..).filter_map(|(requested, i)| requested.map(|_| i))
    }
}

/// Methods of crowds with weights set by the host: [`Crowd`](crate::Crowd) and [`CpuCrowd`](crate::CpuCrowd).
impl<K: TakesWeights> CrowdBase<K> {
    /// Sets the requested weights of `instance`, one per target in the mesh's order, from the next update on.
    ///
    /// # Errors
    /// An instance out of range or removed; a wrong number of weights; a weight that is not finite or out of range;
    /// more active targets than a draw of `direct-attributes` supports. Nothing changes then.
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        self.instances.check(instance)?;
        check_weights(weights, self.kind.layout(), self.kind.grid())?;
        self.kind.state().check_weights(weights)?;
        self.instances.set_weights(instance, weights)
    }

    /// Sets the requested weight of one target of `instance`, from the next update on. `target` is an index in the
    /// mesh's order, as of [`PackedLayout::target_index`](crate::PackedLayout::target_index).
    ///
    /// # Errors
    /// A target out of range, and the errors of [`set_weights`](Self::set_weights). Nothing changes then.
    pub fn set_weight(&mut self, instance: u32, target: usize, weight: f32) -> Result<()> {
        self.instances.check(instance)?;
        check_weight(target, weight, self.kind.layout(), self.kind.grid())?;
        let before = self.instances.set_weight(instance, target, weight)?;
        // A weight of 0 cannot exceed a limit of the technique.
        let checked = match weight == 0.0 {
            true => Ok(()),
            false => self.kind.state().check_weights(self.instances.weights(instance)?),
        };
        if checked.is_err() {
            self.instances.set_weight(instance, target, before)?;
        }
        checked
    }

    /// Sets the error budget of `instance` from the next update on, in input units; at most
    /// [`UpdateDesc::error_budget`](crate::UpdateDesc::error_budget), the default.
    /// [`lod::LevelDesc::error_budget`](crate::lod::LevelDesc::error_budget) converts it from pixels. If it decreases,
    /// the next update applies changes deferred beyond it.
    ///
    /// # Errors
    /// An instance out of range or removed; a value outside 0 to the crowd's budget; a path or a delta format without
    /// error budgets.
    pub fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()> {
        self.instances.check(instance)?;
        self.kind.state().set_error_budget(instance, budget)
    }

    /// The requested weights of `instance`, one per target in the mesh's order, as they were set. Applied weights may
    /// differ: fixed-point poses round them to their grid, and an error budget may defer changes.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn weights(&self, instance: u32) -> Result<&[f32]> {
        self.instances.weights(instance)
    }
}
