//! The sentences that sum a report up, with numbers from its runs.

use super::family::Family;
use super::figures::relative;
use crate::bench::compare::{Comparison, SuiteRecord};
use crate::bench::record::Report;
use crate::bench::run::{RunRecord, batch_words, fastest};
use crate::table::{count, percent, sig3, thousands};
use deltamorph::BatchSize;

pub fn title(suite: &SuiteRecord) -> &str {
    match suite.name.as_str() {
        "chapter" => "What batching gains",
        "crowd" => "One head and many",
        "techniques" => "Every technique, side by side",
        "clips" => "Every technique on captured clips",
        other => other,
    }
}

/// The most telling numbers, the first of which is the heading.
pub fn sentences(report: &Report) -> Vec<String> {
    let runs: Vec<&RunRecord> = report.runs.iter().filter(|r| r.counts()).collect();
    let wrong = report.runs.iter().filter(|r| !r.verified).count();
    let mut out: Vec<String> = match report.suites.is_empty() {
        true => [batching(&runs), best(&runs), changed(&runs)].into_iter().flatten().collect(),
        false => report.suites.iter().map(|suite| of_suite(suite, report)).collect(),
    };
    if out.is_empty() {
        out.push(format!("{} configurations, none of them timed", report.runs.len()));
    }
    if wrong > 0 {
        out.push(format!("{wrong} of {} configurations gave a wrong result and were not timed.", report.runs.len()));
    } else if !report.runs.is_empty() {
        let worst = report.runs.iter().filter_map(|r| r.max_error_rel).fold(0.0, f64::max);
        out.push(format!(
            "All {} configurations match the float64 reference; the largest error is {} of the diagonal.",
            thousands(report.runs.len()),
            sig3(worst)
        ));
    }
    out
}

/// The most telling numbers of a suite.
pub fn of_suite(suite: &SuiteRecord, report: &Report) -> String {
    match suite.name.as_str() {
        "chapter" => match suite.comparisons.iter().max_by(|a, b| a.ratio.total_cmp(&b.ratio)) {
            Some(c) => format!("Chapter: {} is {} times as fast as batch 1 ({}).", c.second, sig3(c.ratio), c.name),
            None => "Chapter: no path with batches could run.".into(),
        },
        "crowd" => {
            let crowds = suite.comparisons.iter().filter(|c| c.second.contains("crowd"));
            let gain = |c: &Comparison| format!("{} times as fast as {} ({})", sig3(c.ratio), c.first, c.name);
            let gains: Vec<String> = crowds.map(gain).collect();
            match gains.is_empty() {
                true => format!("Crowd: {} runs.", report.runs_of(Some(suite)).count()),
                false => format!("Crowd: one crowd is {}.", gains.join(", ")),
            }
        }
        _ => {
            let ratios: Vec<f64> = suite.cells.iter().filter_map(|c| c.blocks_to_best_other).collect();
            let wins = ratios.iter().filter(|r| **r <= 1.0).count();
            match ratios.iter().copied().reduce(f64::max) {
                None => format!("{}: nothing to compare.", title(suite)),
                Some(worst) => format!(
                    "{}: blocks is the fastest GPU path in {wins} of {} cells; in the worst it takes {} \
                     times what the best other takes.",
                    title(suite),
                    ratios.len(),
                    sig3(worst)
                ),
            }
        }
    }
}

/// What batching gains where it gains most.
fn batching(runs: &[&RunRecord]) -> Option<String> {
    let (first, most) = (runs.first()?, runs.iter().map(|r| r.changed).fold(0.0, f64::max));
    // One workload: gains of different ones do not compare.
    let hardest: Vec<&RunRecord> = runs
        .iter()
        .copied()
        .filter(|r| (&r.workload, r.heads, r.changed) == (&first.workload, first.heads, most))
        .collect();
    let gains = hardest.iter().filter(|r| matches!(r.batch_size, BatchSize::Targets(_))).filter_map(|run| {
        let family = Family::of(run);
        let own: Vec<&RunRecord> = hardest.iter().copied().filter(|r| Family::of(r) == family).collect();
        // As many passes as one at a time: what differs then is noise.
        let single = own.iter().find(|r| r.batch_size == BatchSize::Targets(1))?;
        let (gain, error) = relative(run, &own).filter(|_| run.passes < single.passes)?;
        (gain - 2.0 * error > 1.0).then_some((gain, *run))
    });
    let (gain, run) = gains.max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(format!("Batch {} is {gain:.1}× as fast as batch 1 on {} ({})", run.batch_size, run.path, run.format))
}

/// The fastest configuration of the hardest work.
fn best(runs: &[&RunRecord]) -> Option<String> {
    let most = runs.iter().map(|r| r.changed).fold(0.0, f64::max);
    let one = runs.iter().filter(|r| r.changed == most && r.heads == runs[0].heads && r.workload == runs[0].workload);
    let run = fastest(one.copied())?;
    let floor = match run.floor_fraction {
        // The floor is measured with a copy in memory; what stays in a cache can beat it.
        Some(share) if share > 1.0 => ", faster than a plain copy of as many bytes".into(),
        Some(share) => format!(", {} of what memory bandwidth allows", percent(share)),
        None => String::new(),
    };
    let drawn = if run.update_and_draw_ms.is_some() { ", draws included" } else { "" };
    Some(format!(
        "With {} targets changed per frame the fastest is {} {}, {}: {} ms per frame{drawn}{floor}.",
        count(run.changed),
        run.path,
        run.format,
        batch_words(run.batch_size),
        sig3(run.median()),
    ))
}

/// What changing fewer targets saves.
fn changed(runs: &[&RunRecord]) -> Option<String> {
    let random: Vec<&RunRecord> = runs.iter().filter(|r| r.workload == "random").copied().collect();
    let (least, most) =
        random.iter().fold((f64::INFINITY, 0.0f64), |(lo, hi), r| (lo.min(r.changed), hi.max(r.changed)));
    let at = |n: f64| fastest(random.iter().filter(|r| r.changed == n && r.heads == random[0].heads).copied());
    let (few, all) = (at(least)?, at(most)?);
    let total = few.targets.max(most as usize);
    let more = if most as usize == total { "all".into() } else { format!("{most:.0}") };
    (least < most).then(|| {
        format!(
            "Changing {least:.0} of {total} targets takes {} ms, changing {more} {} ms: {:.1} times as long.",
            sig3(few.median()),
            sig3(all.median()),
            all.median() / few.median()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::synthetic;

    #[test]
    fn numbers_come_from_the_runs() {
        let all = sentences(&synthetic::report());
        for (sentence, words) in [
            (0, "Batch 16 is 7.7× as fast as batch 1 on feedback (snorm16)"),
            (1, "With 72 targets changed per frame the fastest is compute snorm16, one pass: "),
            (2, "Changing 4 of 72 targets"),
            (3, "2 of "),
        ] {
            assert!(all[sentence].starts_with(words), "{all:?}");
        }
        let suite = sentences(&synthetic::suite());
        assert!(suite[0].contains("fastest GPU path in 1 of 1 cells"), "{suite:?}");
    }

    #[test]
    fn little_data_makes_few_sentences() {
        let mut report = synthetic::report();
        report.runs.retain(|r| r.path == "cpu" && r.changed == 72.0);
        let all = sentences(&report);
        assert!(all[0].contains("the fastest is cpu") && all[1].contains("match the float64 reference"), "{all:?}");
        report.runs.clear();
        assert_eq!(sentences(&report), ["0 configurations, none of them timed"]);
    }
}
