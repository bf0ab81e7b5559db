//! Tests of what suites say, without measuring anything.

use super::record::{CellRecord, Comparison, SuiteRecord, ratio};
use super::{figures, page, text};
use crate::bench::record::{Report, Round, RunRecord};
use crate::bench::synthetic;

/// A run of `technique` that took these times in its rounds.
fn run(technique: &str, rounds: &[f64]) -> RunRecord {
    let report = synthetic::report();
    let like = report.runs.iter().find(|r| r.path == if technique == "cpu" { "cpu" } else { "compute" });
    let times = crate::bench::stats::Stats::of(rounds);
    RunRecord {
        suite: "techniques".into(),
        cell: "dense <1>, 1 head".into(),
        technique: technique.into(),
        format: "fast".into(),
        path: technique.into(),
        rounds: rounds.iter().map(|&ms| Round { ms, update_ms: ms / 2.0 }).collect(),
        update_and_draw_ms: times.filter(|_| technique != "cpu"),
        cpu_ms: times,
        ..like.expect("there is one").clone()
    }
}

fn report() -> Report {
    let mut wrong = run("feedback", &[0.1]);
    wrong.verified = false;
    wrong.problem = Some("off by a mile".into());
    let runs = vec![
        run("blocks", &[1.0, 10.0, 1.0]),
        run("compute", &[2.0, 20.0, 3.0]),
        run("direct", &[40.0, 500.0]),
        run("cpu", &[0.1, 0.1, 0.1]),
        wrong,
    ];
    let cell = CellRecord::of("dense <1>, 1 head", ["dense", "all"], 1, &runs);
    let suites = vec![SuiteRecord { name: "techniques".into(), cells: vec![cell], comparisons: vec![] }];
    Report { runs, suites, ..synthetic::report() }
}

#[test]
fn ratios_are_those_of_rounds() {
    let (ours, other) = (run("blocks", &[1.0, 10.0, 1.0]), run("compute", &[2.0, 20.0, 3.0]));
    assert_eq!(ratio(&ours, &other, |r| r.ms), Some(0.5), "not the third that medians give, nor what means do");
    // The rounds that both took part in.
    assert_eq!(ratio(&run("direct", &[40.0, 500.0]), &ours, |r| r.ms), Some(45.0));
    let alone = RunRecord { alone: true, ..other };
    assert_eq!(ratio(&ours, &alone, |r| r.ms), Some(1.0 / 3.0), "medians, where there are no common rounds");
}

#[test]
fn the_cpu_and_wrong_runs_do_not_compete() {
    let report = report();
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
    let found = Comparison::new("c", [&a, &b], names(), |r| r.update_ms, "3 or more").expect("both are right");
    assert_eq!((found.first_ms, found.second_ms, found.ratio, found.n), (3.5, 1.0, 3.5, [2, 2]));
    let wrong = RunRecord { verified: false, ..b };
    assert!(Comparison::new("c", [&a, &wrong], names(), |r| r.update_ms, "").is_none());
}

#[test]
fn page_and_table_name_what_is_wrong() {
    let report = report();
    let suite = &report.suites[0];
    let text = text::text(suite, &report);
    assert!(
        text.contains("WRONG") && text.contains("45.0") && text.contains("Every technique, side by side"),
        "{text}"
    );
    let figures = figures::figures(suite, &report);
    assert_eq!((figures.len(), figures[0].slug.as_str()), (1, "techniques-dense--1---1-head"));
    assert!(figures[0].caption.contains("1 gave a wrong result"));
    let svg = figures[0].svg().expect("drawn");
    let page = page::page(suite, &report, &[(figures[0].clone(), svg)]);
    assert!(page.contains("off by a mile") && page.contains("dense &lt;1&gt;") && !page.contains("<1>"));
    assert!(text::sentence(suite, &report).contains("fastest GPU path in 1 of 1 cells"));
}
