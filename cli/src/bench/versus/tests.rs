//! Comparisons of made-up reports.

use super::*;
use crate::bench::record::Round;
use crate::bench::synthetic;
use deltamorph::BatchSize;

/// A report with a run for each batch size from 1, which takes the given number of ms: ten rounds within 3% of it.
fn report(times: &[f64]) -> Report {
    let [run, ..] = &synthetic::report().runs[..] else { panic!("it has runs") };
    let run = |(i, ms): (usize, &f64)| {
        let rounds = (0..10).map(|i| ms * (0.97 + 0.006 * f64::from(i)));
        let rounds: Vec<Round> = rounds.map(|ms| Round { ms, update_ms: ms }).collect();
        let gpu_ms = Stats::of(&rounds.iter().map(|round| round.ms).collect::<Vec<_>>());
        RunRecord { batch_size: BatchSize::Targets(i as u32 + 1), gpu_ms, rounds, ..run.clone() }
    };
    Report { runs: times.iter().enumerate().map(run).collect(), ..synthetic::report() }
}

fn compared(reports: &[&Report]) -> Comparison {
    let named: Vec<_> =
        reports.iter().enumerate().map(|(i, report)| (format!("{i}/report.json"), (*report).clone())).collect();
    Comparison::new(named).expect("some in common")
}

fn verdicts(found: &Against) -> Vec<Verdict> {
    found.configurations.iter().map(|pair| pair.verdict).collect()
}

#[test]
fn differences_beyond_the_spread_are_told_and_others_marked() {
    use Verdict::{Faster, Slower, WithinSpread};
    let before = report(&[10.0, 10.0, 10.0, 10.0]);
    let found = compared(&[&before, &report(&[8.0, 10.4, 12.0, 10.0])]);
    let [against] = &found.comparisons[..] else { panic!("one other") };
    assert_eq!(verdicts(against), [Faster, WithinSpread, Slower, WithinSpread]);
    assert_eq!((against.faster, against.within_spread, against.slower), (1, 2, 1));
    for (pair, ms) in against.configurations.iter().zip([8.0, 10.4, 12.0, 10.0]) {
        let Pair { ratio: Some(ratio), spread: Some(spread), time, n, .. } = pair else { panic!("{pair:?}") };
        assert!((ratio - ms / 10.0).abs() < 1e-12 && (*time, *n) == ("update", [10, 10]), "{pair:?}");
        assert!((spread[0] / ms - 0.97).abs() < 1e-12 && (spread[1] / ms - 1.024).abs() < 1e-12, "{pair:?}");
    }
    let mean = (0.8f64 * 1.04 * 1.2).powf(0.25);
    assert!(against.ratio_mean.is_some_and(|m| (m - mean).abs() < 1e-12));
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
    let text = found.text();
    assert!(text.contains("of 4 configurations in both 1 are faster, 1 slower, 2 within the spread"), "{text}");
    // A report is no different from itself.
    assert_eq!(verdicts(&compared(&[&before, &before]).comparisons[0]), [WithinSpread; 4]);
    // Without rounds, frames decide; too few are undecided.
    let bare = |values: &[f64]| {
        let mut report = report(&[10.0]);
        (report.runs[0].rounds, report.runs[0].gpu_ms) = (vec![], Stats::of(values));
        report
    };
    let found = compared(&[&bare(&[1.0; 4]), &bare(&[5.0; 4]), &bare(&[5.0])]);
    let of = |against: &Against| (verdicts(against)[0], against.configurations[0].ratio);
    assert_eq!(of(&found.comparisons[0]), (Slower, Some(5.0)));
    assert_eq!(of(&found.comparisons[1]), (Verdict::Undecided, Some(5.0)));
}

