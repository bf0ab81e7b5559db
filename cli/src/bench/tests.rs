//! Reports of made-up runs.

use super::record::{RunRecord, Skipped};
use super::sentences::sentences;
use super::stats::Stats;
use super::*;
use crate::output;
use deltamorph::BatchSize::{self, All, Targets};

/// A right run of `path`, with these times in its rounds.
fn run(path: &'static str, batch_size: BatchSize, rounds: &[f64]) -> RunRecord {
    let times = Stats::of(rounds);
    RunRecord {
        cell: "dense <1>, 1 head".into(),
        technique: path.into(),
        path,
        format: "snorm16",
        pose: "float32",
        batch_size,
        passes: if let Targets(n) = batch_size { 72.0 / f64::from(n) } else { 1.0 },
        gpu_ms: times.filter(|_| path != "cpu"),
        cpu_ms: times,
        rounds: rounds.to_vec(),
        verified: true,
        ..RunRecord::default()
    }
}

/// A cell in which the fastest is wrong, and one in which none is.
fn report() -> Report {
    let wrong =
        RunRecord { verified: false, problem: Some("off by a mile".into()), ..run("feedback", Targets(8), &[0.1]) };
    let mut runs = vec![
        run("compute", All, &[1.0, 10.0, 1.0]),
        run("feedback", Targets(16), &[2.0, 20.0, 3.0]),
        run("feedback", Targets(1), &[16.0, 160.0, 24.0]),
        run("cpu", All, &[0.1, 0.1, 0.1]),
    ];
    let other = |run: &RunRecord| RunRecord { cell: "clip talk, 1 head".into(), ..run.clone() };
    runs.extend(runs.iter().map(other).collect::<Vec<_>>());
    runs.push(wrong);
    let skipped = vec![Skipped { what: "feedback, batch all".into(), reason: "16 attributes hold 14 targets".into() }];
    Report { runs, skipped, ..Report::default() }
}

#[test]
fn wrong_runs_fail_the_command() {
    let mut report = report();
    let message = verdict(&report).expect_err("one is wrong").to_string();
    assert!(message.starts_with("1 of 9 ") && message.contains("feedback snorm16 batch 8: off by a mile"), "{message}");
    report.runs.retain(|r| r.verified);
    assert!(verdict(&report).is_ok());
    assert!(sentences(&report).join(" ").contains("All 8 configurations match the float64 reference"));
    report.unmeasured.push("feedback".into());
    assert!(sentences(&report).join(" ").contains("configurations that could run match"));
    let message = verdict(&report).expect_err("feedback was named").to_string();
    assert!(message.starts_with("feedback: no configuration of it") && message.contains("16 attributes"), "{message}");
    report.runs.clear();
    assert!(verdict(&report).is_err_and(|e| e.to_string().starts_with("no configuration could run; feedback")));
}

#[test]
fn sentences_compare_runs_of_one_cell() {
    let mut report = report();
    let said = |times: f64, pose: &str| {
        ["dense <1>, 1 head", "clip talk, 1 head"].map(|cell| {
            [
                format!("{cell}: batch 16 is 8.0× as fast as batch 1 on feedback snorm16."),
                format!(
                    "{cell}: compute{pose} snorm16 is {times:.1}× as fast as the best other path of the device, \
                     feedback{pose} snorm16."
                ),
            ]
        })
    };
    let wrong = "1 of 9 configurations gave a wrong result and were not timed.".to_owned();
    // Of rounds: medians would give 3 times, and the cpu and the wrong run do not compete.
    assert_eq!(sentences(&report), [said(2.0, "").concat(), vec![wrong.clone()]].concat());
    report.runs.iter_mut().filter(|run| run.path == "compute").for_each(|run| run.alone = true);
    assert_eq!(sentences(&report), [said(3.0, "").concat(), vec![wrong]].concat(), "medians, without common rounds");
    // Fixed-point poses, which take half the time, are compared with fixed-point ones.
    let fixed = |run: &RunRecord| {
        let gpu_ms = run.gpu_ms.map(|time| Stats { median: time.median / 2.0, ..time });
        RunRecord { gpu_ms, pose: "fixed32", technique: format!("{} fixed32", run.technique), ..run.clone() }
    };
    report.runs.extend(report.runs.iter().map(fixed).collect::<Vec<_>>());
    assert_eq!(sentences(&report)[1], said(3.0, " fixed32")[0][1]);
}

#[test]
fn rounds_that_disagree_are_told_and_prove_nothing() {
    let mut report = report();
    report.runs.iter_mut().for_each(|run| run.rounds_ratio = Some(1.62));
    let told = sentences(&report).join("\n");
    assert!(told.contains("of 9 configurations differ by more than a factor of 1.5 (UNEVEN)"), "{told}");
    assert!(!told.contains("as batch 1") && !told.contains("as the best other"), "{told}");
    assert!(tables::runs(&report.runs).to_string().contains("1.62× UNEVEN"));
    let in_page = format!("const UNEVEN = {};", record::UNEVEN);
    assert!(include_str!("report.html").contains(&in_page), "the page marks the same runs");
    let spread = |times: &[f64]| run("blocks", All, times).spread();
    assert_eq!(spread(&[1.0, 9.0, 1.5, 1.0, 0.1]), Some(1.5), "one late interrupt is none");
    assert_eq!((spread(&[2.0, 3.0, 4.0, 5.0]), spread(&[])), (None, None), "too few to tell");
}

#[test]
fn no_name_ends_the_element_that_holds_the_report() {
    let mut report = report();
    report.input.name = "</script><!--<script>".into();
    let page = report::page(&output::to_json(&report).expect("serialised"));
    let (_, rest) = page.split_once("id=\"report\">").expect("the element");
    let (json, _) = rest.split_once('<').expect("its end");
    let found: serde_json::Value = serde_json::from_str(json).expect("JSON");
    assert_eq!(found, serde_json::to_value(&report).expect("serialised"));
}
