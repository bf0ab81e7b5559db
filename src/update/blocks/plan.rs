//! Plans the instances of a crowd together, for GPU or CPU, and keeps the state of their poses by block. `commit` and
//! `emit` are the two phases of an update.

use super::group::{GroupPlan, Unit};
use crate::abi::worklist::Element;
use crate::error::{Result, ensure};
use crate::pack::PackedLayout;
use crate::pack::blocks::BlockIndex;
use crate::plan::instances::{InstanceState, Instances};
use crate::plan::{UpdateDesc, UpdateStats};
use std::ops::Range;

/// Plans the instances of a crowd. Groups have their own block states and lists; the slots of all groups rotate
/// together.
pub struct Planner {
    /// By group of the mesh.
    pub groups: Vec<GroupPlan>,
    /// `[group][instance]`.
    states: Vec<Vec<BlockState>>,
    /// The crowd's error budget, the upper limit of each instance's.
    budget_most: f32,
}

impl Planner {
    /// Plans `instances` instances of a mesh with these groups.
    ///
    /// # Errors
    /// Errors of [`GroupPlan::new`].
    pub fn new<'a>(
        desc: UpdateDesc,
        groups: impl IntoIterator<Item = &'a PackedLayout>,
        instances: usize,
    ) -> Result<Self> {
        let groups = groups.into_iter().map(|layout| GroupPlan::new(desc, layout, instances));
        let groups = groups.collect::<Result<Vec<_>>>()?;
        let states = groups.iter().map(|group| vec![BlockState::new(group); instances]).collect();
        Ok(Self { states, groups, budget_most: desc.error_budget })
    }

    /// Plans update `update` of every instance that is shown.
    pub fn plan(&mut self, instances: &mut Instances, update: u64) {
        self.groups.iter_mut().for_each(GroupPlan::clear);
        for (i, weights, history) in instances.shown() {
            let known = history.current().is_some();
            let mut changed = false;
            for (group, states) in self.groups.iter_mut().zip(&mut self.states) {
                changed |= states[i].commit(group, i, weights, known);
            }
            let slots = [history.after(0), history.after(1)];
            for (group, states) in self.groups.iter_mut().zip(&mut self.states) {
                match changed {
                    true => states[i].emit(group, i, slots, known),
                    false => states[i].count(group),
                }
            }
            if changed { history.advance(update, [slots[1]]) } else { history.stay(update) }
        }
    }

    /// Statistics of the last update. All groups apply the same coefficients in the same pass.
    pub fn stats(&self) -> UpdateStats {
        let mut sum = UpdateStats::default();
        for group in &self.groups {
            sum += UpdateStats { coefficients: 0, ..group.stats };
            sum.passes = sum.passes.max(usize::from(!group.list.items.is_empty()));
        }
        UpdateStats { coefficients: self.groups.first().map_or(0, |group| group.stats.coefficients), ..sum }
    }
}

impl InstanceState for Planner {
    fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()> {
        let most = self.budget_most;
        let what = || format!("an error budget of {budget} for an instance of a crowd that was made with {most}");
        let remedy = "use a number from 0 to that, or make the crowd with a larger one";
        ensure!((0.0..=most).contains(&budget), what(), remedy);
        for (group, states) in self.groups.iter().zip(&mut self.states) {
            // Without lengths there is no budget.
            states[instance as usize].set_budget(budget.min(group.desc.error_budget));
        }
        Ok(())
    }

    /// Gives it the crowd's error budget.
    fn add(&mut self, instance: u32) {
        for (group, states) in self.groups.iter().zip(&mut self.states) {
            states[instance as usize].set_budget(group.desc.error_budget);
        }
    }

    fn changed(&self, _instances: &Instances, _update: u64, instance: u32, group: usize, out: &mut Vec<Range<u32>>) {
        self.groups[group].changed(instance, out);
    }
}

