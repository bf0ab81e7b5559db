//! `CrowdBase`: instances and their requested weights, for crowds of all kinds. Independent of devices.

use crate::calls::{Call, CallLog, LogCalls};
use crate::error::{Error, Result};
use crate::pack::PackedLayout;
use crate::pack::blocks::PoseGrid;
use crate::plan::UpdateDesc;
use crate::plan::instances::{Instances, check_weight, check_weights, target_named};
use std::ops::Range;

/// Instances of one mesh, updated together: the common type of [`Crowd`](crate::Crowd),
/// [`AnimatedCrowd`](crate::AnimatedCrowd) and [`CpuCrowd`](crate::CpuCrowd), which differ in `K`. Lists the methods of
/// all three: first those of every crowd, then those of some kinds.
///
/// Instances are numbered from 0. A new crowd has all its instances, all shown.
pub struct CrowdBase<K: ?Sized> {
    pub(crate) instances: Instances,
    /// Updates planned so far.
    pub(crate) updates: u64,
    /// Calls, while they are logged.
    pub(crate) log: Option<Box<dyn LogCalls>>,
    pub(crate) kind: K,
}

/// A kind of crowd: the storage of its poses, and its update. Its methods are called after arguments were checked.
pub trait Kind {
    /// The layout of positions and normals.
    fn layout(&self) -> &PackedLayout;

    /// The grid of the first group, if poses are fixed-point. Other groups have the same weights, but may have other
    /// units.
    fn grid(&self) -> Option<PoseGrid>;

    /// Makes the next pose of an instance its own previous pose.
    fn cut(&mut self, _instance: u32) {}

    /// Hides or shows an instance.
    fn set_hidden(&mut self, _instance: u32, _hidden: bool) {}

    /// Initializes an instance in a free place.
    fn add(&mut self, instance: u32);

    /// Removes an instance.
    fn remove(&mut self, _instance: u32) {}

    /// See [`CrowdBase::changed`]; `update` is the number of the last update.
    fn changed(&self, instances: &Instances, update: u64, instance: u32, out: &mut Vec<Range<u32>>);
}

/// A kind of crowd whose weights the host sets.
pub trait TakesWeights: Kind {
    /// The description that the crowd was created with.
    fn update_desc(&self) -> &UpdateDesc;

    /// Checks weights against limits of the technique beyond those of the mesh.
    ///
    /// # Errors
    /// A limit is exceeded.
    fn check_weights(&self, _weights: &[f32]) -> Result<()> {
        Ok(())
    }

