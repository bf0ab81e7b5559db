//! The instances of a crowd: presence, requested weights and pose slots.

use crate::error::{Result, ensure, refuse};
use crate::pack::blocks::PoseGrid;
use crate::pack::{PackedLayout, PackedTarget};
use crate::plan::earlier::Earlier;
use std::ops::Range;

/// Largest absolute weight. Beyond it a float32 pose has no digits left for the base.
const WEIGHT_MAX: f32 = 1e6;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Presence {
    Shown,
    Hidden,
    /// Not in use: the next `add` may take it.
    Free,
}

#[derive(Clone, Debug)]
struct Instance {
    presence: Presence,
    weights: Vec<f32>,
    history: History,
}

/// The instances of a crowd, as many as its capacity, each free or in use. Methods that take an instance fail if it is
/// out of range or was removed.
#[derive(Clone, Debug)]
pub struct Instances {
    instances: Vec<Instance>,
}

impl Instances {
    /// `capacity` instances, all shown, all weights 0. `unfinished`: how many updates may be in flight, and so be
    /// discarded.
    pub fn new(capacity: usize, targets: usize, slots: u32, unfinished: u32) -> Self {
        let history = History::new(slots, unfinished);
        let instance = Instance { presence: Presence::Shown, weights: vec![0.0; targets], history };
        Self { instances: vec![instance; capacity] }
    }

    /// Number of instances, free ones included.
    pub fn count(&self) -> usize {
        self.instances.len()
    }

    fn get_mut(&mut self, instance: u32) -> Result<&mut Instance> {
        let i = self.check(instance)?;
        Ok(&mut self.instances[i])
    }

    /// Checks `instance` and returns its index.
    pub fn check(&self, instance: u32) -> Result<usize> {
        match self.instances.get(instance as usize).map(|instance| instance.presence) {
            Some(Presence::Shown | Presence::Hidden) => Ok(instance as usize),
            Some(Presence::Free) => {
                refuse(format!("instance {instance} was removed"), "use the number that `add` returns")
            }
            None => {
                refuse(format!("instance {instance} of a crowd of {}", self.instances.len()), "count instances from 0")
            }
        }
    }

    /// Sets the requested weights of `instance`; the caller has checked them.
    pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        self.get_mut(instance)?.weights.copy_from_slice(weights);
        Ok(())
    }

    /// The requested weights of `instance`.
    pub fn weights(&self, instance: u32) -> Result<&[f32]> {
        Ok(&self.instances[self.check(instance)?].weights)
    }

    /// Sets one requested weight of `instance`, which the caller has checked; returns the old one.
    pub fn set_weight(&mut self, instance: u32, target: usize, weight: f32) -> Result<f32> {
        Ok(std::mem::replace(&mut self.get_mut(instance)?.weights[target], weight))
    }

    /// Makes the next pose of `instance` its own previous pose.
    pub fn reset_history(&mut self, instance: u32) -> Result<()> {
        self.get_mut(instance)?.history.reset();
        Ok(())
    }

    /// Shows or hides `instance`; returns whether that changed. A change also resets its history.
    pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<bool> {
        let instance = self.get_mut(instance)?;
        let new = if hidden { Presence::Hidden } else { Presence::Shown };
        let changed = std::mem::replace(&mut instance.presence, new) != new;
        if changed {
            instance.history.reset();
        }
        Ok(changed)
    }

    /// Takes the first free instance: shown, all weights 0, no pose.
    pub fn add(&mut self) -> Result<u32> {
        let Some(i) = self.instances.iter().position(|instance| instance.presence == Presence::Free) else {
            let text = format!("the crowd has a capacity of {} instances, all in use", self.instances.len());
            return refuse(text, "remove one, or make another crowd of the same mesh");
        };
        let instance = &mut self.instances[i];
        instance.presence = Presence::Shown;
        instance.weights.fill(0.0);
        instance.history.forget();
        Ok(i as u32)
    }

    /// Frees `instance`.
    pub fn remove(&mut self, instance: u32) -> Result<()> {
        self.get_mut(instance)?.presence = Presence::Free;
        Ok(())
    }

    /// Discards update `first` and all later ones.
    pub fn discard_from(&mut self, first: u64) {
        self.instances.iter_mut().for_each(|instance| instance.history.discard_from(first));
    }

    /// Slots of the current and the previous pose of an instance; `None` while it has no pose.
    pub fn slots_of(&self, instance: usize) -> Option<(u32, Option<u32>)> {
        self.instances[instance].history.slots()
    }

    /// Whether an instance holds an instance that is shown.
    pub fn is_shown(&self, instance: usize) -> bool {
        self.instances[instance].presence == Presence::Shown
    }

    /// The update that wrote the pose of an instance; 0 if it has no pose.
    pub fn written_by(&self, instance: usize) -> u64 {
        self.instances[instance].history.written_by
    }

    /// For each instance: the requested weights, or `None` if it is not shown.
    pub fn requested(&self) -> impl Iterator<Item = Option<&[f32]>> {
        self.instances.iter().map(|instance| (instance.presence == Presence::Shown).then_some(&instance.weights[..]))
    }

    /// The instances that are shown: index, requested weights and history.
    pub fn shown(&mut self) -> impl Iterator<Item = (usize, &[f32], &mut History)> {
        let shown = self.instances.iter_mut().enumerate().filter(|(_, instance)| instance.presence == Presence::Shown);
        shown.map(|(i, instance)| (i, &instance.weights[..], &mut instance.history))
    }
}

