//! Results of suites: the fastest configuration of a cell, and the ratio of two configurations.

use super::record::{CellRecord, Comparison, Round, RunRecord, fastest};
use super::stats::Stats;

/// The technique to compare the others with.
pub const OURS: &str = "blocks";
/// The technique that evaluates all targets in every draw.
const DIRECT: &str = "direct";

/// `a` over `b`: the ratios of the rounds of both; the ratio of medians if they were not measured interleaved.
pub fn ratios(a: &RunRecord, b: &RunRecord, of: fn(&Round) -> f64) -> Option<Stats> {
    let ratios: Vec<f64> = match a.alone || b.alone || a.rounds.is_empty() || b.rounds.is_empty() {
        true => vec![a.median() / b.median()],
        false => a.rounds.iter().zip(&b.rounds).map(|(a, b)| of(a) / of(b)).collect(),
    };
    Stats::of(&ratios)
}

fn ratio(a: &RunRecord, b: &RunRecord, of: fn(&Round) -> f64) -> Option<f64> {
    ratios(a, b, of).map(|stats| stats.median)
}

impl CellRecord {
    /// Sums up the runs of a cell. Only those on a device compete.
    pub fn of(name: &str, [mesh, change]: [&str; 2], heads: u32, runs: &[RunRecord]) -> Self {
        let on_device = || runs.iter().filter(|r| r.counts() && r.gpu_ms.is_some());
        // Other techniques only: not `blocks` in other pose formats.
        let others = || on_device().filter(|r| r.path != OURS);
        let named = |technique: &str| on_device().find(|r| r.technique == technique);
        // In another pose format where float32 has no row.
        let ours = named(OURS).or_else(|| fastest(on_device().filter(|r| r.path == OURS)));
        let other = fastest(others());
        let mean = |run: &RunRecord| run.time().map_or(f64::INFINITY, |t| t.mean);
        Self {
            name: name.into(),
            mesh: mesh.into(),
            change: change.into(),
            heads,
            fastest: fastest(on_device()).map(RunRecord::label),
            blocks: ours.map(RunRecord::label),
            best_other: other.map(RunRecord::label),
            blocks_to_best_other: ours.zip(other).and_then(|(a, b)| ratio(a, b, |r| r.ms)),
            blocks_to_best_other_mean: ours.zip(others().map(mean).reduce(f64::min)).map(|(a, b)| mean(a) / b),
            direct_to_blocks: named(DIRECT).zip(ours).and_then(|(a, b)| ratio(a, b, |r| r.ms)),
        }
    }
}

impl Comparison {
    /// Compares the updates of two runs that were measured interleaved; `None` unless both were right.
    pub fn new(name: &str, runs: [&RunRecord; 2], [first, second]: [String; 2], goal: &str) -> Option<Self> {
        if !runs.iter().all(|r| r.counts()) {
            return None;
        }
        let of = |round: &Round| round.update_ms;
        let median = |run: &RunRecord| Stats::of(&run.rounds.iter().map(of).collect::<Vec<_>>()).map(|s| s.median);
        let [first_ms, second_ms] = runs.map(|run| median(run).unwrap_or(run.median()));
        Some(Self {
            name: name.into(),
            first,
            second,
            first_ms,
            second_ms,
            ratio: ratio(runs[0], runs[1], of)?,
            n: runs.map(|run| run.time().map_or(0, |t| t.n)),
            goal: goal.into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::synthetic::technique as run;

    #[test]
    fn ratios_are_those_of_rounds() {
        let (ours, other) = (run("blocks", &[1.0, 10.0, 1.0]), run("compute", &[2.0, 20.0, 3.0]));
        assert_eq!(ratio(&ours, &other, |r| r.ms), Some(0.5), "not the third that medians give, nor what means do");
        // Only rounds that both have.
        assert_eq!(ratio(&run("direct", &[40.0, 500.0]), &ours, |r| r.ms), Some(45.0));
        let alone = RunRecord { alone: true, ..other };
        assert_eq!(ratio(&ours, &alone, |r| r.ms), Some(1.0 / 3.0), "medians, where there are no common rounds");
    }

    #[test]
    fn the_cpu_and_wrong_runs_do_not_compete() {
        let report = crate::bench::synthetic::suite();
        let cell = &report.suites[0].cells[0];
        assert_eq!(cell.fastest.as_deref(), Some("blocks fast"));
        assert_eq!((cell.blocks.as_deref(), cell.best_other.as_deref()), (Some("blocks fast"), Some("compute fast")));
        assert_eq!((cell.blocks_to_best_other, cell.direct_to_blocks), (Some(0.5), Some(45.0)));
        assert!(cell.blocks_to_best_other_mean.is_some_and(|r| (r - 12.0 / 25.0).abs() < 1e-12), "{cell:?}");
        let none = CellRecord::of("x", ["dense", "all"], 1, &report.runs[3..]);
        assert_eq!((none.fastest, none.blocks_to_best_other), (None, None));
    }

    #[test]
    fn a_comparison_is_of_two_right_runs() {
        let (a, b) = (run("blocks", &[8.0, 6.0]), run("blocks", &[2.0, 2.0]));
        let names = || ["a".to_owned(), "b".to_owned()];
        let found = Comparison::new("c", [&a, &b], names(), "3 or more").expect("both are right");
        assert_eq!((found.first_ms, found.second_ms, found.ratio, found.n), (3.5, 1.0, 3.5, [2, 2]));
        let wrong = RunRecord { verified: false, ..b };
        assert!(Comparison::new("c", [&a, &wrong], names(), "").is_none());
    }
}
