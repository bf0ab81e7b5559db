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
        let rounds = rounds.map(|ms| Round { ms, update_ms: ms }).collect();
        RunRecord { batch_size: BatchSize::Targets(i as u32 + 1), rounds, ..run.clone() }
    };
    Report { runs: times.iter().enumerate().map(run).collect(), ..synthetic::report() }
}

/// A report with one run, changed.
fn changed(change: impl FnOnce(&mut RunRecord)) -> Report {
    let mut report = report(&[10.0]);
    change(&mut report.runs[0]);
    report
}

fn compare(a: &Report, b: &Report) -> Result<Comparison, Failure> {
    Comparison::new(&[("a.json".into(), a.clone()), ("b.json".into(), b.clone())])
}

fn verdicts(a: &Report, b: &Report) -> Vec<&'static str> {
    let found = compare(a, b).expect("some in common");
    found.comparisons[0].configurations.iter().map(|pair| pair.verdict).collect()
}

#[test]
fn differences_beyond_the_spread_are_told_and_others_marked() {
    let before = report(&[10.0; 4]);
    let found = compare(&before, &report(&[8.0, 10.4, 12.0, 10.0])).expect("all in common");
    let pairs = &found.comparisons[0].configurations;
    for (pair, (ms, verdict)) in
        pairs.iter().zip([(8.0, "faster"), (10.4, "within_spread"), (12.0, "slower"), (10.0, "within_spread")])
    {
        let Pair { ratio: Some(ratio), spread: Some(spread), time, n, .. } = pair else { panic!("{pair:?}") };
        assert_eq!((pair.verdict, *time, *n), (verdict, "update", [10, 10]));
        assert!((ratio - ms / 10.0).abs() < 1e-12, "{pair:?}");
        assert!((spread[0] / ms - 0.97).abs() < 1e-12 && (spread[1] / ms - 1.024).abs() < 1e-12, "{pair:?}");
    }
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
    let text = found.text();
    assert!(text.contains("B against A: of 4 configurations in both 1 are faster, 1 slower, 2 within"), "{text}");
    // A report is no different from itself.
    assert_eq!(verdicts(&before, &before), ["within_spread"; 4]);
    // Without rounds, frames decide; too few are undecided.
    let bare = |values: &[f64]| changed(|run| (run.rounds, run.gpu_ms) = (vec![], Stats::of(values)));
    assert_eq!(verdicts(&bare(&[1.0; 4]), &bare(&[5.0; 4])), ["slower"]);
    assert_eq!(verdicts(&bare(&[1.0; 4]), &bare(&[5.0])), ["undecided"]);
    // If one run lacks a time, two different times are not compared.
    assert_eq!(verdicts(&before, &changed(|run| run.gpu_ms = None)), ["undecided"]);
}

#[test]
fn only_the_same_work_is_compared() {
    let one = report(&[10.0]);
    for change in [
        |run: &mut RunRecord| run.path = "blocks".into(),
        |run: &mut RunRecord| run.mode = "rebuild".into(),
        |run: &mut RunRecord| run.format = "fast".into(),
        |run: &mut RunRecord| run.pose = "fixed32".into(),
        |run: &mut RunRecord| run.changed = 3.0,
        |run: &mut RunRecord| run.heads = 7,
        |run: &mut RunRecord| run.slots = 3,
        |run: &mut RunRecord| run.mesh = "other".into(),
        |run: &mut RunRecord| run.shared = true,
        |run: &mut RunRecord| run.workload = "speech".into(),
        |run: &mut RunRecord| run.cell = "dense".into(),
    ] {
        let other = changed(change);
        let error = compare(&one, &other).expect_err("nothing in common").to_string();
        assert!(error.starts_with("a.json, b.json: no configuration") && error.contains("same INPUT"), "{error}");
        let more = Report { runs: [&one.runs[..], &other.runs].concat(), ..one.clone() };
        let found = compare(&one, &more).expect("one in common");
        let Against { configurations, only_in_baseline, only_here, .. } = &found.comparisons[0];
        assert_eq!((configurations.len(), only_in_baseline.len(), only_here.len()), (1, 0, 1));
        assert!(found.text().contains("1 only in B"));
    }
    // For clips, the number of changed targets may differ.
    let clip = |targets| changed(|run| (run.workload, run.changed) = ("speech".into(), targets));
    assert_eq!(verdicts(&clip(2.0), &clip(2.5)), ["within_spread"]);
}

#[test]
fn other_machines_and_meshes_are_told() {
    let before = report(&[10.0]);
    let mut after = before.clone();
    (after.device.name, after.device.threads, after.input.vertices) = ("Another".into(), 64, 12);
    let warnings = compare(&before, &after).expect("one in common").warnings;
    assert_eq!(warnings.len(), 3, "{warnings:?}");
    for (warning, words) in
        warnings.iter().zip(["12 vertices", "Example GPU <1> in A, Another in B", "64 threads in B"])
    {
        assert!(warning.contains(words), "{warning}");
    }
}

#[test]
fn wrong_runs_are_told_and_not_compared() {
    let wrong = changed(|run| (run.verified, run.gpu_ms, run.problem) = (false, None, Some("vertex 17 is off".into())));
    let found = compare(&report(&[10.0]), &wrong).expect("one in common");
    let pair = &found.comparisons[0].configurations[0];
    assert_eq!((pair.verdict, pair.ratio, pair.spread, pair.n), ("wrong", None, None, [0, 0]));
    let text = found.text();
    assert!(text.contains("1 wrong") && text.contains("B: vertex 17 is off"), "{text}");
}
