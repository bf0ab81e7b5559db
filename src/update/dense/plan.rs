//! The plan of the dense formats: which passes bring a pose from the weights it holds to the weights requested.
//!
//! ```text
//! pose_dst = source + Σ c_k · delta_k
//!   incremental   source = the current slot, c = delta weights of the changed targets
//!   rebuild       source = the base pose,    c = weights of the active targets
//! ```

use crate::error::Result;
use crate::pack::PackedLayout;
use crate::pack::blocks::PoseGrid;
use crate::plan::instances::{History, Instances};
use crate::plan::steps::{Source, Steps, Use, Work};
use crate::plan::{BatchSize, UpdateDesc, UpdateMode, UpdateStats};
use crate::weights::delta::{Coefficient, active_targets, changed_targets};

/// The passes of one update of one instance, and what its pose holds after them.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Plan {
    /// What is applied, ascending by target.
    pub coefficients: Vec<Coefficient>,
    /// `destination = source + Σ coefficient · delta` over items of `coefficients`, in order; empty when nothing
    /// changed.
    pub passes: Vec<Work>,
    /// Whether the passes start from the base pose.
    pub rebuilt: bool,
    /// The weights that the pose holds, as far as the history of the instance knows one.
    pub applied: Vec<f32>,
}

impl Plan {
    /// The coefficients of a pass.
    pub(crate) fn coefficients_of(&self, pass: &Work) -> &[Coefficient] {
        &self.coefficients[pass.items.start as usize..pass.items.end as usize]
    }

    /// Forget the passes of the last update.
    fn clear(&mut self) {
        self.coefficients.clear();
        self.passes.clear();
        self.rebuilt = false;
    }

    /// Plan the passes to `weights`, and take them as done by the update numbered `update` (ascending, from 1).
    pub fn fill(&mut self, desc: &UpdateDesc, weights: &[f32], history: &mut History, update: u64) {
        self.clear();
        if history.current().is_some() && self.applied == weights {
            history.stay(update);
            return;
        }
        let current = history.current().filter(|_| desc.mode == UpdateMode::Incremental);
        if current.is_some() {
            changed_targets(weights, &self.applied, &mut self.coefficients);
        }
        let source = match current {
            Some(slot) if weights.iter().filter(|w| **w != 0.0).count() > self.coefficients.len() => Source::Slot(slot),
            // From base where that takes no more targets: as many bytes, and it wipes out accumulated rounding.
            Some(_) | None => {
                self.rebuilt = true;
                self.coefficients.clear();
                active_targets(weights, &mut self.coefficients);
                Source::Base
            }
        };
        self.lay_out_passes(desc, source, history);
        history.advance(update, self.passes.iter().map(|pass| pass.destination));
        self.applied.clear();
        self.applied.extend_from_slice(weights);
    }

    fn lay_out_passes(&mut self, desc: &UpdateDesc, mut source: Source, history: &History) {
        // The passes after the first run in place, or alternate between two slots. With three slots or more the current
        // one is neither of them and survives as the previous pose.
        let first = history.after(1);
        let second = if desc.path.works_in_place() { first } else { history.after(2) };
        let count = self.coefficients.len();
        let size = match desc.batch {
            BatchSize::Targets(batch) => batch as usize,
            BatchSize::All => count,
        };
        for (k, &destination) in (0..desc.batch.passes(count)).zip([first, second].iter().cycle()) {
            let items = (k * size).min(count) as u32..((k + 1) * size).min(count) as u32;
            self.passes.push(Work { source, destination, items, ..Work::default() });
            source = Source::Slot(destination);
        }
    }
}

/// The instances of a crowd, planned together.
#[derive(Clone, Debug)]
pub struct DensePlanner {
    desc: UpdateDesc,
    /// That of the first group, for poses of integers. That of weights is the same in all groups.
    grid: Option<PoseGrid>,
    plans: Vec<Plan>,
    /// Weights on the grid.
    rounded: Vec<f32>,
}

impl DensePlanner {
    /// For so many instances, whose poses are on `grid` where they are integers ([`UpdateDesc::grid`]).
    ///
    /// # Errors
    /// As [`UpdateDesc::check`].
    pub fn new(desc: UpdateDesc, grid: Option<PoseGrid>, instances: usize) -> Result<Self> {
        desc.check()?;
        Ok(Self { desc, grid, plans: vec![Plan::default(); instances], rounded: vec![] })
    }

