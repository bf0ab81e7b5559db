//! Planning, shared by all techniques: descriptions, instances, steps, barriers and statistics.
//!
//! Pure data, no Vulkan calls. A [technique](crate::update) turns requested weights into [`steps`]; [`schedule`]
//! derives the barriers. The hazard checker of the tests (tests/common/hazards.rs) proves that every access is ordered.

pub mod bounds;
mod desc;
pub(crate) mod earlier;
#[cfg(test)]
#[path = "../../tests/common/hazards.rs"]
pub(crate) mod hazards;
pub mod instances;
pub(crate) mod paths;
pub mod schedule;
pub mod steps;

pub use desc::{BatchSize, UpdateDesc, UpdateMode};
pub use paths::{Batch, Needs, PathRow, UpdatePath};
pub use steps::{Consumers, Source};

#[cfg(test)]
pub(crate) mod tests;

/// Statistics of one update, summed over all instances of the crowd.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct UpdateStats {
    /// Dense formats: coefficients applied (changed targets, or active targets of an instance that starts from base).
    /// Block formats: targets whose requested weight changed.
    pub coefficients: usize,
    /// Passes.
    pub passes: usize,
    /// Instances that started from the base pose (dense formats).
    pub rebuilt: usize,
    /// Blocks written, in all groups of the mesh (block formats).
    pub dirty_blocks: usize,
    /// Blocks that started from the base pose, of `dirty_blocks`.
    pub rebuilt_blocks: usize,
    /// Bound on the position error so far, in input units: from float32 accumulation in block formats, or from rounding
    /// fixed-point poses to their units and decoding them in single precision.
    pub bound: f32,
    /// Bytes loaded and stored, in all groups of the mesh. Direct paths: of one draw of every instance, every frame.
    /// Path `texture`: of the update, without the draws.
    pub bytes_moved: u64,
    /// Lower bound on `bytes_moved`. Dense: the least that dense work could move; block formats: deltas and poses
    /// alone.
    pub bytes_floor: u64,
}

#[doc(hidden)]
impl std::ops::AddAssign for UpdateStats {
    /// Adds counts; keeps the larger bound.
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
