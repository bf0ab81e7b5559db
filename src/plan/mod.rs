//! Which passes bring a pose buffer from the weights it holds to the weights asked for.
//!
//! Pure: no Vulkan here. [`PoseState::plan`] turns weights into passes, [`commands`] turns passes into commands
//! and barriers as data, which a back end (`gpu`, `cpu`) carries out as they are. Since they are data, tests hold
//! them to [`hazards`]: every access has to be ordered.
//!
//! ```text
//! pose_dst = source + Σ c_k · delta_k
//!   incremental   source = the current slot, c = delta weights of the changed targets
//!   rebuild       source = the base pose,    c = weights of the active targets
//! ```

pub mod animated;
pub mod blocks;
pub mod commands;
mod desc;
pub mod hazards;
pub(crate) mod heads;

pub use desc::{Accumulate, BatchSize, UpdateDesc, UpdateMode, UpdatePath};

use crate::error::Result;
use crate::pack::{POSE_STRIDE, PackedLayout};
use crate::weights::delta::{Coefficient, active_targets, changed_targets};
use std::ops::Range;

/// What a pass adds to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Source {
    /// The base pose.
    Base,
    /// The pose in this slot.
    Slot(u32),
}

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

/// How an update went. The counts speak of the whole crowd.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpdateStats {
    /// Dense formats: coefficients applied, of targets whose weight changed, or that are active where an update starts
    /// from base. Block formats: targets whose weight asked for changed.
    pub coefficients: usize,
    /// Passes.
    pub passes: usize,
    /// Instances that started from the base pose (dense formats).
    pub rebuilt: usize,
    /// Blocks written (block formats).
    pub dirty_blocks: usize,
    /// Of these, the ones that started from the base pose.
    pub rebuilt_blocks: usize,
    /// Bound on the position error that float32 accumulation may have caused so far, in input units; 0 for exact sums.
    pub bound: f32,
    /// Bytes loaded and stored. On a direct path, by one draw of every head, which comes again in each frame whether
    /// weights have changed or not.
    pub bytes_moved: u64,
    /// The least that dense work could move; in block formats, what deltas and poses alone take.
    pub bytes_floor: u64,
}

impl UpdateStats {
    /// Count `list` and `plans`.
    pub fn new(layout: &PackedLayout, list: &commands::CommandList, plans: &[Plan]) -> Self {
        let (vertices, stride) = (layout.padded_vertices(), layout.format.stride());
        Self {
            coefficients: list.coefficients.len(),
            passes: list.passes().count(),
            rebuilt: plans.iter().filter(|p| p.rebuilt && !p.passes.is_empty()).count(),
            bytes_moved: list.bytes_moved(vertices, POSE_STRIDE, stride),
            bytes_floor: list.bytes_floor(vertices, POSE_STRIDE, stride),
            ..Self::default()
        }
    }
}

impl std::ops::AddAssign for UpdateStats {
    /// Counts add up; of the bounds the larger one holds for both.
    fn add_assign(&mut self, other: Self) {
        self.coefficients += other.coefficients;
        self.passes += other.passes;
        self.rebuilt += other.rebuilt;
        self.dirty_blocks += other.dirty_blocks;
        self.rebuilt_blocks += other.rebuilt_blocks;
        self.bound = self.bound.max(other.bound);
        self.bytes_moved += other.bytes_moved;
        self.bytes_floor += other.bytes_floor;
    }
}

#[cfg(test)]
mod tests;
