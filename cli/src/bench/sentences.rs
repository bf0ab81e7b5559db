//! The sentences that summarise a report, with numbers from its runs.

use super::record::{Report, RunRecord, UNEVEN, fastest};
use super::stats::Stats;
use crate::table::{sig3, thousands};
use deltamorph::BatchSize;

/// The most telling numbers. Each compares like with like: runs of one cell.
pub fn sentences(report: &Report) -> Vec<String> {
    let (runs, all) = (&report.runs, report.runs.len());
    // Rounds that disagree say nothing.
    let timed: Vec<&RunRecord> = runs.iter().filter(|run| run.counts() && !run.uneven()).collect();
    let mut cells: Vec<Vec<&RunRecord>> = vec![];
    for run in timed {
        match cells.iter_mut().find(|cell| (&cell[0].suite, &cell[0].cell) == (&run.suite, &run.cell)) {
            Some(cell) => cell.push(run),
            None => cells.push(vec![run]),
        }
    }
    let of_cell = |cell: &Vec<&RunRecord>| [batching(cell), of_paths(cell)].into_iter().flatten();
    let mut out: Vec<String> = cells.iter().flat_map(of_cell).collect();
    let wrong = runs.iter().filter(|run| !run.verified).count();
    if wrong > 0 {
        out.push(format!("{wrong} of {all} configurations gave a wrong result and were not timed."));
    } else if all > 0 {
        let worst = runs.iter().filter_map(|run| run.max_error_rel).fold(0.0, f64::max);
        let ran = if report.unmeasured.is_empty() { "" } else { " that could run" };
        out.push(format!(
            "All {} configurations{ran} match the float64 reference; the largest error is {} of the diagonal.",
            thousands(all),
            sig3(worst)
        ));
    }
    let uneven = runs.iter().filter(|run| run.uneven()).count();
    if uneven > 0 {
        out.push(format!(
            "The rounds of {uneven} of {all} configurations differ by more than a factor of {UNEVEN} (UNEVEN); close \
             other programs, and measure these again."
        ));
    }
    out
}

/// `a` over `b`: the median of the ratios of their rounds; the ratio of medians if they were not measured in turns.
fn ratio(a: &RunRecord, b: &RunRecord) -> Option<f64> {
    if a.alone || b.alone || a.rounds.is_empty() || b.rounds.is_empty() {
        return Some(a.median() / b.median());
    }
    let ratios: Vec<f64> = a.rounds.iter().zip(&b.rounds).map(|(a, b)| a / b).collect();
    Stats::of(&ratios).map(|ratios| ratios.median)
}

/// The largest gain of batching. With as many passes as batch 1, a difference is noise.
fn batching(cell: &[&RunRecord]) -> Option<String> {
    let gain = |run: &RunRecord| {
        let alike = |one: &&&RunRecord| one.label() == run.label() && one.batch_size == BatchSize::Targets(1);
        let single = cell.iter().find(alike)?;
        let several = run.batch_size != BatchSize::All && run.passes < single.passes;
        ratio(single, run).filter(|gain| several && *gain > 1.0)
    };
    let gains = cell.iter().filter_map(|run| Some((gain(run)?, run)));
    let (gain, run) = gains.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let (cell, batch, label) = (&run.cell, run.batch_size, run.label());
    Some(format!("{cell}: batch {batch} is {gain:.1}× as fast as batch 1 on {label}."))
}

/// How the fastest path of the device compares with the best other one: in the same pose format, if there is one.
fn of_paths(cell: &[&RunRecord]) -> Option<String> {
    let device = || cell.iter().copied().filter(|run| run.gpu_ms.is_some());
    let best = fastest(device())?;
    let others = || device().filter(|run| run.path != best.path);
    let other = fastest(others().filter(|run| run.pose == best.pose)).or_else(|| fastest(others()))?;
    let times = ratio(other, best)?;
    let (cell, name, rival) = (&best.cell, best.label(), other.label());
    Some(format!("{cell}: {name} is {times:.1}× as fast as the best other path of the device, {rival}."))
}
