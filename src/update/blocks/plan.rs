//! The instances of a crowd, planned together: what GPU and CPU carry out.

use super::group::GroupPlan;
use super::state::BlockState;
use crate::error::Result;
use crate::pack::PackedLayout;
use crate::pack::blocks::ExactGrid;
use crate::plan::instances::Instances;
use crate::plan::{UpdateDesc, UpdateStats};

/// Plans the instances of a crowd. What blocks hold and which are written is each group's own; slots rotate with those of
/// all groups.
pub struct Planner {
    /// One for each group of the mesh.
    pub groups: Vec<GroupPlan>,
    /// `[group][instance]`.
    states: Vec<Vec<BlockState>>,
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
        Ok(Self { states: groups.iter().map(|group| vec![BlockState::new(group); instances]).collect(), groups })
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
            if changed { history.advance(update, [slots[1]]) } else { history.stay() }
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

    /// The grid of exact sums of the first group; that of others may have other steps, and the same largest weight.
    pub fn exact(&self) -> Option<ExactGrid> {
        self.groups.first().and_then(GroupPlan::exact)
    }
}
