//! The page of a suite.

use super::record::SuiteRecord;
use super::text::{
    CELL_HEADINGS, COMPARISON_HEADINGS, cell_row, comparison_row, matrix, run_row, runs, sentence, title,
};
use crate::bench::html::{facts, not_run, warning};
use crate::bench::record::{Report, RunRecord};
use crate::page::{document, escape, figure, table};
use crate::plots::Figure;
use crate::table::sig3;

pub fn file_name(suite: &SuiteRecord) -> String {
    format!("suite-{}.html", suite.name)
}

/// The page. Figures come with their SVG.
pub fn page(suite: &SuiteRecord, report: &Report, figures: &[(Figure, String)]) -> String {
    let mut body = format!(
        "<header><p class=\"kicker\"><a href=\"index.html\">deltamorph bench</a> · suite {}</p><h1>{}</h1>\
         <p class=\"lead\">{}</p></header>\n",
        escape(&suite.name),
        escape(title(&suite.name)),
        escape(&sentence(suite, report))
    );
    let escaped = |cells: Vec<String>| cells.iter().map(|cell| escape(cell)).collect::<Vec<_>>();
    let mut add = |heading: &str, html: String| {
        let heading = if heading.is_empty() { String::new() } else { format!("<h2>{heading}</h2>") };
        body.push_str(&format!("<section>{heading}{html}</section>\n"));
    };
    add("", warning(report) + &facts(report));
    if !suite.comparisons.is_empty() {
        let rows = suite.comparisons.iter().map(|c| escaped(comparison_row(c)));
        add("Compared", table(&COMPARISON_HEADINGS, rows));
    }
    if !suite.cells.is_empty() {
        let rows = suite.cells.iter().map(|cell| escaped(cell_row(cell, suite, report)));
        add("Who is fastest", table(&CELL_HEADINGS, rows));
    }
    let (headings, rows) = matrix(suite, report);
    if !rows.is_empty() {
        let headings: Vec<&str> = headings.iter().map(String::as_str).collect();
        add("Milliseconds of every technique", table(&headings, rows.into_iter().map(escaped)));
    }
    let figures: String = figures.iter().map(|(drawn, svg)| figure(drawn, svg)).collect();
    body.push_str(&format!("<section class=\"figures\">{figures}</section>\n"));
    let mut add =
        |heading: &str, html: String| body.push_str(&format!("<section><h2>{heading}</h2>{html}</section>\n"));
    add("All runs", all_runs(suite, report) + &not_run(report));
    document(&format!("{} · deltamorph bench", title(&suite.name)), &body)
}

fn all_runs(suite: &SuiteRecord, report: &Report) -> String {
    let headings = [
        "result",
        "cell",
        "technique",
        "update ms",
        "draw ms",
        "mean ms",
        "±",
        "round trip ms",
        "upload ms",
        "n",
        "mode",
        "batch",
        "median ms",
        "measured",
        "error / diagonal",
    ];
    let row = |run: &RunRecord| {
        let result = match (&run.problem, run.verified) {
            (_, true) => "<span class=\"ok\">right</span>".to_owned(),
            (problem, false) => {
                format!("<span class=\"bad\">wrong</span> {}", escape(problem.as_deref().unwrap_or_default()))
            }
        };
        let mut cells = vec![result];
        cells.extend(run_row(run).iter().map(|cell| escape(cell)));
        cells.extend([
            run.mode.clone(),
            run.batch_size.to_string(),
            run.time().map_or("–".into(), |t| sig3(t.median)),
            if run.alone { "alone".into() } else { "in turns".into() },
            run.max_error_rel.map_or("–".into(), sig3),
        ]);
        cells
    };
    table(&headings, runs(suite, report).map(row))
}
