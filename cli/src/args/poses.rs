//! The pose formats that options request: `--pose` names them, `--accumulate` the kind of their sums.

use super::{UpdateArgs, distinct_or, values};
use clap::ValueEnum;
use deltamorph::{BatchSize, PoseFormat, UpdateDesc, UpdatePath};
use serde::Serialize;

/// How poses add up, as named by `--accumulate` and reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Sums {
    /// --pose float32: float32 sums, with a bound that is kept
    Float,
    /// --pose fixed32: integer sums, equal to a full evaluation bit for bit (deltas of integers: not float32)
    Exact,
}

impl Sums {
    /// The kind of sums of updates described by `desc`.
    pub fn of(desc: &UpdateDesc) -> Self {
        if desc.path == UpdatePath::Scatter { Self::Exact } else { Self::of_pose(desc.pose) }
    }

    fn of_pose(pose: PoseFormat) -> Self {
        if pose.has_integers() { Self::Exact } else { Self::Float }
    }

    /// The pose format that it means.
    fn pose(self) -> PoseFormat {
        match self {
            Self::Float => PoseFormat::Float32,
            Self::Exact => PoseFormat::Fixed32,
        }
    }
}

impl UpdateArgs {
    /// The pose formats requested, each once; empty without `--pose` and `--accumulate`.
    pub fn named_poses(&self) -> Result<Vec<PoseFormat>, String> {
        if self.poses.is_empty() {
            let meant: Vec<PoseFormat> = self.accumulate.iter().map(|sums| sums.pose()).collect();
            return Ok(distinct_or(&meant, &[]));
        }
        let has = |sums: Sums| self.poses.iter().any(|pose| Sums::of_pose(*pose) == sums);
        if !self.accumulate.is_empty()
            && Sums::value_variants().iter().any(|sums| has(*sums) != self.accumulate.contains(sums))
        {
            return Err(format!(
                "--accumulate {} and --pose {} contradict each other: float32 poses are float sums, the others exact \
                 ones; leave --accumulate out",
                self.accumulate.iter().map(|sums| values::name(*sums)).collect::<Vec<_>>().join(","),
                self.poses.iter().map(|pose| pose.name()).collect::<Vec<_>>().join(","),
            ));
        }
        Ok(distinct_or(&self.poses, &[]))
    }

    /// The pose format for updating `path` if `pose` is requested, or why there is none. The sums of `scatter` are the
    /// integers of fixed32, and its poses float32.
    pub fn pose_on(&self, path: UpdatePath, pose: PoseFormat) -> Result<PoseFormat, String> {
        if path == UpdatePath::Scatter && self.poses.is_empty() && pose == PoseFormat::Fixed32 {
            return Ok(PoseFormat::Float32);
        }
        if path == UpdatePath::Scatter && self.accumulate == [Sums::Float] {
            let name = path.name();
            return Err(format!("--accumulate float: the path '{name}' adds integers; leave --accumulate out"));
        }
        let checked = UpdateDesc::new(path, BatchSize::Targets(1)).pose(pose).check();
        checked.map(|()| pose).map_err(|error| format!("--pose {}: {error}", pose.name()))
    }
}
