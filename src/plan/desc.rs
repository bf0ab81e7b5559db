//! How poses are to be updated: path, mode, batch size, format, slots.

use super::paths::UpdatePath;
use crate::error::Result;
use crate::pack::blocks::PoseGrid;
use crate::pack::{PackedLayout, PoseFormat};
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
    /// How poses are stored, and so how they add up: float32 accumulates rounding; integers are exact sums on a grid of
    /// weights and deltas ([`PoseGrid`](crate::pack::blocks::PoseGrid)), bit for bit what a full evaluation gives,
    /// after any number of updates, in any order and on any driver (`blocks`, `compute` and `cpu`; deltas that are
    /// integers).
    pub pose: PoseFormat,
    /// Largest position error that accumulation in float32 may cause, as a fraction of the bounding-box diagonal (block
    /// formats). A bound on it is kept, and a block whose bound would exceed this starts from the base pose again.
    /// Streams beside positions and normals have no such bound: in long runs, use poses of integers.
    pub tolerance: f32,
    /// Largest weight, either sign, that poses of integers have to hold; `None`: 1 in 16 bits, in 32 what the mesh was
    /// packed with. The smaller, the finer their unit ([`PackedLayout::grid`]).
    pub weight_max: Option<f32>,
    /// How far a vertex may be from where the requested weights would put it, as a length in input units (block
    /// formats). Smaller changes are deferred until they add up to more, or until the same weights are requested again;
    /// 0 defers none. Errors of packing, and of rounding to a grid, are not part of it. It bounds positions;
    /// normals are deferred with them, other streams only in crowds that are animated on the GPU.
    pub error_budget: f32,
}

setters!(UpdateDesc {
    path: UpdatePath,
    batch: BatchSize,
    mode: UpdateMode,
    slots: u32,
    pose: PoseFormat,
    tolerance: f32,
    weight_max: Option<f32>,
    error_budget: f32,
});

impl UpdateDesc {
    /// Incremental updates of float32 poses in two slots, with a tolerance of 1e-5; rebuilds for paths that know
    /// nothing else.
    pub const fn new(path: UpdatePath, batch: BatchSize) -> Self {
        let (mode, pose) = (path.default_mode(), PoseFormat::Float32);
        Self { path, batch, mode, slots: 2, pose, tolerance: 1e-5, weight_max: None, error_budget: 0.0 }
    }

    /// The grid of weights and poses for a mesh packed like this; `None`: weights and poses are float32.
    ///
    /// # Errors
    /// As [`PackedLayout::grid`].
    pub fn grid(&self, layout: &PackedLayout) -> Result<Option<PoseGrid>> {
        self.integers().map(|pose| layout.grid(pose, self.weight_max)).transpose()
    }

    /// What sums are of, where they are exact: poses of integers, or the integers that a path has instead of them.
    pub(crate) const fn integers(&self) -> Option<PoseFormat> {
        match self.path.row().sums_integers {
            true => Some(PoseFormat::Fixed32),
            false if self.pose.has_integers() => Some(self.pose),
            false => None,
        }
    }

    /// The path `blocks`: incremental updates in two slots.
    pub const fn blocks() -> Self {
        Self::new(UpdatePath::Blocks, BatchSize::All)
    }
}
