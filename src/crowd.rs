//! Crowds of every kind: which instances there are, and which weights are requested of them. Knows no device.

use crate::error::Result;
use crate::pack::PackedLayout;
use crate::pack::blocks::PoseGrid;
use crate::plan::instances::{Instances, check_weight, check_weights, target_named};
use std::ops::Range;

/// Instances of one mesh, updated together: the type behind [`Crowd`](crate::Crowd),
/// [`AnimatedCrowd`](crate::AnimatedCrowd) and [`CpuCrowd`](crate::CpuCrowd), which differ in `K`. It has the methods
/// of all three: first those of every crowd, then those of some kinds.
///
/// Instances are numbered from 0. All are in place and shown when a crowd is made.
pub struct CrowdBase<K: ?Sized> {
    pub(crate) instances: Instances,
    /// Updates planned so far.
    pub(crate) updates: u64,
    pub(crate) kind: K,
}

/// A kind of crowd: where it keeps poses, and how it updates them. It is told what happens to an instance after that
/// was checked.
pub trait Kind {
    /// The layout of positions and normals.
    fn layout(&self) -> &PackedLayout;

    /// The grid of the first group, where poses are fixed-point. Other groups may have other units, and the same
    /// weights.
    fn grid(&self) -> Option<PoseGrid>;

    /// The next pose of an instance has no predecessor.
    fn cut(&mut self, _instance: u32) {}

    /// An instance is hidden from now on, or shown again.
    fn set_hidden(&mut self, _instance: u32, _hidden: bool) {}

    /// A new instance takes a free place.
    fn add(&mut self, instance: u32);

    /// An instance is removed.
    fn remove(&mut self, _instance: u32) {}

    /// See [`CrowdBase::changed`], of the update with this number, which is the last.
    fn changed(&self, instances: &Instances, update: u64, instance: u32, out: &mut Vec<Range<u32>>);
}

/// A kind of crowd whose weights the host sets.
pub trait TakesWeights: Kind {
    /// Refuse weights that the mesh allows, and the technique does not.
    ///
    /// # Errors
    /// As the technique says.
    fn check_weights(&self, _weights: &[f32]) -> Result<()> {
        Ok(())
    }

    /// The error budget of an instance, from the next update on.
    ///
    /// # Errors
    /// No budgets; a number that is not from 0 to the crowd's.
    fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()>;
}

/// What every crowd does.
impl<K: Kind + ?Sized> CrowdBase<K> {
    /// Names, steps and sizes of the mesh: of positions and normals.
    pub fn layout(&self) -> &PackedLayout {
        self.kind.layout()
    }

    /// The next pose of `instance` has no predecessor (it was teleported, say): its previous pose will be the pose
    /// itself, so that motion vectors come out as zero. [`set_hidden`](Self::set_hidden) does this by itself.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn cut(&mut self, instance: u32) -> Result<()> {
        self.instances.cut(instance)?;
        self.kind.cut(instance);
        Ok(())
    }

    /// Hide `instance`, or show it again. A hidden one is left out of updates, whatever is requested of it, and keeps
    /// its pose; shown again, it catches up in the next update, and its previous pose is the pose itself then.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
        if self.instances.set_hidden(instance, hidden)? {
            self.kind.set_hidden(instance, hidden);
        }
        Ok(())
    }

    /// Add an instance, in a place that [`remove`](Self::remove) freed: shown, with all weights 0 and the crowd's error
    /// budget. The next update writes its pose from base. Returns its number. A crowd begins with all its places taken.
    ///
    /// # Errors
    /// No free place.
    pub fn add(&mut self) -> Result<u32> {
        let instance = self.instances.add()?;
        self.kind.add(instance);
        Ok(instance)
    }

    /// Take an instance out of the crowd. Its memory stays the crowd's, for the next to be added.
    ///
    /// # Errors
    /// An instance out of range, or removed before.
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.instances.remove(instance)?;
        self.kind.remove(instance);
        Ok(())
    }

    /// The instances that are shown, ascending.
    pub fn shown(&self) -> impl Iterator<Item = u32> {
        self.instances.requested().zip(0..).filter_map(|(requested, i)| requested.map(|_| i))
    }
}

/// What crowds do whose weights the host sets: [`Crowd`](crate::Crowd) and [`CpuCrowd`](crate::CpuCrowd).
impl<K: TakesWeights> CrowdBase<K> {
    /// Request these weights of `instance`, one per target in the mesh's order, from the next update on.
    ///
    /// # Errors
    /// An instance out of range or removed; a wrong number of weights; one that is not finite or out of range; more
    /// active targets than a draw of `direct-attributes` takes. Nothing changes then.
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        self.check_weights(instance, weights)?;
        self.instances.set_weights(instance, weights)
    }

    pub(crate) fn check_weights(&self, instance: u32, weights: &[f32]) -> Result<()> {
        self.instances.check(instance)?;
        check_weights(weights, self.kind.layout(), self.kind.grid())?;
        self.kind.check_weights(weights)
    }

    /// Request the weight of one target of `instance`, from the next update on; the others stay as requested. `target`
    /// counts in the mesh's order, as [`PackedLayout::target_index`](crate::PackedLayout::target_index) does.
    ///
    /// # Errors
    /// A target out of range; else as [`set_weights`](Self::set_weights). Nothing changes then.
    pub fn set_weight(&mut self, instance: u32, target: usize, weight: f32) -> Result<()> {
        self.instances.check(instance)?;
        check_weight(target, weight, self.kind.layout(), self.kind.grid())?;
        let before = self.instances.set_weight(instance, target, weight)?;
        // A weight of 0 asks for nothing, whatever the others do.
        let checked = match weight == 0.0 {
            true => Ok(()),
            false => self.kind.check_weights(self.instances.weights(instance)?),
        };
        if checked.is_err() {
            self.instances.set_weight(instance, target, before)?;
        }
        checked
    }

    /// Request the weight of the target called `name`, of several the first: as [`set_weight`](Self::set_weight), after
    /// a search through the names.
    ///
    /// # Errors
    /// No such target, with the one that was probably meant; else as [`set_weights`](Self::set_weights).
    pub fn set_weight_by_name(&mut self, instance: u32, name: &str, weight: f32) -> Result<()> {
        let target = target_named(name, self.kind.layout())?;
        self.set_weight(instance, target, weight)
    }

    /// How far a vertex of `instance` may be from where the requested weights would put it, from the next update on, in
    /// place of [`UpdateDesc::error_budget`](field@crate::UpdateDesc::error_budget), which is the most it can be: in
    /// input units. [`lod::LevelDesc::error_budget`](crate::lod::LevelDesc::error_budget) makes it of pixels. What is
    /// deferred beyond a smaller one is applied in the next update. A crowd that grows starts with the budget that it
    /// is made with.
    ///
    /// # Errors
    /// An instance out of range or removed; a number that is not from 0 to the crowd's budget; a path or a delta format
    /// without error budgets.
    pub fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()> {
        self.instances.check(instance)?;
        self.kind.set_error_budget(instance, budget)
    }

    /// The weights requested of `instance`, one per target in the mesh's order, as they were set: fixed-point poses
    /// round them to their grid, and an error budget may hold some back.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn weights(&self, instance: u32) -> Result<&[f32]> {
        self.instances.weights(instance)
    }
}
