//! The bound on what accumulation in float32 may have done to a block, and scratch space that planning shares.

/// Scratch space of [`BlockState::plan`](super::BlockState::plan), shared by the instances of a crowd.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// Per block: the place in the list behind its last element, counted from the instance's first.
    pub(super) ends: Vec<u32>,
    /// With an error budget: blocks that a change reaches.
    pub(super) reached: Vec<bool>,
    /// The entries of a block, those with the largest amounts first.
    pub(super) largest: Vec<u32>,
    /// With an error budget: how far each entry of a block is from what was asked for, as a length; negative once it
    /// is committed.
    pub(super) amounts: Vec<f32>,
}

/// Per block.
#[derive(Clone, Debug)]
pub(super) struct BlockBounds {
    /// Bound on the position error that accumulation caused.
    pub(super) bound: Vec<f32>,
    /// The bound at which the block is rebuilt.
    pub(super) limit: Vec<f32>,
    /// Bytes of the active entries.
    pub(super) active_bytes: Vec<u32>,
    /// The tolerance as a length; infinite for exact sums.
    pub(super) tolerance: f32,
}

const ULP: f32 = f32::EPSILON;
const SQRT_3: f32 = 1.732_050_8;

/// What rounding may add to a block's positions in one update.
pub(super) fn rounding(magnitude: f32, entries: u32, sum: f32) -> f32 {
    SQRT_3 * ULP * (magnitude + (entries + 4) as f32 * sum)
}
