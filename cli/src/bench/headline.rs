//! The sentences that sum a report up, with numbers from its runs.

use super::family::Family;
use super::record::{Report, RunRecord};
use super::select::{batch_words, fastest, median, relative};
use super::suites;
use crate::table::{count, percent, sig3, thousands};
use deltamorph::BatchSize;

/// The most telling numbers, the first of which is the heading.
pub fn sentences(report: &Report) -> Vec<String> {
    let runs: Vec<&RunRecord> = report.runs.iter().filter(|r| r.counts()).collect();
    let wrong = report.runs.iter().filter(|r| !r.verified).count();
    let mut out: Vec<String> = match report.suites.is_empty() {
        true => [batching(&runs), best(&runs), changed(&runs)].into_iter().flatten().collect(),
        false => report.suites.iter().map(|suite| suites::text::sentence(suite, report)).collect(),
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

/// Runs that differ from `run` in the batch size only.
fn siblings<'a>(runs: &[&'a RunRecord], run: &RunRecord) -> Vec<&'a RunRecord> {
    let key = |r: &RunRecord| (Family::of(r), r.workload.clone(), r.heads, r.changed.to_bits());
    runs.iter().filter(|r| key(r) == key(run)).copied().collect()
}

/// What batching gains where it gains most.
fn batching(runs: &[&RunRecord]) -> Option<String> {
    let (first, most) = (runs.first()?, runs.iter().map(|r| r.changed).fold(0.0, f64::max));
    // One workload: gains of different ones do not compare.
    let numbered = runs.iter().filter(|r| {
        let same = (&r.workload, r.heads, r.changed) == (&first.workload, first.heads, most);
        same && matches!(r.batch_size, BatchSize::Targets(_))
    });
    let gains = numbered.filter_map(|r| {
        let siblings = siblings(runs, r);
        // As many passes as one at a time: what differs then is noise.
        let single = siblings.iter().find(|s| s.batch_size == BatchSize::Targets(1))?;
        let (gain, error) = relative(r, &siblings).filter(|_| r.passes < single.passes)?;
        (gain - 2.0 * error > 1.0).then_some((gain, *r))
    });
    let (gain, run) = gains.max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(format!(
        "{} is {gain:.1}× as fast as batch 1 on {} ({})",
        capital(&batch_words(run.batch_size)),
        run.path,
        run.format
    ))
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
        sig3(median(run)),
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
            sig3(median(few)),
            sig3(median(all)),
            median(all) / median(few)
        )
    })
}

fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map(|c| c.to_uppercase().chain(chars).collect()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::synthetic;

    #[test]
    fn numbers_come_from_the_runs() {
        let report = synthetic::report();
        let all = sentences(&report);
        assert!(
            all[0].starts_with("Batch 16 is 7.7× as fast") && all[0].ends_with("on feedback (snorm16)"),
            "{}",
            all[0]
        );
        assert!(all[1].contains("72 targets") && all[1].contains("compute snorm16, one pass"), "{}", all[1]);
        assert!(all[2].starts_with("Changing 4 of 72 targets"), "{}", all[2]);
        assert!(all[3].starts_with("2 of "), "{}", all[3]);
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