/// What a planner of updates keeps of each instance, beside [`Instances`]: it is told of changes after their arguments
/// were checked.
pub trait InstanceState {
    /// Makes the next pose of an instance its own previous pose.
    fn reset_history(&mut self, _instance: u32) {}

    /// Hides, removes or shows an instance.
    fn set_hidden(&mut self, _instance: u32, _hidden: bool) {}

    /// Initializes an instance in a free instance.
    fn add(&mut self, _instance: u32) {}

    /// Sets the error budget of an existing instance, from the next update on.
    ///
    /// # Errors
    /// There are no budgets, or the value is outside 0 to the crowd's.
    fn set_error_budget(&mut self, _instance: u32, budget: f32) -> Result<()> {
        let what = format!("an error budget of {budget} for an instance of a crowd that has none");
        refuse(what, "use the path blocks or cpu, with a mesh in a block format")
    }

    /// # Errors
    /// The weights are those of clips.
    fn check_takes_weights(&self) -> Result<()> {
        Ok(())
    }

    /// Checks weights against limits beyond those of the mesh.
    ///
    /// # Errors
    /// A limit is exceeded.
    fn check_weights(&self, _weights: &[f32]) -> Result<()> {
        Ok(())
    }

    /// Vertices of a group that update `update`, which was planned last, changed in the pose of a shown
    /// instance, as ascending ranges that may extend beyond the last vertex.
    fn changed(&self, instances: &Instances, update: u64, instance: u32, _group: usize, out: &mut Vec<Range<u32>>) {
        let written = instances.written_by(instance as usize);
        out.extend((written > 0 && written == update).then_some(0..u32::MAX));
    }
}

/// The slots of an instance's poses. An update reads the current slot and writes the next.
#[derive(Clone, Debug)]
pub struct History {
    slots: u32,
    /// The slot written last by an update that was not discarded, even if its pose was lost since.
    current: u32,
    earlier: Earlier<u32>,
    previous: Option<u32>,
    /// The update that wrote the current slot, counted from 1; 0 if there is no valid pose.
    written_by: u64,
    is_reset: bool,
    /// The last update after a reset that changed nothing; 0 if there is none.
    stayed_after_reset: u64,
}

impl History {
    /// No pose yet. `unfinished`: how many updates may be in flight, and so be discarded.
    pub fn new(slots: u32, unfinished: u32) -> Self {
        let current = slots - 1;
        let earlier = Earlier::new(unfinished);
        Self { slots, current, earlier, previous: None, written_by: 0, is_reset: false, stayed_after_reset: 0 }
    }

    /// The slot of the pose; `None` before the first update and after a discarded one.
    pub fn current(&self) -> Option<u32> {
        (self.written_by > 0).then_some(self.current)
    }

