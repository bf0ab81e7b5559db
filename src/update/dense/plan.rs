//! The plan of the dense formats: which passes bring a pose from the weights it holds to the weights requested.
//!
//! ```text
//! pose_dst = source + Σ c_k · delta_k
//!   incremental   source = the current slot, c = delta weights of the changed targets
//!   rebuild       source = the base pose,    c = weights of the active targets
//! ```

use crate::error::Result;
use crate::pack::{PackedLayout, PoseFormat};
#[cfg(any(test, feature = "internals"))]
use crate::plan::hazards::{Accesses, Memory, MemoryUse};
use crate::plan::instances::Instances;
#[cfg(any(test, feature = "internals"))]
use crate::plan::steps::{Access, Stage};
use crate::plan::steps::{Resource, Source, Steps, Use, Work};
use crate::plan::{BatchSize, UpdateDesc, UpdateMode, UpdateStats};
use crate::weights::delta::{Coefficient, active_targets, changed_targets};
use std::ops::Range;

/// `destination = source + Σ coefficient · delta` over a range of the plan's coefficients.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pass {
    /// What it adds to.
    pub source: Source,
    /// The slot it writes.
    pub destination: u32,
    /// Which of [`Plan::coefficients`] it adds.
    pub coefficients: Range<usize>,
}

/// The passes of one update of one instance.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Plan {
    /// What is applied, ascending by target.
    pub coefficients: Vec<Coefficient>,
    /// In order; empty when nothing changed.
    pub passes: Vec<Pass>,
    /// The slot that holds the pose afterwards.
    pub result: u32,
    /// The slot that holds the previous pose afterwards: `result` where there is none to tell apart (nothing
    /// changed, first pose, cut); `None` where the update had to overwrite it.
    pub previous: Option<u32>,
    /// Whether the passes start from the base pose.
    pub rebuilt: bool,
}

impl Plan {
    /// Forget the passes of the last update.
    pub(crate) fn clear(&mut self) {
        self.coefficients.clear();
        self.passes.clear();
        self.rebuilt = false;
    }
}

/// What the pose buffers of one instance hold.
#[derive(Clone, Debug)]
pub struct PoseState {
    desc: UpdateDesc,
    /// Weights applied to each slot; `None` = unknown.
    applied: Vec<Option<Vec<f32>>>,
    /// Number of the last update that wrote each slot.
    written_by: Vec<u64>,
    current: Option<u32>,
    cut: bool,
}

impl PoseState {
    /// Nothing known yet: the first plan rebuilds.
    ///
    /// # Errors
    /// As [`UpdateDesc::check`].
    pub fn new(desc: UpdateDesc) -> Result<Self> {
        desc.check()?;
        let slots = desc.slots as usize;
        Ok(Self { desc, applied: vec![None; slots], written_by: vec![0; slots], current: None, cut: false })
    }

    /// The weights that the current slot holds; `None` before the first update and after a discarded one.
    pub fn applied(&self) -> Option<&[f32]> {
        self.applied[self.current? as usize].as_deref()
    }

    /// The next pose has no predecessor (the head was hidden or teleported): its previous pose is itself.
    pub fn cut(&mut self) {
        self.cut = true;
    }

    /// The update numbered `first` and all later ones will never run: what they wrote is unknown.
    pub fn discard_from(&mut self, first: u64) {
        for (applied, &by) in self.applied.iter_mut().zip(&self.written_by) {
            if by >= first {
                *applied = None;
            }
        }
    }

    /// No slot is known any longer: the next plan rebuilds.
    pub fn forget(&mut self) {
        self.discard_from(0);
    }

    /// Plan the passes to `weights` into `plan`, and take them as done by the update numbered `update`
    /// (ascending, from 1).
    pub fn plan(&mut self, weights: &[f32], update: u64, plan: &mut Plan) {
        plan.clear();
        let known = self.current.filter(|&c| self.applied[c as usize].is_some());
        let cut = std::mem::take(&mut self.cut);

        if let Some(current) = known
            && self.applied[current as usize].as_deref() == Some(weights)
        {
            plan.result = current;
            plan.previous = Some(current);
            return;
        }

        plan.rebuilt = self.choose_coefficients(known, weights, &mut plan.coefficients);
        let source = match known {
            Some(current) if !plan.rebuilt => Source::Slot(current),
            _ => Source::Base,
        };
        self.lay_out_passes(source, plan);

        for pass in &plan.passes {
            self.applied[pass.destination as usize] = None;
            self.written_by[pass.destination as usize] = update;
        }
        let overwritten = |slot: u32| plan.passes.iter().any(|p| p.destination == slot);
        plan.previous = match known {
            Some(current) if !cut => Some(current).filter(|&c| !overwritten(c)),
            _ => Some(plan.result),
        };
        self.applied[plan.result as usize] = Some(weights.to_vec());
        self.current = Some(plan.result);
    }

