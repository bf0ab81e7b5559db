//! The instances of a crowd, planned together, and what the poses of each hold, block by block: what GPU and CPU carry
//! out. `commit` and `emit` are the two phases of an update.

use super::group::{GroupPlan, Unit};
use crate::abi::worklist::Element;
use crate::error::{Error, Result};
use crate::pack::blocks::BlockIndex;
use crate::pack::{POSE_FLOATS, PackedLayout};
use crate::plan::instances::Instances;
use crate::plan::{UpdateDesc, UpdateStats};

/// Plans the instances of a crowd. What blocks hold and which are written is each group's own; slots rotate with those
/// of all groups.
pub struct Planner {
    /// One for each group of the mesh.
    pub groups: Vec<GroupPlan>,
    /// `[group][instance]`.
    states: Vec<Vec<BlockState>>,
    /// The largest error budget of an instance.
    budget_most: f32,
}

impl Planner {
    /// `instances` of a mesh that was packed like this, group by group.
    ///
    /// # Errors
    /// As [`GroupPlan::new`].
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

    /// Plan the update numbered `update` of every instance that is shown.
    pub fn plan(&mut self, instances: &mut Instances, update: u64) {
        self.groups.iter_mut().for_each(GroupPlan::clear);
        for (i, weights, history) in instances.shown() {
            let (known, mut changed) = (history.current().is_some(), false);
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

    /// The error budget of an instance that there is, from the next update on.
    ///
    /// # Errors
    /// More than the crowd was made with; no number, or one below 0.
    pub fn set_error_budget(&mut self, instance: usize, budget: f32) -> Result<()> {
        let most = self.budget_most;
        if !(0.0..=most).contains(&budget) {
            let what = format!("an error budget of {budget} for an instance of a crowd that was made with {most}");
            return Err(Error::invalid(what, "use a number from 0 to that, or make the crowd with a larger one"));
        }
        for (group, states) in self.groups.iter().zip(&mut self.states) {
            // Without lengths there is none, whatever the crowd was made with.
            states[instance].set_budget(budget.min(group.desc.error_budget));
        }
        Ok(())
    }

    /// A new instance takes a free place: its error budget is that of the crowd, and not that of the one before.
    pub fn add(&mut self, instance: usize) {
        for (group, states) in self.groups.iter().zip(&mut self.states) {
            states[instance].set_budget(group.desc.error_budget);
        }
    }

    /// Count the last update. The groups add the same coefficients in the same pass.
    pub fn stats(&self) -> UpdateStats {
        let mut sum = UpdateStats::default();
        for group in &self.groups {
            sum += UpdateStats { coefficients: 0, ..group.stats };
            sum.passes = sum.passes.max(usize::from(!group.list.items.is_empty()));
        }
        UpdateStats { coefficients: self.groups.first().map_or(0, |group| group.stats.coefficients), ..sum }
    }
}

/// What the poses of one instance hold in a group.
#[derive(Clone, Debug)]
pub(crate) struct BlockState {
    /// What was requested last, per target.
    pub(super) requested: Vec<u32>,
    /// What poses hold, per target or per entry.
    pub(super) committed: Vec<u32>,
    /// With an error budget.
    pub(super) per_entry: bool,
    /// The error budget, at most that of the crowd.
    budget: f32,
    /// It is less than it was: what is deferred everywhere has to be looked at.
    pub(super) lowered: bool,
    /// Some change is deferred.
    pub(super) deferred: bool,
    /// Targets requested that differ from the update before.
    pub(super) changed: usize,
    pub(super) largest_weight: f32,
    pub(super) blocks: Vec<BlockSum>,
    /// `[slot][block]`: whether there is anything in `stale`.
    pub(super) is_stale: Vec<bool>,
    /// `[slot][block][component][word]`: what changed since the slot was written, a bit for each vertex.
    pub(super) stale: Vec<u32>,
}

/// What a block of the pose is the sum of.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockSum {
    /// Bound on the position error that accumulation caused.
    pub(super) bound: f32,
    /// The bound beyond which the block is rebuilt.
    pub(super) limit: f32,
    /// The active entries, and their bytes.
    pub(super) active: u32,
    pub(super) active_bytes: u32,
}

impl BlockSum {
    /// The weight of an entry of so many bytes changes.
    pub(super) fn activate(&mut self, bytes: u32, old: u32, new: u32) {
        match (old != 0, new != 0) {
            (false, true) => (self.active, self.active_bytes) = (self.active + 1, self.active_bytes + bytes),
            (true, false) => (self.active, self.active_bytes) = (self.active - 1, self.active_bytes - bytes),
            (false, false) | (true, true) => {}
        }
    }
}

impl BlockState {
    /// All weights are 0, and no slot holds anything.
    pub(crate) fn new(group: &GroupPlan) -> Self {
        let (index, targets) = (&group.index, group.targets);
        // The golden ratio spreads any number of blocks evenly.
        let limit = |b: usize| group.tolerance * (0.25 + 0.75 * (b as f32 * 0.618_034).fract());
        let (slots, per_entry) = (group.desc.slots as usize, group.desc.error_budget > 0.0);
        Self {
            requested: vec![0; targets],
            committed: vec![0; if per_entry { index.entry_count() } else { targets }],
            per_entry,
            budget: group.desc.error_budget,
            lowered: false,
            deferred: false,
            changed: 0,
            largest_weight: 1.0,
            blocks: (0..index.count())
                .map(|b| BlockSum { bound: 0.0, limit: limit(b), active: 0, active_bytes: 0 })
                .collect(),
            is_stale: vec![true; slots * index.count()],
            stale: vec![u32::MAX; slots * index.count() * POSE_FLOATS * index.mask_words()],
        }
    }

    /// The error budget from the next update on.
    fn set_budget(&mut self, budget: f32) {
        self.lowered |= budget < self.budget;
        self.budget = budget;
    }

    /// The error budget.
    pub(super) fn budget(&self) -> f32 {
        self.budget
    }

    /// What the slots hold is not known: the instance has no pose, or was left out of some updates.
    pub(crate) fn forget_slots(&mut self) {
        self.is_stale.fill(true);
        self.stale.fill(u32::MAX);
    }

    /// Count an update.
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

    /// List the active entries of a block; how many there are, and Σ |weight| · reach.
    pub(super) fn list_active(&self, index: &BlockIndex, unit: Unit, block: usize, out: &mut [Element]) -> (u32, f32) {
        let (mut count, mut sum) = (0, 0.0);
        for entry in index.entries(block) {
            let weight = self.committed[if self.per_entry { entry } else { index.parts.entry_target[entry] as usize }];
            if weight != 0 {
                out[count] = Element { entry: entry as u32, coefficient: unit.coefficient(weight, 0) };
                count += 1;
                sum += unit.size(out[count - 1].coefficient) * index.costs[entry].reach;
            }
        }
        (count as u32, sum)
    }
}