/// State of an instance's poses in a group.
#[derive(Clone, Debug)]
pub struct BlockState {
    /// Weights requested last, by target.
    pub(super) requested: Vec<u32>,
    /// Committed weights, by target, or by entry if `per_entry`.
    pub(super) committed: Vec<u32>,
    /// There is an error budget.
    pub(super) per_entry: bool,
    /// Entries whose committed weight is not 0, a bit each.
    pub(super) active: Vec<u64>,
    /// The error budget, at most the crowd's.
    pub(super) budget: f32,
    /// The budget was lowered: all deferred changes have to be checked.
    pub(super) lowered: bool,
    pub(super) deferred: bool,
    /// Targets whose requested weight changed in the last update.
    pub(super) changed: usize,
    pub(super) largest_weight: f32,
    pub(super) blocks: Vec<BlockSum>,
    /// `[slot][block]`: whether it changed since the slot was written.
    pub(super) is_stale: Vec<bool>,
}

/// The float32 sum of a block: error bound and active entries.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockSum {
    /// Bound on the position error from accumulation.
    pub bound: f32,
    /// Bound above which the block is rebuilt.
    pub limit: f32,
    /// Active entries, and their bytes.
    pub active: u32,
    pub active_bytes: u32,
}

impl BlockSum {
    /// Counts a change of weight of an entry of `bytes` bytes.
    pub fn activate(&mut self, bytes: u32, old: u32, new: u32) {
        match (old != 0, new != 0) {
            (false, true) => (self.active, self.active_bytes) = (self.active + 1, self.active_bytes + bytes),
            (true, false) => (self.active, self.active_bytes) = (self.active - 1, self.active_bytes - bytes),
            (false, false) | (true, true) => {}
        }
    }
}

impl BlockState {
    /// All weights are 0, and all slots are stale.
    pub fn new(group: &GroupPlan) -> Self {
        let index = &group.index;
        let targets = group.targets;
        // The golden ratio spreads rebuilds of any number of blocks evenly.
        let limit = |b: usize| group.tolerance * (0.25 + 0.75 * (b as f32 * 0.618_034).fract());
        let per_entry = group.desc.error_budget > 0.0;
        Self {
            requested: vec![0; targets],
            committed: vec![0; if per_entry { index.entry_count() } else { targets }],
            per_entry,
            active: vec![0; index.entry_count().div_ceil(64)],
            budget: group.desc.error_budget,
            lowered: false,
            deferred: false,
            changed: 0,
            largest_weight: 1.0,
            blocks: (0..index.count())
                .map(|b| BlockSum { bound: 0.0, limit: limit(b), active: 0, active_bytes: 0 })
                .collect(),
            is_stale: vec![true; group.desc.slots as usize * index.count()],
        }
    }

    fn set_budget(&mut self, budget: f32) {
        self.lowered |= budget < self.budget;
        self.budget = budget;
    }

    /// Adds this state to the group's statistics.
    pub(super) fn count(&self, group: &mut GroupPlan) {
        group.stats.coefficients += self.changed;
        let bound = match group.grid() {
            None => self.blocks.iter().map(|block| block.bound).fold(0.0, f32::max),
            Some(grid) if group.has_lengths => {
                grid.position_error(self.blocks.iter().map(|block| block.active).max().unwrap_or(0) as usize)
            }
            Some(_) => 0.0,
        };
        group.stats.bound = group.stats.bound.max(bound);
    }

    /// Lists the active entries of a block, with their weights as coefficients. Returns their number, and Σ |weight| ·
    /// reach.
    pub(super) fn list_active(&self, index: &BlockIndex, unit: Unit, block: usize, out: &mut [Element]) -> (u32, f32) {
        let mut count = 0;
        let mut sum = 0.0;
        let entries = index.entries(block);
        for word in entries.start / 64..entries.end.div_ceil(64) {
            let from = entries.start.saturating_sub(64 * word);
            let end = (entries.end - 64 * word).min(64);
            let mut active = self.active[word] & u64::MAX << from & u64::MAX >> (64 - end);
            while active != 0 {
                let entry = 64 * word + active.trailing_zeros() as usize;
                active &= active - 1;
                let at = if self.per_entry { entry } else { index.parts.entry_target[entry] as usize };
                let coefficient = unit.coefficient(self.committed[at], 0);
                out[count] = Element { entry: entry as u32, coefficient };
                count += 1;
                sum += unit.size(coefficient) * index.costs[entry].reach;
            }
        }
        (count as u32, sum)
    }
}
