//! What the instances of a crowd have in common in a group of the mesh, and what one update lists of all of them.

use super::bound::length_unit;
use super::list::WorkList;
use crate::error::Result;
use crate::pack::PackedLayout;
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::plan::{Accumulate, UpdateDesc, UpdateStats};
use std::sync::Arc;

/// The plan of a group.
#[derive(Clone, Debug)]
pub struct GroupPlan {
    /// What the group was packed into.
    pub index: Arc<BlockIndex>,
    /// What the last update writes.
    pub list: WorkList,
    /// Of the last update.
    pub stats: UpdateStats,
    /// Load and store all of a block that is written, not only the components that change: for kernels that cannot do
    /// less.
    pub whole_blocks: bool,
    pub(super) desc: UpdateDesc,
    pub(super) targets: usize,
    pub(super) unit: Unit,
    /// The largest bound on drift that a block may have, as a length; infinite for exact sums.
    pub(super) tolerance: f32,
    pub(super) scratch: Scratch,
}

impl GroupPlan {
    /// The plan of so many instances.
    ///
    /// # Errors
    /// As [`UpdateDesc::check_for`]; no blocks.
    pub fn new(desc: UpdateDesc, layout: &PackedLayout, instances: usize) -> Result<Self> {
        desc.check_for(layout)?;
        let index = layout.index()?;
        let (grid, tolerance) = match desc.accumulate {
            Accumulate::Exact => (Some(index.exact()?), f32::INFINITY),
            Accumulate::Float { tolerance } => (None, tolerance * length_unit(layout)),
        };
        // Without lengths there is nothing to measure a budget against: all is committed at once.
        let error_budget = if layout.has_lengths() { desc.error_budget } else { 0.0 };
        Ok(Self {
            index: index.clone(),
            list: WorkList::new(index, instances),
            stats: UpdateStats::default(),
            whole_blocks: false,
            desc: UpdateDesc { error_budget, ..desc },
            targets: layout.targets.len(),
            unit: Unit { grid, step: grid.map_or(1.0, |grid| grid.weight_step()) },
            tolerance,
            scratch: Scratch::default(),
        })
    }

    /// The grid of exact sums.
    pub fn exact(&self) -> Option<ExactGrid> {
        self.unit.grid
    }

    /// Forget the last update.
    pub fn clear(&mut self) {
        self.list.clear();
        self.stats = UpdateStats::default();
    }
}

/// How weights are summed: as float32, or as integers in steps of a grid. Both take 32 bits, and 0 is no weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unit {
    grid: Option<ExactGrid>,
    step: f32,
}

impl Unit {
    pub(super) fn bits(self, weight: f32) -> u32 {
        match self.grid {
            // The sum makes 0 of -0.
            None => (weight + 0.0).to_bits(),
            Some(grid) => grid.steps(weight) as u32,
        }
    }

    pub(super) fn difference(self, new: u32, old: u32) -> u32 {
        match self.grid {
            None => (f32::from_bits(new) - f32::from_bits(old)).to_bits(),
            Some(_) => new.wrapping_sub(old),
        }
    }

    /// The absolute value, as a weight.
    pub(super) fn size(self, bits: u32) -> f32 {
        match self.grid {
            None => f32::from_bits(bits).abs(),
            Some(_) => (bits as i32).unsigned_abs() as f32 * self.step,
        }
    }
}

/// Scratch space that the instances share.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    /// The weights requested of an instance.
    pub(super) next: Vec<u32>,
    /// Per block: the place in the list after its last element, counted from the instance's first.
    pub(super) ends: Vec<u32>,
    /// With an error budget: blocks that a change reaches.
    pub(super) reached: Vec<bool>,
    /// The entries of a block, those with the largest amounts first.
    pub(super) largest: Vec<u32>,
    /// With an error budget: how far each entry of a block is from what was requested, as a length; negative once it is
    /// to be committed.
    pub(super) amounts: Vec<f32>,
}
