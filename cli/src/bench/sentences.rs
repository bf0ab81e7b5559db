//! The sentences that summarise a report, with numbers from its runs.

use super::compare::OURS;
use super::group::{by_family, gain, hardest};
use super::record::{Report, RunRecord, SuiteRecord, UNEVEN, batch_words, fastest};
use crate::table::{count, percent, sig3, thousands};
use deltamorph::BatchSize;

pub fn title(suite: &SuiteRecord) -> &str {
    match suite.name.as_str() {
        "crowd" => "One head and many",
        "techniques" => "Every technique, side by side",
        "constant" => "Constant weights beside animated ones",
        "faces" => "A scene of faces of four rigs",
        "clips" => "Every technique on captured clips",
        other => other,
    }
}

/// The most telling numbers; the first sentence is the heading.
pub fn sentences(report: &Report) -> Vec<String> {
    let runs: Vec<&RunRecord> = report.runs.iter().filter(|r| r.counts()).collect();
    let mut out: Vec<String> = match report.suites.is_empty() {
        true => of_runs(&runs),
        false => report.suites.iter().map(of_suite).collect(),
    };
    let (all, wrong) = (report.runs.len(), report.runs.iter().filter(|r| !r.verified).count());
    if out.is_empty() {
        out.push(format!("{all} configurations, none of them timed"));
    }
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
    if !report.unmeasured.is_empty() {
        out.push(format!("Named, but none of it could run: {}.", report.unmeasured.join(", ")));
    }
    out
}

/// The most telling numbers of a suite: the largest ratio found, or how often `blocks` is the fastest.
pub fn of_suite(suite: &SuiteRecord) -> String {
    let ratios: Vec<f64> = suite.cells.iter().filter_map(|c| c.blocks_to_best_other).collect();
    let (title, wins) = (title(suite), ratios.iter().filter(|r| **r <= 1.0).count());
    if let Some(worst) = ratios.iter().copied().reduce(f64::max) {
        let worst = match worst > 1.0 {
            true => format!("in the worst the best other is {} times as fast", sig3(worst)),
            false => format!("in the closest it is {} times as fast as the best other", sig3(1.0 / worst)),
        };
        return format!("{title}: blocks is the fastest GPU path in {wins} of {} cells; {worst}.", ratios.len());
    }
    match suite.comparisons.iter().max_by(|a, b| a.ratio.total_cmp(&b.ratio)) {
        Some(c) => format!("{title}: {} is {} times as fast as {} ({}).", c.second, sig3(c.ratio), c.first, c.name),
        None => format!("{title}: nothing to compare."),
    }
}

/// The runs of the first workload: gains of different ones do not compare. Rounds that disagree say nothing.
fn of_runs(runs: &[&RunRecord]) -> Vec<String> {
    let Some(first) = runs.first() else { return vec![] };
    let same = |r: &&RunRecord| (&r.workload, r.heads, r.draws) == (&first.workload, first.heads, first.draws);
    let runs: Vec<&RunRecord> = runs.iter().copied().filter(|run| same(run) && !run.uneven()).collect();
    let hardest = hardest(&runs);
    let Some(best) = fastest(hardest.iter().copied()) else { return vec![] };
    [batching(&hardest), Some(of_best(best)), of_blocks(&hardest), changed(&runs, best)].into_iter().flatten().collect()
}

/// The gain of batching in the case with the largest one.
fn batching(hardest: &[&RunRecord]) -> Option<String> {
    let gains = by_family(hardest).into_iter().flat_map(|(_, own)| {
        let single = own.iter().find(|r| r.batch_size == BatchSize::Targets(1));
        let passes = single.map_or(0.0, |r| r.passes);
        // With as many passes as batch 1, a difference is noise.
        let several = |r: &&RunRecord| r.batch_size != BatchSize::All && r.passes < passes;
        let gain = |run| gain(run, &own).map(|gain| (gain.median, run));
        own.iter().copied().filter(several).filter_map(gain).collect::<Vec<_>>()
    });
    let (gain, run) = gains.filter(|(gain, _)| *gain > 1.0).max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(format!("Batch {} is {gain:.1}× as fast as batch 1 on {} ({}).", run.batch_size, run.path, run.formats()))
}

/// How the incremental path compares with the others of the device, each at its best.
fn of_blocks(hardest: &[&RunRecord]) -> Option<String> {
    let device = hardest.iter().copied().filter(|run| run.path != "cpu");
    let (blocks, others) = device.partition::<Vec<_>, _>(|run| run.path == OURS);
    let (blocks, other) = (fastest(blocks)?, fastest(others)?);
    let [ours, theirs] = [blocks, other].map(|run| format!("{} {}", run.path, run.formats()));
    let times = other.median() / blocks.median();
    Some(format!("On the device {ours} is {times:.1}× as fast as the best of the other paths, {theirs}."))
}

/// The fastest configuration of the hardest work.
fn of_best(run: &RunRecord) -> String {
    let floor = match run.floor_fraction {
        // The floor is measured with a copy in memory; data in a cache can beat it.
        Some(share) if share > 1.0 => ", faster than a plain copy of as many bytes".into(),
        Some(share) => format!(", {} of what memory bandwidth allows", percent(share)),
        None => String::new(),
    };
    let drawn = if run.update_and_draw_ms.is_some() { ", draws included" } else { "" };
    let (changed, ms, batch) = (count(run.changed), sig3(run.median()), batch_words(run.batch_size));
    let fastest = format!("{} {}, {batch}: {ms} ms per frame{drawn}{floor}", run.path, run.formats());
    format!("With {changed} targets changed per frame the fastest is {fastest}.")
}

/// The gain of changing fewer targets, if `all` is the fastest with most of them.
fn changed(runs: &[&RunRecord], all: &RunRecord) -> Option<String> {
    let least = runs.iter().map(|r| r.changed).reduce(f64::min).filter(|least| *least < all.changed)?;
    let few = fastest(runs.iter().copied().filter(|r| r.changed == least))?;
    let (few_ms, most_ms, times) = (sig3(few.median()), sig3(all.median()), all.median() / few.median());
    let (most, targets) = (all.changed, all.targets);
    Some(format!(
        "At its fastest, changing {least:.0} of {targets} targets takes {few_ms} ms ({} {}), changing {most:.0} \
         {most_ms} ms: {times:.1} times as long.",
        few.path,
        few.formats()
    ))
}