    /// The slot `steps` after the one written last, cyclically.
    pub fn after(&self, steps: u32) -> u32 {
        (self.current + steps) % self.slots
    }

    /// Slots of the current and the previous pose; `None` while there is no pose. The previous pose is the current one
    /// if nothing changed, for the first pose and after a reset; `None` if the update overwrote it.
    pub fn slots(&self) -> Option<(u32, Option<u32>)> {
        self.current().map(|current| (current, self.previous))
    }

    /// Update `update` (ascending, from 1) changes nothing.
    pub fn stay(&mut self, update: u64) {
        if std::mem::take(&mut self.is_reset) {
            self.stayed_after_reset = update;
        }
        self.previous = Some(self.current);
    }

    /// Update `update` writes the slots `written`; the last one holds the pose.
    pub fn advance(&mut self, update: u64, written: impl IntoIterator<Item = u32>) {
        let known = self.current();
        let is_reset = std::mem::take(&mut self.is_reset);
        self.earlier.push(update, self.current);
        let mut overwritten = false;
        for slot in written {
            overwritten |= known == Some(slot);
            self.current = slot;
        }
        self.written_by = update;
        self.previous = match known {
            Some(before) if !is_reset => (!overwritten).then_some(before),
            Some(_) | None => Some(self.current),
        };
    }

    /// Makes the next pose its own previous pose (the instance was hidden, or teleported).
    pub fn reset(&mut self) {
        self.is_reset = true;
    }

    /// Marks the pose as lost: the next update rebuilds it.
    fn forget(&mut self) {
        self.written_by = 0;
    }

    /// Discards update `first` and all later ones: the pose is lost if one of them wrote it, the next update writes the
    /// slot that the first of them would have written, and a reset that they had used up applies again.
    pub fn discard_from(&mut self, first: u64) {
        if let Some(before) = self.earlier.discard_from(first) {
            self.current = before;
        }
        if self.written_by >= first {
            self.forget();
        }
        if self.stayed_after_reset >= first {
            (self.is_reset, self.stayed_after_reset) = (true, 0);
        }
    }
}

/// What becomes of the outputs that post-morph passes write for an instance.
#[derive(Clone, Copy, Debug)]
pub enum OutputChange {
    /// The next one is its own previous output.
    Reset,
    /// All is written anew, since the instance was hidden or shown.
    Renewed,
    /// Nothing is written, since the instance was removed.
    Removed,
}

/// Checks weights: one per target, each within the limits of [`check_weight`].
///
/// # Errors
/// A wrong number of weights, or one out of range; the message names it.
pub(crate) fn check_weights(weights: &[f32], layout: &PackedLayout, grid: Option<PoseGrid>) -> Result<()> {
    let what = || format!("{} weights given, but the mesh has {} targets", weights.len(), layout.targets.len());
    let remedy = "pass one weight for each target, in the order of the mesh";
    ensure!(weights.len() == layout.targets.len(), what(), remedy);
    weights.iter().enumerate().try_for_each(|(target, &weight)| check_weight(target, weight, layout, grid))
}

/// The remedy for a weight that the grid of fixed-point poses does not hold.
pub(crate) fn out_of_grid(most: f32) -> String {
    format!("fixed-point poses hold weights from -{most} to {most} here: use a larger weight_max")
}

/// Checks the weight of one target: finite, within ±[`WEIGHT_MAX`] and the grid of fixed-point poses.
///
/// # Errors
/// No such target, or a weight out of range.
pub(crate) fn check_weight(target: usize, weight: f32, layout: &PackedLayout, grid: Option<PoseGrid>) -> Result<()> {
    let Some(PackedTarget { name, .. }) = layout.targets.get(target) else {
        let text = format!("target {target} of mesh '{}', which has {}", layout.name, layout.targets.len());
        return refuse(text, "count targets from 0");
    };
    let most = grid.map_or(WEIGHT_MAX, |grid| grid.weight_max);
    if weight.abs() <= most {
        return Ok(());
    }
    let remedy = match grid {
        None => format!("weights may be negative or above one, but must be numbers from -{most} to {most}"),
        Some(_) => out_of_grid(most),
    };
    refuse(format!("the weight of target {target} ('{name}') is {weight}"), remedy)
}