    /// Plan the update numbered `update` of every instance that is shown.
    pub fn plan(&mut self, instances: &mut Instances, update: u64) {
        self.plans.iter_mut().for_each(Plan::clear);
        for (place, weights, history) in instances.shown() {
            let weights = match self.grid {
                None => weights,
                Some(grid) => {
                    self.rounded.clear();
                    self.rounded.extend(weights.iter().map(|&weight| grid.round(weight)));
                    &self.rounded
                }
            };
            self.plans[place].fill(&self.desc, weights, history, update);
        }
    }

    /// Append the planned passes of `groups` groups to `steps`: the k-th passes of all instances and groups are one
    /// step, which uses `uses`. Passes come from weights alone, and are the same in all groups.
    pub fn fill(&self, groups: usize, uses: &'static [Use], steps: &mut Steps) {
        let rounds = self.plans.iter().map(|plan| plan.passes.len()).max().unwrap_or(0);
        for round in 0..rounds {
            steps.step(uses);
            let passes =
                (0..).zip(&self.plans).filter_map(|(instance, plan)| Some((instance, plan.passes.get(round)?)));
            for (instance, pass) in passes {
                (0..groups as u32).for_each(|group| steps.push(Work { group, instance, ..pass.clone() }));
            }
        }
    }

    /// The coefficients of a work.
    pub fn coefficients(&self, work: &Work) -> &[Coefficient] {
        self.plans[work.instance as usize].coefficients_of(work)
    }

    /// The plans of the last update, by instance.
    pub fn plans(&self) -> &[Plan] {
        &self.plans
    }

    /// Count the last update: each pass reads its source and its targets' deltas, and writes its destination. The least
    /// that any order of the same dense work could move is each instance's pose read and written once, each
    /// coefficient's deltas read once. Of integers nothing is read where a pass starts from the base pose. Bytes are
    /// those of all groups.
    pub fn stats<'a>(&self, groups: impl Iterator<Item = &'a PackedLayout> + Clone) -> UpdateStats {
        let coefficients = self.plans.iter().map(|plan| plan.coefficients.len()).sum();
        let passes = self.plans.iter().map(|plan| plan.passes.len()).sum();
        let changed = self.plans.iter().filter(|plan| !plan.passes.is_empty());
        let rebuilt = changed.clone().filter(|plan| plan.rebuilt).count();
        let unread = if self.grid.is_some() { rebuilt } else { 0 };
        let bytes = |poses: usize| {
            let of = |layout: &PackedLayout| {
                let poses = self.desc.pose.stride() * (2 * poses - unread);
                layout.padded_vertices() * (poses + coefficients * layout.format.stride())
            };
            groups.clone().map(of).sum::<usize>() as u64
        };
        // What rounding may have done to the poses that there are.
        let active = |plan: &Plan| plan.applied.iter().filter(|weight| **weight != 0.0).count();
        let active = self.plans.iter().map(active).max().unwrap_or(0);
        UpdateStats {
            coefficients,
            passes,
            rebuilt,
            bytes_moved: bytes(passes),
            bytes_floor: bytes(changed.count()),
            bound: self.grid.map_or(0.0, |grid| grid.position_error(active)),
            ..UpdateStats::default()
        }
    }

    /// What works read and write, for the hazard checker.
    pub(crate) fn accesses(&self, works: &[Work]) -> Vec<crate::plan::hazards::Accesses> {
        use crate::plan::UpdatePath;
        use crate::plan::hazards::{Accesses, Memory};
        use crate::plan::steps::{Access, Stage};
        let (in_place, captures) = (self.desc.path.works_in_place(), self.desc.path == UpdatePath::Feedback);
        let (read, write) = match (in_place, captures) {
            (true, _) => ((Stage::Compute, Access::ShaderRead), (Stage::Compute, Access::ShaderWrite)),
            (false, true) => {
                ((Stage::VertexInput, Access::AttributeRead), (Stage::TransformFeedback, Access::FeedbackWrite))
            }
            (false, false) => ((Stage::VertexInput, Access::AttributeRead), (Stage::VertexShader, Access::ShaderWrite)),
        };
        let of = |work: &Work| {
            let (instance, group) = (work.instance, work.group);
            let source = match work.source {
                Source::Base => Memory::Base,
                Source::Slot(slot) => Memory::Pose { instance, slot },
            };
            let deltas = (!work.items.is_empty()).then_some(Memory::Deltas);
            let reads = deltas.into_iter().chain([source]).map(|memory| Use::new(memory, read.0, read.1));
            let destination = Memory::Pose { instance, slot: work.destination };
            Accesses { group, uses: reads.chain([Use::new(destination, write.0, write.1)]).collect(), in_place }
        };
        works.iter().map(of).collect()
    }
}
