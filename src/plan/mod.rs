//! What every way to update has in common, as data: descriptions, instances, steps and their barriers, statistics.
//!
//! Pure: no Vulkan here. A [technique](crate::update) turns requested weights into [`steps`], [`schedule`] derives the
//! barriers, and what is recorded is data, so that tests hold it to [`hazards`]: every access has to be ordered.

pub mod after;
mod desc;
pub(crate) mod earlier;
pub mod hazards;
pub mod instances;
pub(crate) mod paths;
pub mod schedule;
pub mod steps;

pub use desc::{BatchSize, UpdateDesc, UpdateMode};
pub use paths::UpdatePath;
pub use steps::Consumers;
pub use steps::Source;

#[cfg(test)]
pub(crate) mod tests;

/// How an update went: counts are those of the whole crowd.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct UpdateStats {
    /// Dense formats: coefficients applied, of targets whose weight changed, or that are active where an update starts
    /// from base. Block formats: targets whose requested weight changed.
    pub coefficients: usize,
    /// Passes.
    pub passes: usize,
    /// Instances that started from the base pose (dense formats).
    pub rebuilt: usize,
    /// Blocks written (block formats), in all groups of the mesh.
    pub dirty_blocks: usize,
    /// Of these, the ones that started from the base pose.
    pub rebuilt_blocks: usize,
    /// Bound on the position error that accumulation in float32 may have caused so far, or rounding to 16 bits, in
    /// input units; 0 for poses of 32-bit integers.
    pub bound: f32,
    /// Bytes loaded and stored, in all groups of the mesh. On a direct path, by one draw of every instance, in each
    /// frame again, whether weights have changed or not. On the path `texture` by the update alone.
    pub bytes_moved: u64,
    /// The least that dense work could move; in block formats, what deltas and poses alone take.
    pub bytes_floor: u64,
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
