//! The page of a suite.

use super::record::SuiteRecord;
use super::text::{
    CELL_HEADINGS, COMPARISON_HEADINGS, cell_row, comparison_row, matrix, run_row, runs, sentence, title,
};
use crate::bench::html::{facts, not_run, warning};
use crate::bench::record::{Report, RunRecord};
use crate::page::{document, figures, row, table, verdict};
use crate::plots::Figure;
use crate::table::optional;
use maud::{Markup, html};

pub fn file_name(suite: &SuiteRecord) -> String {
    format!("suite-{}.html", suite.name)
}

/// The page. Figures come with their SVG.
pub fn page(suite: &SuiteRecord, report: &Report, drawn: &[(Figure, String)]) -> String {
    let (headings, times) = matrix(suite, report);
    let body = html! {
        header {
            p.kicker { a href="index.html" { "deltamorph bench" } " · suite " (suite.name) }
            h1 { (title(&suite.name)) }
            p.lead { (sentence(suite, report)) }
        }
        section { (warning(report)) (facts(report)) }
        @if !suite.comparisons.is_empty() {
            section {
                h2 { "Compared" }
                (table(COMPARISON_HEADINGS, suite.comparisons.iter().map(|c| row(comparison_row(c)))))
            }
        }
        @if !suite.cells.is_empty() {
            section {
                h2 { "Who is fastest" }
                (table(CELL_HEADINGS, suite.cells.iter().map(|cell| row(cell_row(cell, suite, report)))))
            }
        }
        @if !times.is_empty() {
            section {
                h2 { "Milliseconds of every technique" }
                (table(headings.iter().map(String::as_str), times.into_iter().map(row)))
            }
        }
        (figures(drawn))
        section { h2 { "All runs" } (all_runs(suite, report)) (not_run(report)) }
    };
    document(&format!("{} · deltamorph bench", title(&suite.name)), &body)
}

fn all_runs(suite: &SuiteRecord, report: &Report) -> Markup {
    let headings = "result|cell|technique|update ms|draw ms|mean ms|±|round trip ms|upload ms|n|mode|batch|\
        median ms|measured|error / diagonal";
    let row = |run: &RunRecord| {
        let more = [
            run.mode.clone(),
            run.batch_size.to_string(),
            optional(run.time().map(|t| t.median)),
            if run.alone { "alone".into() } else { "in turns".into() },
            optional(run.max_error_rel),
        ];
        html! {
            tr {
                td { (verdict(run.verified)) @if let Some(problem) = &run.problem { " " (problem) } }
                @for cell in run_row(run).into_iter().chain(more) { td { (cell) } }
            }
        }
    };
    table(headings.split('|'), runs(suite, report).map(row))
}
