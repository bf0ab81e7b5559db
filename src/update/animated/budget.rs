//! The error budget of crowds that are animated on the GPU: changes too small to matter wait, target by target.
//!
//! A head has the weights asked for, and those that its poses hold. A change between the two waits while in every block
//!
//! ```text
//! Σ |requested − held| · reach ≤ budget        over the targets that touch the block
//! ```
//!
//! with the reach of a target in a block (its longest position delta there) in steps, rounded up: integers of 64 bits,
//! so that GPU and CPU decide alike. A block beyond the budget lets all that waits in it go. A head that asks for what
//! it asked for in the update before settles: all goes. Planners on the CPU let changes wait entry by entry, which
//! saves more and takes more memory.

use crate::error::Result;
use crate::pack::blocks::BlockIndex;

/// The budget in integers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Budget {
    most: u64,
    reaches: Vec<u32>,
}

impl Budget {
    /// `length` in input units; `None` for 0, with which no change waits.
    ///
    /// # Errors
    /// As [`BlockIndex::exact`].
    pub fn new(length: f32, index: &BlockIndex) -> Result<Option<Self>> {
        if length <= 0.0 {
            return Ok(None);
        }
        let (step, weight_step) = (f64::from(index.steps()[0]), f64::from(index.exact()?.weight_step()));
        // Steps are powers of two: nothing rounds but what is meant to.
        let reach = |reach: f32| (f64::from(reach) / step).ceil() as u32;
        Ok(Some(Self {
            most: (f64::from(length) / (step * weight_step)).floor() as u64,
            reaches: index.costs().iter().map(|cost| reach(cost.reach)).collect(),
        }))
    }

    /// The budget, in steps of a weight times steps of a delta.
    pub fn most(&self) -> u64 {
        self.most
    }

    /// The reach of each entry, in steps of a delta.
    pub fn reaches(&self) -> &[u32] {
        &self.reaches
    }
}

/// The weights of a head: asked for, and held.
#[cfg(any(test, feature = "internals"))]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deferred {
    requested: Vec<i32>,
    committed: Vec<i32>,
    goes: Vec<bool>,
}

#[cfg(any(test, feature = "internals"))]
impl Deferred {
    /// All 0.
    pub fn new(targets: usize) -> Self {
        Self { requested: vec![0; targets], committed: vec![0; targets], goes: vec![false; targets] }
    }

    /// Ask for `weights`. Without a budget all of them go.
    ///
    /// # Panics
    /// When there is not one for each target.
    pub fn commit(&mut self, weights: &[i32], budget: Option<&Budget>, index: &BlockIndex) {
        let still = self.requested == weights;
        self.requested.copy_from_slice(weights);
        let Some(budget) = budget.filter(|_| !still) else {
            return self.committed.copy_from_slice(weights);
        };
        self.goes.fill(false);
        for block in 0..index.count() {
            let entries = index.entries(block);
            let targets = &index.entry_targets()[entries.clone()];
            let pending = |target: u32| self.requested[target as usize].abs_diff(self.committed[target as usize]);
            let reaches = targets.iter().zip(&budget.reaches[entries]);
            let sum: u64 = reaches.map(|(&target, &reach)| u64::from(pending(target)) * u64::from(reach)).sum();
            if sum > budget.most {
                targets.iter().for_each(|&target| self.goes[target as usize] = true);
            }
        }
        for ((held, &asked), _) in self.committed.iter_mut().zip(weights).zip(&self.goes).filter(|(_, goes)| **goes) {
            *held = asked;
        }
    }

    /// What poses hold.
    pub fn committed(&self) -> &[i32] {
        &self.committed
    }

    /// What was asked for.
    pub fn requested(&self) -> &[i32] {
        &self.requested
    }
}