    /// Fill `out` with delta weights, or with weights where the update starts from base; tells which.
    fn choose_coefficients(&self, known: Option<u32>, weights: &[f32], out: &mut Vec<Coefficient>) -> bool {
        if let (UpdateMode::Incremental, Some(applied)) =
            (self.desc.mode, known.and_then(|c| self.applied[c as usize].as_deref()))
        {
            changed_targets(weights, applied, out);
            // From base where that takes no more targets: as many bytes, and it wipes out accumulated rounding.
            if weights.iter().filter(|w| **w != 0.0).count() > out.len() {
                return false;
            }
            out.clear();
        }
        active_targets(weights, out);
        true
    }

    fn lay_out_passes(&self, source: Source, plan: &mut Plan) {
        let slots = self.desc.slots;
        let current = self.current.unwrap_or(slots - 1);
        let first = (current + 1) % slots;
        // Where the passes after the first go: in place, or to and fro between two slots. With three slots or
        // more the current one is neither of them and survives as the previous pose.
        let second = if self.desc.path.works_in_place() { first } else { (current + 2) % slots };
        let count = plan.coefficients.len();
        let passes = self.desc.batch.passes(count);
        let size = match self.desc.batch {
            BatchSize::Targets(b) => b as usize,
            BatchSize::All => count,
        };
        let mut from = source;
        for k in 0..passes {
            let destination = if k % 2 == 0 { first } else { second };
            let coefficients = (k * size).min(count)..((k + 1) * size).min(count);
            plan.passes.push(Pass { source: from, destination, coefficients });
            from = Source::Slot(destination);
            plan.result = destination;
        }
    }
}

/// What a compute pass uses.
pub const COMPUTE_PASS: &[Use] = &[Use::read(Resource::Asset), Use::read(Resource::Poses), Use::write(Resource::Poses)];

/// The instances of a crowd, planned together.
#[derive(Clone, Debug)]
pub struct DensePlanner {
    states: Vec<PoseState>,
    plans: Vec<Plan>,
    /// What the passes of all instances add.
    coefficients: Vec<Coefficient>,
    pose: PoseFormat,
}

impl DensePlanner {
    /// `instances` of which nothing is known yet.
    ///
    /// # Errors
    /// As [`UpdateDesc::check`].
    pub fn new(desc: UpdateDesc, instances: usize) -> Result<Self> {
        let states = vec![PoseState::new(desc)?; instances];
        Ok(Self { states, plans: vec![Plan::default(); instances], coefficients: vec![], pose: desc.pose })
    }

    /// Plan the update numbered `update` of every instance that is shown.
    pub(crate) fn plan(&mut self, instances: &Instances, update: u64) {
        self.coefficients.clear();
        for ((state, requested), plan) in self.states.iter_mut().zip(instances.requested()).zip(&mut self.plans) {
            match requested {
                Some(weights) => state.plan(weights, update, plan),
                None => plan.clear(),
            }
        }
    }

    /// Append the planned passes of `groups` groups to `steps`: the k-th passes of all instances and groups are one step,
    /// which uses `uses`. Passes come from weights alone, and are the same in all groups.
    pub fn fill(&mut self, groups: usize, uses: &'static [Use], steps: &mut Steps) {
        let rounds = self.plans.iter().map(|plan| plan.passes.len()).max().unwrap_or(0);
        for round in 0..rounds {
            steps.step(uses);
            for instance in 0..self.plans.len() {
                let Some(pass) = self.plans[instance].passes.get(round) else { continue };
                let (source, destination, range) = (pass.source, pass.destination, pass.coefficients.clone());
                let items = self.list(instance, range);
                for group in 0..groups as u32 {
                    let (instance, items) = (instance as u32, items.clone());
                    steps.push(Work { kernel: 0, group, instance, source, destination, items });
                }
            }
        }
    }