    /// Sets the error budget of an instance, from the next update on.
    ///
    /// # Errors
    /// No budgets; a budget outside 0 to the crowd's.
    fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()>;
}

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
    pub fn cut(&mut self, instance: u32) -> Result<()> {
        self.instances.cut(instance)?;
        self.kind.cut(instance);
        self.log(|| Call::Cut(instance));
        Ok(())
    }

    /// Hides or shows `instance`. A hidden instance keeps its pose and is left out of updates. Once shown, the next
    /// update applies its requested weights, with the new pose as previous pose.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
        if self.instances.set_hidden(instance, hidden)? {
            self.kind.set_hidden(instance, hidden);
            self.log(|| Call::Hidden(instance, hidden));
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
        self.kind.add(instance);
        self.log(|| Call::Add);
        Ok(instance)
    }

    /// Removes an instance. The crowd keeps its memory for the next one added.
    ///
    /// # Errors
    /// An instance out of range or removed.
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.instances.remove(instance)?;
        self.kind.remove(instance);
        self.log(|| Call::Remove(instance));
        Ok(())
    }

    pub(crate) fn log(&mut self, call: impl FnOnce() -> Call) {
        if let Some(log) = &mut self.log {
            log.add(&call());
        }
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
        self.check_weights(instance, weights)?;
        if let Some(log) = &mut self.log {
            log.add_weights(instance, self.instances.weights(instance)?, weights);
        }
        self.instances.set_weights(instance, weights)
    }

    pub(crate) fn check_weights(&self, instance: u32, weights: &[f32]) -> Result<()> {
        self.instances.check(instance)?;
        check_weights(weights, self.kind.layout(), self.kind.grid())?;
        self.kind.check_weights(weights)
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
            false => self.kind.check_weights(self.instances.weights(instance)?),
        };
        if checked.is_err() {
            self.instances.set_weight(instance, target, before)?;
        } else if before.to_bits() != weight.to_bits() {
            self.log(|| Call::Weights(instance, vec![(target as u32, weight)]));
        }
        checked
    }

    /// Sets the requested weight of the first target called `name`: [`set_weight`](Self::set_weight) after a linear
    /// search.
    ///
    /// # Errors
    /// No such target (the message suggests the closest name), and the errors of [`set_weights`](Self::set_weights).
    pub fn set_weight_by_name(&mut self, instance: u32, name: &str, weight: f32) -> Result<()> {
        let target = target_named(name, self.kind.layout())?;
        self.set_weight(instance, target, weight)
    }

    /// Sets the error budget of `instance` from the next update on, in input units; at most
    /// [`UpdateDesc::error_budget`](field@crate::UpdateDesc::error_budget), the default.
    /// [`lod::LevelDesc::error_budget`](crate::lod::LevelDesc::error_budget) converts it from pixels. If it decreases,
    /// the next update applies changes deferred beyond it.
    ///
    /// # Errors
    /// An instance out of range or removed; a value outside 0 to the crowd's budget; a path or a delta format without
    /// error budgets.
    pub fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()> {
        self.instances.check(instance)?;
        self.kind.set_error_budget(instance, budget)?;
        self.log(|| Call::ErrorBudget(instance, budget));
        Ok(())
    }

    /// Starts to log calls on this crowd that decide its poses, such as for a bug report: `deltamorph replay` makes
    /// the same calls on another driver, where fixed-point poses are the same bit for bit. A frame takes some 10 bytes
    /// for each weight that changes. A log that is begun after updates starts with the weights of that time; error
    /// budgets and bases of instances set before are not in it.
    pub fn log_calls(&mut self) {
        let (instances, layout) = (self.instances.count(), self.kind.layout());
        let mut log = CallLog::new(self.kind.update_desc(), instances, layout, self.updates);
        let zero = vec![0.0; layout.targets.len()];
        for (instance, requested) in (0..).zip(self.instances.requested()) {
            match (requested, self.instances.weights(instance)) {
                (None, Err(_)) => log.add(&Call::Remove(instance)),
                (None, Ok(weights)) => {
                    log.add_weights(instance, &zero, weights);
                    log.add(&Call::Hidden(instance, true));
                }
                (Some(weights), _) => log.add_weights(instance, &zero, weights),
            }
        }
        self.log = Some(Box::new(log));
    }

    /// The text logged since [`log_calls`](Self::log_calls) or since it was last taken, to be added to the end of a
    /// file that [`Calls::read`](crate::calls::Calls::read) reads; empty if nothing is logged.
    pub fn take_calls(&mut self) -> String {
        self.log.as_mut().map(|log| log.take()).unwrap_or_default()
    }

    /// Makes a logged call.
    ///
    /// # Errors
    /// Those of the method that it names. [`Call::Update`], which is for the caller to do, and [`Call::Discard`].
    pub fn repeat(&mut self, call: &Call) -> Result<()> {
        match call {
            Call::Weights(instance, weights) => {
                let set = |(target, weight): &(u32, f32)| self.set_weight(*instance, *target as usize, *weight);
                weights.iter().try_for_each(set)
            }
            Call::Cut(instance) => self.cut(*instance),
            Call::Hidden(instance, hidden) => self.set_hidden(*instance, *hidden),
            Call::Add => self.add().map(|_| ()),
            Call::Remove(instance) => self.remove(*instance),
            Call::ErrorBudget(instance, budget) => self.set_error_budget(*instance, *budget),
            Call::Update | Call::Discard(_) => {
                Err(Error::invalid(format!("the call '{call}' to be repeated"), "update the crowd in its place"))
            }
        }
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
