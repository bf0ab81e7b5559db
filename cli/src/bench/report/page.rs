//! Self-contained pages: index.html, and one for each suite.

use super::about::about;
use super::sentences::{of_suite, sentences, title};
use super::tables;
use crate::bench::record::{Report, RunRecord, SuiteRecord, fastest};
use crate::page::{self, document, figures, table};
use crate::plots::Drawn;
use maud::{Markup, html};

pub fn file_name(suite: Option<&SuiteRecord>) -> String {
    suite.map_or("index.html".into(), |suite| format!("suite-{}.html", suite.name))
}

/// The page of `suite`, or of the whole report.
pub fn page(report: &Report, suite: Option<&SuiteRecord>, drawn: &[Drawn]) -> String {
    let day = report.created.split('T').next().unwrap_or_default();
    let name = suite.map_or(report.input.name.as_str(), title);
    let found = suite.map_or_else(|| sentences(report), |suite| vec![of_suite(suite)]);
    let (sentence, facts) = about(report, suite);
    let body = html! {
        header {
            p.kicker {
                @if let Some(suite) = suite { a href="index.html" { "deltamorph bench" } " · suite " (suite.name) }
                @else { "deltamorph bench · " (day) }
            }
            h1 { @if suite.is_some() { (name) } @else { "Time to update “" (name) "”" } }
            (page::about(&sentence, &facts))
            ul.found { @for sentence in &found { li { (sentence.trim_end_matches('.')) "." } } }
        }
        @if report.device.kind == "cpu" {
            p.warning {
                "This ran on a software driver: the processor played the GPU. Compare the configurations with each \
                 other; the times say little about any GPU."
            }
        }
        @if suite.is_none() && !report.suites.is_empty() {
            section {
                h2 { "Suites" }
                ul { @for suite in &report.suites { li { a href=(file_name(Some(suite))) { (title(suite)) } } } }
            }
        }
        @for (heading, found) in suite.map_or(vec![], |suite| tables::of_suite(suite, report)) {
            section { h2 { (heading) } (table(heading, &found, |_| (None, None))) }
        }
        (figures(drawn))
        section {
            h2 { "All configurations" }
            @if let Some(same) = tables::of_all(report.runs_of(suite)) { p.note { (same) } }
            (all_runs(&report.runs_of(suite).collect::<Vec<_>>()))
            @if !report.skipped.is_empty() {
                h3 { "Not run" }
                ul { @for skipped in &report.skipped { li { b { (skipped.what) } ": " (skipped.reason) } } }
            }
        }
        section {
            h2 { "Measure it again" }
            pre { code { (report.command) } }
            p.note {
                "All numbers: " a href="report.json" { "report.json" } ", " a href="runs.csv" { "runs.csv" }
                ". deltamorph " (report.version) ", " (report.created) "."
            }
        }
    };
    document(&format!("{name} · deltamorph bench"), &body)
}

fn all_runs(runs: &[&RunRecord]) -> Markup {
    // The fastest of each kind of work is highlighted.
    let work = |r: &RunRecord| (r.suite.clone(), r.cell.clone(), r.workload.clone(), r.heads, r.changed.to_bits());
    let best = |run: &RunRecord| {
        let rivals = runs.iter().copied().filter(|r| r.counts() && work(r) == work(run));
        run.counts() && fastest(rivals).is_some_and(|best| run.median() <= best.median())
    };
    table("All configurations", &tables::runs(runs.iter().copied(), false), |row| {
        let run = runs[row];
        let class = if run.verified { best(run).then_some("best") } else { Some("wrong") };
        (class, run.problem.as_deref())
    })
}
