//! [`UpdateDesc`]: path, mode, batch size, formats and slots of a crowd's updates.

use super::paths::UpdatePath;
use crate::error::Result;
use crate::pack::blocks::PoseGrid;
use crate::pack::{PackedLayout, PoseFormat};

impl UpdatePath {
    /// The mode of [`UpdateDesc::new`]: incremental, if the path supports it.
    #[doc(hidden)]
    pub const fn default_mode(self) -> UpdateMode {
        if self.row().rebuilds_only { UpdateMode::Rebuild } else { UpdateMode::Incremental }
    }
}

/// The pose that an update starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum UpdateMode {
    /// The current pose, adding the changed targets; the base pose, if that takes fewer targets.
    #[default]
    Incremental,
    /// The base pose, adding all active targets: a full evaluation whenever weights change.
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

/// Batch size: targets per pass. `All` compares greater than every number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum BatchSize {
    /// At most this many (≥ 1).
    Targets(u32),
    /// All in one pass, with the coefficients in a buffer.
    #[default]
    All,
}

impl BatchSize {
    /// Passes for `coefficients` targets; at least 1, since the source has to be copied to the destination.
    #[doc(hidden)]
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

/// Describes how the poses of a crowd are updated. Fixed for the crowd's life.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpdateDesc {
    /// The update path.
    pub path: UpdatePath,
    /// Targets per pass (dense formats). `direct-attributes`: the most targets that may be active.
    pub batch: BatchSize,
    /// The pose that updates start from.
    pub mode: UpdateMode,
    /// Pose buffers per instance. 1: in place, without a previous pose (not for `feedback`). 2: ping-pong. 3: keeps the
    /// previous pose under `feedback` and `vertex-store` too, whose passes alternate between the other two. Ignored by
    /// the direct paths, which have no pose buffers.
    pub slots: u32,
    /// The pose format. Float32 accumulates rounding errors. Fixed-point poses are exact sums on a grid of weights and
    /// deltas ([`PoseGrid`](crate::pack::blocks::PoseGrid)), bit for bit equal to a full evaluation after any number of
    /// updates, in any order, on any driver; they need deltas in blocks, and `blocks` or `cpu`
    /// ([`PoseFormat::takes`]).
    pub pose: PoseFormat,
    /// Largest position error from float32 accumulation, as a fraction of
    /// [`PackedLayout::diagonal`](crate::PackedLayout::diagonal) (block formats). A block whose tracked bound would
    /// exceed it is rebuilt from the base pose. The bound adds up every rounding of the active targets as if all had
    /// the same sign: where hundreds of them move a vertex, that of a rebuild may exceed the tolerance. There a block
    /// is rebuilt when its bound would exceed twice that of the last rebuild, and
    /// [`UpdateStats::bound`](crate::UpdateStats::bound) states the result. Bounds positions only: for other streams in
    /// long runs, use fixed-point poses.
    pub tolerance: f32,
    /// Largest absolute weight that fixed-point poses have to hold. `None`: 1 for 16-bit poses, the mesh's packed value
    /// for 32-bit poses. Smaller values give a finer unit ([`PackedLayout::grid`]).
    pub weight_max: Option<f32>,
    /// Error budget: the largest distance of a vertex from its position under the requested weights, in input units
    /// (block formats). Changes below it are deferred until they add up to more, or until the same weights are
    /// requested again; 0 defers none. Excludes the errors of packing and of rounding to a grid. Bounds positions;
    /// normals are deferred with them, other streams never. Crowds animated on the GPU have none.
    pub error_budget: f32,
}

impl UpdateDesc {
    /// Incremental updates (rebuilds, if the path has no others) of float32 poses in two slots, with a tolerance of
    /// 1e-5.
    pub const fn new(path: UpdatePath, batch: BatchSize) -> Self {
        let mode = path.default_mode();
        let pose = PoseFormat::Float32;
        Self { path, batch, mode, slots: 2, pose, tolerance: 1e-5, weight_max: None, error_budget: 0.0 }
    }

    /// The grid of weights and poses for a mesh of this `layout`; `None` if weights and poses are float32.
    ///
    /// # Errors
    /// See [`PackedLayout::grid`].
    #[doc(hidden)]
    pub fn grid(&self, layout: &PackedLayout) -> Result<Option<PoseGrid>> {
        self.integers().map(|pose| layout.grid(pose, self.weight_max)).transpose()
    }

    /// The integer format of exact sums: the pose format if it is fixed-point, or the format a path sums in internally.
    pub(crate) const fn integers(&self) -> Option<PoseFormat> {
        match self.path.row().sums_integers {
            true => Some(PoseFormat::Fixed32),
            false if self.pose.has_integers() => Some(self.pose),
            false => None,
        }
    }

    /// Whether what changes is evaluated from the base pose every time: the mode, or sums that are rounded once.
    pub(crate) const fn rebuilds(&self) -> bool {
        matches!(self.mode, UpdateMode::Rebuild) || self.pose.row().rounds_sums
    }

    /// Incremental updates on path `blocks`, in two slots.
    pub const fn blocks() -> Self {
        Self::new(UpdatePath::Blocks, BatchSize::All)
    }
}
