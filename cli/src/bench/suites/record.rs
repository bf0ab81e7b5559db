//! What suites add to the JSON. Fields may be added, never renamed.

use crate::bench::record::{Round, RunRecord};
use crate::bench::select::median;
use crate::bench::stats::Stats;
use serde::{Deserialize, Serialize};

/// What a suite found out, next to its runs.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SuiteRecord {
    /// "chapter", "crowd", "techniques" or "clips".
    pub name: String,
    /// What techniques compete in, in the order measured.
    pub cells: Vec<CellRecord>,
    /// Two configurations each, measured in turns.
    pub comparisons: Vec<Comparison>,
}

/// Who won where.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CellRecord {
    /// Its name; runs give it.
    pub name: String,
    pub mesh: String,
    /// What changes: in words, or the clip.
    pub change: String,
    pub heads: u32,
    /// The fastest technique with a device.
    pub fastest: Option<String>,
    /// The path `blocks`, with the format that did best.
    pub blocks: Option<String>,
    /// The fastest of the others.
    pub best_other: Option<String>,
    /// Time of `blocks` over that of the best other: below 1, `blocks` is the faster one.
    pub blocks_to_best_other: Option<f64>,
    /// The same with means: where many frames of a clip change nothing, their median is that of a draw.
    #[serde(default)]
    pub blocks_to_best_other_mean: Option<f64>,
    /// Time of `direct` over that of `blocks`: above 1, `blocks` is the faster one.
    pub direct_to_blocks: Option<f64>,
}

/// Two configurations of the same work.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Comparison {
    pub name: String,
    pub first: String,
    pub second: String,
    /// Median of the first, in ms.
    pub first_ms: f64,
    /// Median of the second, in ms.
    pub second_ms: f64,
    /// First over second: the median of the rounds' ratios.
    pub ratio: f64,
    /// Frames of the first and of the second.
    pub n: [usize; 2],
    /// What the ratio should be; empty where it is a finding.
    pub goal: String,
}

/// The technique that the others are compared with.
pub const OURS: &str = "blocks";
/// The technique that evaluates all targets in every draw.
pub const DIRECT: &str = "direct";

/// A technique and the format that it ran with: "blocks fast".
pub fn label(run: &RunRecord) -> String {
    format!("{} {}", run.technique, run.format)
}

/// `a` over `b`: the median of the ratios of the rounds that both took part in, or where they were not measured in
/// turns, the ratio of medians.
pub fn ratio(a: &RunRecord, b: &RunRecord, of: fn(&Round) -> f64) -> Option<f64> {
    if a.alone || b.alone || a.rounds.is_empty() || b.rounds.is_empty() {
        return Stats::of(&[median(a) / median(b)]).map(|s| s.median);
    }
    let ratios: Vec<f64> = a.rounds.iter().zip(&b.rounds).map(|(a, b)| of(a) / of(b)).collect();
    Stats::of(&ratios).map(|s| s.median)
}

impl CellRecord {
    /// Sum up the runs of a cell. Only those with a device compete.
    pub fn of(name: &str, [mesh, change]: [&str; 2], heads: u32, runs: &[RunRecord]) -> Self {
        let on_device = || runs.iter().filter(|r| r.counts() && r.gpu_ms.is_some());
        let by_time = |a: &&RunRecord, b: &&RunRecord| median(a).total_cmp(&median(b));
        let ours = on_device().find(|r| r.technique == OURS);
        let other = on_device().filter(|r| r.technique != OURS).min_by(by_time);
        let mean = |run: &RunRecord| run.time().map_or(f64::INFINITY, |t| t.mean);
        let others = on_device().filter(|r| r.technique != OURS).map(mean).reduce(f64::min);
        let direct = on_device().find(|r| r.technique == DIRECT);
        Self {
            name: name.into(),
            mesh: mesh.into(),
            change: change.into(),
            heads,
            fastest: on_device().min_by(by_time).map(label),
            blocks: ours.map(label),
            best_other: other.map(label),
            blocks_to_best_other: ours.zip(other).and_then(|(a, b)| ratio(a, b, |r| r.ms)),
            blocks_to_best_other_mean: ours.zip(others).map(|(ours, others)| mean(ours) / others),
            direct_to_blocks: direct.zip(ours).and_then(|(a, b)| ratio(a, b, |r| r.ms)),
        }
    }
}

impl Comparison {
    /// Of two runs that were measured in turns, by what `of` says of their rounds; `None` unless both were right.
    pub fn new(
        name: &str,
        runs: [&RunRecord; 2],
        names: [String; 2],
        of: fn(&Round) -> f64,
        goal: &str,
    ) -> Option<Self> {
        if !runs.iter().all(|r| r.counts()) {
            return None;
        }
        let [first, second] = names;
        let ms =
            runs.map(|run| Stats::of(&run.rounds.iter().map(of).collect::<Vec<_>>()).map_or(median(run), |s| s.median));
        Some(Self {
            name: name.into(),
            first,
            second,
            first_ms: ms[0],
            second_ms: ms[1],
            ratio: ratio(runs[0], runs[1], of)?,
            n: runs.map(|run| run.time().map_or(0, |t| t.n)),
            goal: goal.into(),
        })
    }
}
