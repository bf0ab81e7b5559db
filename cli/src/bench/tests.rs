//! Reports of made-up runs.

use super::sentences::sentences;
use super::*;
use crate::bench::record::RunRecord;
use crate::bench::stats::Stats;
use crate::bench::synthetic;
use crate::output;

#[test]
fn wrong_runs_fail_the_command() {
    let mut report = synthetic::report();
    let message = verdict(&report).expect_err("two are wrong").to_string();
    assert!(message.starts_with("2 of ") && message.contains("feedback float32 batch 8"), "{message}");
    report.runs.retain(|r| r.verified);
    assert!(verdict(&report).is_ok());
    assert!(!sentences::sentences(&report).join(" ").contains("could run"));
    report.unmeasured.push("feedback".into());
    let said = sentences::sentences(&report).join(" ");
    assert!(said.contains("configurations that could run match"), "{said}");
    let message = verdict(&report).expect_err("feedback was named").to_string();
    assert!(message.starts_with("feedback: no configuration of it") && message.contains("16 attributes"), "{message}");
    report.runs.clear();
    assert!(verdict(&report).is_err_and(|e| e.to_string().starts_with("no configuration could run; feedback")));
}

#[test]
fn sentences_compare_runs_of_one_cell() {
    let mut report = synthetic::report();
    let all = sentences(&report);
    let has = |words: &str| assert!(all.iter().any(|sentence| sentence.starts_with(words)), "{words}: {all:?}");
    has("clip speech_30fps, 1 head: batch 16 is 7.9× as fast as batch 1 on feedback snorm16.");
    has("72 of 72 targets changed, 1 head: batch 16 is 7.7× as fast as batch 1 on feedback snorm16.");
    has("72 of 72 targets changed, 1 head: compute snorm16 is ");
    has("clip speech_30fps, 1 head: compute snorm16 is ");
    has("2 of ");
    assert_eq!(all.len(), 2 * 5 + 1, "batches and paths of each cell, and whether all are right: {all:?}");
    let suite = sentences(&synthetic::suite());
    let said = "dense <1>, 1 head: blocks fast is 2.0× as fast as the best other path of the device, compute fast.";
    assert_eq!(suite[0], said, "the cpu and wrong runs do not compete");

    // Fixed-point poses, which take half the time, are compared with fixed-point ones.
    report.runs.retain(|run| run.changed == 72.0);
    let fixed = |run: RunRecord| {
        let gpu_ms = run.gpu_ms.map(|time| Stats { median: time.median / 2.0, ..time });
        RunRecord { gpu_ms, pose: "fixed32", technique: format!("{} fixed32", run.technique), ..run }
    };
    report.runs.extend(report.runs.clone().into_iter().map(fixed));
    let told = sentences(&report)[1].clone();
    assert!(told.contains(": compute fixed32 snorm16 is ") && told.ends_with(" feedback fixed32 snorm16."), "{told}");

    report.runs.retain(|run| run.path == "cpu");
    let few = sentences(&report);
    assert!(few.len() == 1 && few[0].contains("match the float64 reference"), "{few:?}");
}

#[test]
fn rounds_that_disagree_are_told_and_prove_nothing() {
    let uneven = |report: &mut Report| report.runs.iter_mut().for_each(|run| run.rounds_ratio = Some(1.62));
    let mut report = synthetic::report();
    uneven(&mut report);
    let told = sentences(&report).join("\n");
    assert!(told.contains("differ by more than a factor of 1.5 (UNEVEN)") && !told.contains("as batch 1"), "{told}");
    assert!(!told.contains("as the best other"), "{told}");
    assert!(tables::runs(&report.runs).to_string().contains("1.62× UNEVEN"));
    let in_page = format!("const UNEVEN = {};", record::UNEVEN);
    assert!(include_str!("report.html").contains(&in_page), "the page marks the same runs");
    let spread = |times: &[f64]| synthetic::technique("blocks", times).spread();
    assert_eq!(spread(&[1.0, 9.0, 1.5, 1.0, 0.1]), Some(1.5), "one late interrupt is none");
    assert_eq!((spread(&[2.0, 3.0, 4.0, 5.0]), spread(&[])), (None, None), "too few to tell");
}

#[test]
fn no_name_ends_the_element_that_holds_the_report() {
    let mut report = synthetic::suite();
    report.input.name = "</script><!--<script>".into();
    let page = report::page(&output::to_json(&report).expect("serialised"));
    let (_, rest) = page.split_once("id=\"report\">").expect("the element");
    let (json, _) = rest.split_once('<').expect("its end");
    let found: serde_json::Value = serde_json::from_str(json).expect("JSON");
    assert_eq!(found, serde_json::to_value(&report).expect("serialised"));
}
