//! Plans for dense formats: the passes from the applied weights of a pose to the requested weights.
//!
//! ```text
//! pose_dst = source + Σ c_k · delta_k
//!   incremental   source = the current slot, c = delta weights of the changed targets
//!   rebuild       source = the base pose,    c = weights of the active targets
//! ```

use crate::error::Result;
use crate::pack::PackedLayout;
use crate::plan::instances::{History, InstanceState, Instances};
use crate::plan::steps::{Source, Steps, Use, Work};
use crate::plan::{BatchSize, UpdateDesc, UpdateMode, UpdateStats};
use crate::weights::delta::{Coefficient, active_targets, changed_targets};

/// The passes of an instance's last update, and its applied weights.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Plan {
    /// Coefficients, ascending by target.
    pub coefficients: Vec<Coefficient>,
    /// `destination = source + Σ coefficient · delta` over the `items` of `coefficients`, in order; empty if nothing
    /// changed.
    pub passes: Vec<Work>,
    /// Whether the first pass starts from the base pose.
    pub rebuilt: bool,
    /// The applied weights, if the history has a valid pose.
    pub applied: Vec<f32>,
}

impl Plan {
    pub(crate) fn coefficients_of(&self, pass: &Work) -> &[Coefficient] {
        &self.coefficients[pass.items.start as usize..pass.items.end as usize]
    }

    fn clear(&mut self) {
        self.coefficients.clear();
        self.passes.clear();
        self.rebuilt = false;
    }

    /// Plans the passes to `weights`, and records update `update` (ascending, from 1) in the history.
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
            // From base if that takes no more targets: it moves as many bytes, and discards accumulated rounding.
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
        // Passes after the first run in place, or alternate between two slots. With three or more slots, the current
        // one is neither and remains the previous pose.
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

/// Plans the instances of a crowd together.
#[derive(Clone, Debug)]
pub struct DensePlanner {
    desc: UpdateDesc,
    plans: Vec<Plan>,
}

impl InstanceState for DensePlanner {}

impl DensePlanner {
    /// For `instances` instances.
    ///
    /// # Errors
    /// Errors of [`UpdateDesc::check`].
    pub fn new(desc: UpdateDesc, instances: usize) -> Result<Self> {
        desc.check()?;
        Ok(Self { desc, plans: vec![Plan::default(); instances] })
    }

    /// Plans update `update` of every instance that is shown.
    pub fn plan(&mut self, instances: &mut Instances, update: u64) {
        self.plans.iter_mut().for_each(Plan::clear);
        for (place, weights, history) in instances.shown() {
            self.plans[place].fill(&self.desc, weights, history, update);
        }
    }

    /// Appends the planned passes of `groups` groups to `steps`: the k-th passes of all instances and groups form a
    /// step with these `uses`. Passes depend only on weights, so all groups have the same.
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

    /// Plans of the last update, by instance.
    pub fn plans(&self) -> &[Plan] {
        &self.plans
    }

    /// Statistics of the last update, in bytes of all groups. Each pass reads its source and its targets' deltas, and
    /// writes its destination. Lower bound for the same dense work: each instance's pose read and written once, each
    /// coefficient's deltas read once.
    pub fn stats<'a>(&self, groups: impl Iterator<Item = &'a PackedLayout> + Clone) -> UpdateStats {
        let coefficients = self.plans.iter().map(|plan| plan.coefficients.len()).sum();
        let passes = self.plans.iter().map(|plan| plan.passes.len()).sum();
        let changed = self.plans.iter().filter(|plan| !plan.passes.is_empty());
        let rebuilt = changed.clone().filter(|plan| plan.rebuilt).count();
        let bytes = |poses: usize| {
            let of = |layout: &PackedLayout| {
                let poses = self.desc.pose.stride() * 2 * poses;
                layout.padded_vertices() * (poses + coefficients * layout.format.stride())
            };
            groups.clone().map(of).sum::<usize>() as u64
        };
        UpdateStats {
            coefficients,
            passes,
            rebuilt,
            bytes_moved: bytes(passes),
            bytes_floor: bytes(changed.count()),
            ..UpdateStats::default()
        }
    }
}
