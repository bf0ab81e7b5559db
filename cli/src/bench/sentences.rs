//! The sentences that summarise a report, with numbers from its runs.

use super::compare::ratios;
use super::record::{Report, RunRecord, SuiteRecord, UNEVEN, fastest};
use crate::table::{count, sig3, thousands};
use deltamorph::BatchSize;

/// The most telling numbers.
pub fn sentences(report: &Report) -> Vec<String> {
    let runs: Vec<&RunRecord> = report.runs.iter().filter(|r| r.counts()).collect();
    let mut out: Vec<String> = match report.suites.is_empty() {
        true => of_runs(&runs),
        false => report.suites.iter().filter_map(of_suite).collect(),
    };
    let (all, wrong) = (report.runs.len(), report.runs.iter().filter(|r| !r.verified).count());
    if wrong > 0 {
        out.push(format!("{wrong} of {all} configurations gave a wrong result and were not timed."));
    } else if all > 0 {
        let worst = report.runs.iter().filter_map(|r| r.max_error_rel).fold(0.0, f64::max);
        let ran = if report.unmeasured.is_empty() { "" } else { " that could run" };
        out.push(format!(
            "All {} configurations{ran} match the float64 reference; the largest error is {} of the diagonal.",
            thousands(all),
            sig3(worst)
        ));
    }
    let uneven = report.runs.iter().filter(|run| run.uneven()).count();
    if uneven > 0 {
        out.push(format!(
            "The rounds of {uneven} of {all} configurations disagree by more than {UNEVEN} times (UNEVEN), as where other \
             work runs beside them; measure these again."
        ));
    }
    out
}

/// How often `blocks` is the fastest path of the device, and by how much where it is the least.
fn of_suite(suite: &SuiteRecord) -> Option<String> {
    let ratios: Vec<f64> = suite.cells.iter().filter_map(|c| c.blocks_to_best_other).collect();
    let wins = ratios.iter().filter(|r| **r <= 1.0).count();
    let worst = ratios.iter().copied().reduce(f64::max)?;
    let worst = match worst > 1.0 {
        true => format!("in the worst the best other is {} times as fast", sig3(worst)),
        false => format!("in the closest it is {} times as fast as the best other", sig3(1.0 / worst)),
    };
    let (title, cells) = (&suite.title, ratios.len());
    Some(format!("{title}: blocks is the fastest GPU path in {wins} of {cells} cells; {worst}."))
}

/// The runs of the first workload: gains of different ones do not compare. Rounds that disagree say nothing.
fn of_runs(runs: &[&RunRecord]) -> Vec<String> {
    let Some(first) = runs.first() else { return vec![] };
    let same = |r: &&RunRecord| (&r.workload, r.heads, r.draws) == (&first.workload, first.heads, first.draws);
    let runs: Vec<&RunRecord> = runs.iter().copied().filter(|run| same(run) && !run.uneven()).collect();
    let most = runs.iter().map(|run| run.changed).fold(0.0, f64::max);
    let hardest: Vec<&RunRecord> = runs.into_iter().filter(|run| run.changed == most).collect();
    [batching(&hardest), of_paths(&hardest)].into_iter().flatten().collect()
}

/// Whether two runs of one workload differ in nothing but path, format and batch size.
fn comparable(a: &RunRecord, b: &RunRecord) -> bool {
    (&a.mode, a.sums(), a.slots, a.shared) == (&b.mode, b.sums(), b.slots, b.shared)
}

/// The gain of batching in the case with the largest one.
fn batching(hardest: &[&RunRecord]) -> Option<String> {
    let gain = |run: &&RunRecord| {
        let single = hardest.iter().find(|one| {
            let own = (&one.path, &one.format) == (&run.path, &run.format) && comparable(one, run);
            own && one.batch_size == BatchSize::Targets(1)
        })?;
        // With as many passes as batch 1, a difference is noise.
        let several = run.batch_size != BatchSize::All && run.passes < single.passes;
        ratios(single, run, |round| round.ms).filter(|_| several)
    };
    let gains = hardest.iter().filter_map(|run| Some((gain(run)?.median, run)));
    let (gain, run) = gains.filter(|(gain, _)| *gain > 1.0).max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(format!("Batch {} is {gain:.1}× as fast as batch 1 on {} ({}).", run.batch_size, run.path, run.formats()))
}

/// How the fastest path of the device compares with the best other one.
fn of_paths(hardest: &[&RunRecord]) -> Option<String> {
    let device: Vec<&RunRecord> = hardest.iter().copied().filter(|run| run.gpu_ms.is_some()).collect();
    let rivals = |run: &RunRecord| {
        let others = device.iter().copied().filter(|other| other.path != run.path && comparable(other, run));
        fastest(others)
    };
    let best = fastest(device.iter().copied().filter(|run| rivals(run).is_some()))?;
    let other = rivals(best)?;
    let times = ratios(other, best, |round| round.ms)?.median;
    let [name, rival] = [best, other].map(|run| format!("{} {}", run.path, run.formats()));
    let (changed, targets) = (count(best.changed), best.targets);
    Some(format!(
        "With {changed} of {targets} targets changed, {name} is {times:.1}× as fast as the best other path of the device, \
         {rival}."
    ))
}