    /// Append coefficients of an instance's plan to those that works name.
    pub(crate) fn list(&mut self, instance: usize, range: Range<usize>) -> Range<u32> {
        let first = self.coefficients.len() as u32;
        self.coefficients.extend_from_slice(&self.plans[instance].coefficients[range]);
        first..self.coefficients.len() as u32
    }

    /// The coefficients of a work.
    pub fn coefficients(&self, work: &Work) -> &[Coefficient] {
        &self.coefficients[work.items.start as usize..work.items.end as usize]
    }

    /// The plans of the last update.
    #[cfg(any(test, feature = "baselines"))]
    pub fn plans(&self) -> &[Plan] {
        &self.plans
    }

    /// Whether the last update changes some pose.
    #[cfg(any(test, feature = "baselines"))]
    pub(crate) fn has_changed(&self) -> bool {
        self.plans.iter().any(|plan| !plan.passes.is_empty())
    }

    /// Count the last update: each pass reads its source and its targets' deltas, and writes its destination. The least
    /// that any order of the same dense work could move is each instance's pose read and written once, each
    /// coefficient's deltas read once. Bytes are those of all groups.
    pub fn stats<'a>(&self, groups: impl Iterator<Item = &'a PackedLayout> + Clone) -> UpdateStats {
        let coefficients = self.coefficients.len();
        let passes = self.plans.iter().map(|plan| plan.passes.len()).sum();
        let changed = self.plans.iter().filter(|plan| !plan.passes.is_empty());
        let bytes = |poses: usize| {
            let of = |layout: &PackedLayout| {
                layout.padded_vertices() * (2 * self.pose.stride() * poses + coefficients * layout.format.stride())
            };
            groups.clone().map(of).sum::<usize>() as u64
        };
        UpdateStats {
            coefficients,
            passes,
            rebuilt: changed.clone().filter(|plan| plan.rebuilt).count(),
            bytes_moved: bytes(passes),
            bytes_floor: bytes(changed.count()),
            ..UpdateStats::default()
        }
    }

    /// The weights that the current pose of an instance holds.
    #[cfg(any(test, feature = "baselines"))]
    pub(crate) fn applied(&self, instance: usize) -> Option<&[f32]> {
        self.states[instance].applied()
    }

    /// Slots of the pose and of the previous pose of an instance; `None` while there is no pose.
    pub(crate) fn slots_of(&self, instance: usize) -> Option<(u32, Option<u32>)> {
        let plan = &self.plans[instance];
        self.states[instance].applied().map(|_| (plan.result, plan.previous))
    }

    /// The next pose of an instance has no predecessor.
    pub(crate) fn cut(&mut self, instance: usize) {
        self.states[instance].cut();
    }

    /// Nothing is known of an instance any longer.
    pub(crate) fn forget(&mut self, instance: usize) {
        self.states[instance].forget();
    }

    /// The update numbered `first` and all later ones will never run.
    pub(crate) fn discard_from(&mut self, first: u64) {
        self.states.iter_mut().for_each(|state| state.discard_from(first));
    }
}

/// What dense passes read and write, with these stages and accesses.
#[cfg(any(test, feature = "internals"))]
pub(crate) fn pass_accesses(
    works: &[Work],
    (read_stage, read): (Stage, Access),
    (write_stage, written): (Stage, Access),
    in_place: bool,
) -> Vec<Accesses> {
    let of = |work: &Work| {
        let (instance, group) = (work.instance, work.group);
        let read = |memory| MemoryUse { group, memory, stage: read_stage, access: read };
        let source = match work.source {
            Source::Base => Memory::Base,
            Source::Slot(slot) => Memory::Pose { instance, slot },
        };
        let deltas = (!work.items.is_empty()).then_some(Memory::Deltas);
        let destination = Memory::Pose { instance, slot: work.destination };
        Accesses {
            reads: deltas.into_iter().chain([source]).map(read).collect(),
            writes: vec![MemoryUse { group, memory: destination, stage: write_stage, access: written }],
            in_place,
        }
    };
    works.iter().map(of).collect()
}

/// What compute passes read and write.
#[cfg(any(test, feature = "internals"))]
pub(crate) fn compute_accesses(works: &[Work]) -> Vec<Accesses> {
    pass_accesses(works, (Stage::Compute, Access::ShaderRead), (Stage::Compute, Access::ShaderWrite), true)
}
