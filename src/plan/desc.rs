//! How poses are to be updated: path, mode, batch size, sums, slots.

use super::paths::UpdatePath;
use super::steps::Consumers;
use crate::pack::PoseFormat;
use crate::setters::setters;

impl UpdatePath {
    /// The mode where none is named.
    pub const fn default_mode(self) -> UpdateMode {
        if self.rebuilds_only() { UpdateMode::Rebuild } else { UpdateMode::Incremental }
    }
}

/// What an update starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum UpdateMode {
    /// The pose already there, adding the changed targets; from base where that takes no more targets.
    #[default]
    Incremental,
    /// The base pose, adding all active targets: full evaluation, every time the weights change.
    Rebuild,
}

impl UpdateMode {
    /// The name used on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Incremental => "incremental",
            Self::Rebuild => "rebuild",
        }
    }
}

/// Targets per pass. `All` orders after every number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum BatchSize {
    /// At most this many (≥ 1).
    Targets(u32),
    /// All in one pass, with the coefficients in a buffer.
    #[default]
    All,
}

impl BatchSize {
    /// Passes that `coefficients` targets take. Even none takes one: the source has to reach the destination.
    pub fn passes(self, coefficients: usize) -> usize {
        match self {
            Self::Targets(b) => coefficients.div_ceil(b.max(1) as usize).max(1),
            Self::All => 1,
        }
    }
}

impl std::fmt::Display for BatchSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Targets(b) => b.fmt(f),
            Self::All => "all".fmt(f),
        }
    }
}

/// How poses add up (block formats; dense ones are always `Float`, without the bound).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Accumulate {
    /// float32 sums. A bound on what rounding may have done to a block's positions is kept, and a block whose bound
    /// would exceed `tolerance` (a fraction of the diagonal) starts from the base pose again. Streams beside positions
    /// and normals have no such bound: in long runs, use [`Exact`](Self::Exact).
    Float {
        /// Largest position error that accumulation may cause, as a fraction of the bounding-box diagonal.
        tolerance: f32,
    },
    /// Integer sums on a grid of weights and deltas ([`ExactGrid`](crate::pack::blocks::ExactGrid)): after any
    /// number of updates, in any order and on any driver, bit for bit what a full evaluation gives.
    Exact,
}

impl Default for Accumulate {
    /// float32 with a tolerance of 1e-5 of the diagonal.
    fn default() -> Self {
        Self::Float { tolerance: 1e-5 }
    }
}

impl Accumulate {
    /// The name used on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Float { .. } => "float",
            Self::Exact => "exact",
        }
    }
}

/// How poses are to be updated. The same for all instances of a crowd, for its life.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct UpdateDesc {
    /// Who carries the passes out.
    pub path: UpdatePath,
    /// Targets per pass (dense formats); of `direct-attributes`, the most that may be active.
    pub batch: BatchSize,
    /// What an update starts from.
    pub mode: UpdateMode,
    /// Pose buffers per instance. 1: in place, no previous pose (not for `feedback`). 2: ping-pong. 3 keep the
    /// previous pose under `feedback` and `vertex-store`, too, whose passes alternate between the other two. The direct
    /// paths have no pose buffers, and this says nothing there.
    pub slots: u32,
    /// How poses add up (block formats).
    pub accumulate: Accumulate,
    /// How poses are stored.
    pub pose: PoseFormat,
    /// How far a vertex may be from where the requested weights would put it, as a length in input units (block
    /// formats). Smaller changes are deferred until they add up to more, or until the same weights are requested again;
    /// 0 defers none. Errors of packing, and rounding by [`Accumulate::Exact`], are not part of it. It bounds positions;
    /// normals are deferred with them, other streams only in crowds that are animated on the GPU.
    pub error_budget: f32,
}

setters!(UpdateDesc {
    path: UpdatePath,
    batch: BatchSize,
    mode: UpdateMode,
    slots: u32,
    accumulate: Accumulate,
    error_budget: f32,
    pose: PoseFormat,
});

impl UpdateDesc {
    /// Incremental updates in two slots with float sums; rebuilds and exact sums for paths that know nothing else.
    pub const fn new(path: UpdatePath, batch: BatchSize) -> Self {
        let accumulate = match path.row().exact_only {
            true => Accumulate::Exact,
            false => Accumulate::Float { tolerance: 1e-5 },
        };
        let (mode, pose) = (path.default_mode(), PoseFormat::Float32);
        Self { path, batch, mode, slots: 2, accumulate, pose, error_budget: 0.0 }
    }

    /// The path `blocks`: incremental updates in two slots.
    pub const fn blocks() -> Self {
        Self::new(UpdatePath::Blocks, BatchSize::All)
    }
}

/// How to make a crowd.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct CrowdDesc {
    /// Instances, each with weights and poses of its own (≥ 1).
    pub instances: u32,
    /// How poses are updated.
    pub update: UpdateDesc,
    /// Updates that may be recorded and not yet finished (≥ 1): how many coefficient or work lists are kept. Updates
    /// that recorded nothing and discarded ones do not count.
    pub frames_in_flight: u32,
    /// Who reads poses between updates: updates wait for these readers, and make new poses visible to them.
    pub consumers: Consumers,
}

setters!(CrowdDesc { instances: u32, update: UpdateDesc, frames_in_flight: u32, consumers: Consumers });

impl CrowdDesc {
    /// One instance, two frames in flight, drawn from vertex attributes or by vertex shaders.
    pub fn new(update: UpdateDesc) -> Self {
        Self { instances: 1, update, frames_in_flight: 2, consumers: Consumers::default() }
    }
}
