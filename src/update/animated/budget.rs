//! The error budget of crowds that are animated on the GPU: changes too small to matter are deferred, target by target.
//!
//! An instance has requested weights, and those that its poses hold. A change between the two is deferred while in every
//! block
//!
//! ```text
//! Σ |requested − held| · reach ≤ budget        over the targets that touch the block
//! ```
//!
//! with the reach of a target in a block (its longest position delta there) in steps, rounded up: integers of 64 bits,
//! so that GPU and CPU decide alike. Where a block exceeds the budget, all that is deferred in it is applied; so is all
//! of an instance whose requested weights stay the same from one update to the next.

use crate::error::Result;
use crate::pack::blocks::BlockIndex;

/// The budget in integers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Budget {
    /// The budget, in steps of a weight times steps of a delta.
    pub most: u64,
    /// The reach of each entry, in steps of a delta.
    pub reaches: Vec<u32>,
}

impl Budget {
    /// `length` in input units; `None` for 0, with which no change is deferred.
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
            reaches: index.costs.iter().map(|cost| reach(cost.reach)).collect(),
        }))
    }
}