#[test]
fn only_the_same_work_is_compared() {
    let before = report(&[10.0, 10.0, 10.0]);
    let mut after = report(&[10.0, 10.0]);
    after.runs[1].format = "fast".into();
    let found = compared(&[&before, &after]);
    let against = &found.comparisons[0];
    assert_eq!((against.configurations.len(), against.only_in_baseline.len(), against.only_here.len()), (1, 2, 1));
    assert_eq!((&against.only_here[0]["format"], &against.only_here[0]["batch_size"]), (&"fast".into(), &2.into()));
    for change in [
        |run: &mut RunRecord| run.path = "blocks".into(),
        |run: &mut RunRecord| run.mode = "rebuild".into(),
        |run: &mut RunRecord| run.pose = "fixed32".into(),
        |run: &mut RunRecord| run.changed = 3.0,
        |run: &mut RunRecord| run.heads = 7,
        |run: &mut RunRecord| run.slots = 3,
        |run: &mut RunRecord| run.mesh = "other".into(),
        |run: &mut RunRecord| run.shared = true,
        |run: &mut RunRecord| run.workload = "speech".into(),
        |run: &mut RunRecord| run.cell = "dense".into(),
    ] {
        let mut other = before.clone();
        change(&mut other.runs[0]);
        assert_eq!(compared(&[&before, &other]).comparisons[0].configurations.len(), 2);
    }
    // Versions without pose formats had only float32; for clips, the number of changed targets may differ.
    let mut old = before.clone();
    old.runs[0].pose.clear();
    let mut clip = before.clone();
    clip.runs.iter_mut().for_each(|run| run.workload = "speech".into());
    let mut other = clip.clone();
    other.runs[0].changed = 2.5;
    // Repeated configurations are paired in order.
    let mut twice = before.clone();
    twice.runs.extend(before.runs.clone());
    for (a, b, common) in [(&before, &old, 3), (&clip, &other, 3), (&twice, &twice, 6), (&before, &twice, 3)] {
        assert_eq!(compared(&[a, b]).comparisons[0].configurations.len(), common);
    }
    let mut foreign = before.clone();
    foreign.runs.iter_mut().for_each(|run| run.path = "blocks".into());
    let error =
        Comparison::new(vec![("a".into(), before.clone()), ("b".into(), foreign.clone())]).expect_err("nothing");
    let text = error.to_string();
    assert!(text.contains("path: feedback in the one, blocks in the other") && text.contains("same INPUT"), "{text}");
    // One of three reports may be unusable.
    let found = compared(&[&before, &before, &foreign]);
    assert!(
        found.warnings.iter().any(|warning| warning.starts_with("C (2/report.json) has no configuration in common"))
    );
    assert!(found.text().contains("3 only in C"));
}

#[test]
fn other_machines_and_meshes_are_told() {
    let before = report(&[10.0]);
    let mut after = before.clone();
    after.device.name = "Another".into();
    after.device.threads = 64;
    after.input.vertices = 12;
    let warnings = compared(&[&before, &after]).warnings;
    assert_eq!(warnings.len(), 3, "{warnings:?}");
    for (warning, words) in
        warnings.iter().zip(["Example GPU <1> in A, Another in B", "64 threads in B", "12 vertices"])
    {
        assert!(warning.contains(words), "{warning}");
    }
}

#[test]
fn wrong_runs_are_told_and_not_compared() {
    let before = report(&[10.0, 10.0]);
    let mut after = report(&[10.0, 10.0]);
    let run = &mut after.runs[1];
    (run.verified, run.gpu_ms, run.problem) = (false, None, Some("vertex 17 is off".into()));
    let found = compared(&[&before, &after]);
    let against = &found.comparisons[0];
    assert_eq!(verdicts(against), [Verdict::WithinSpread, Verdict::Wrong]);
    let wrong = &against.configurations[1];
    assert_eq!((wrong.ratio, wrong.spread, wrong.problem.as_deref()), (None, None, Some("B: vertex 17 is off")));
    let text = found.text();
    assert!(text.contains("1 wrong") && text.contains("B: vertex 17 is off"), "{text}");
}

/// If one run lacks a time, two different times are not compared.
#[test]
fn the_same_times_are_compared() {
    let before = report(&[10.0]);
    let mut after = report(&[10.0]);
    after.runs[0].gpu_ms = None;
    let pair = &compared(&[&before, &after]).comparisons[0].configurations[0];
    assert_eq!((pair.time, pair.ms), ("round trip", after.runs[0].cpu_ms.map(|time| time.median)));
}
