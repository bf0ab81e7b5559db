//! Suites for people: tables on stdout, and a sentence each.

use super::record::{CellRecord, Comparison, SuiteRecord, label};
use crate::bench::record::{Report, RunRecord};
use crate::bench::select::median;
use crate::table::{Table, optional, sig3};

pub fn title(name: &str) -> &str {
    match name {
        "chapter" => "What batching gains",
        "crowd" => "One head and many",
        "techniques" => "Every technique, side by side",
        "clips" => "Every technique on captured clips",
        other => other,
    }
}

pub fn runs<'a>(suite: &'a SuiteRecord, report: &'a Report) -> impl Iterator<Item = &'a RunRecord> + Clone {
    report.runs.iter().filter(|run| run.suite == suite.name)
}

pub fn of_cell<'a>(suite: &'a SuiteRecord, report: &'a Report, cell: &'a str) -> impl Iterator<Item = &'a RunRecord> {
    runs(suite, report).filter(move |run| run.cell == cell)
}

pub const CELL_HEADINGS: [&str; 10] = [
    "cell",
    "fastest",
    "its ms",
    "blocks",
    "its ms",
    "best other",
    "its ms",
    "blocks / best other",
    "by means",
    "direct / blocks",
];

pub fn cell_row(cell: &CellRecord, suite: &SuiteRecord, report: &Report) -> Vec<String> {
    let time = |name: &Option<String>| {
        let run = of_cell(suite, report, &cell.name).find(|run| Some(label(run)) == *name);
        run.and_then(RunRecord::time).map_or("–".into(), |t| format!("{} (n = {})", sig3(t.median), t.n))
    };
    let name = |name: &Option<String>| name.clone().unwrap_or("–".into());
    vec![
        cell.name.clone(),
        name(&cell.fastest),
        time(&cell.fastest),
        name(&cell.blocks),
        time(&cell.blocks),
        name(&cell.best_other),
        time(&cell.best_other),
        optional(cell.blocks_to_best_other),
        optional(cell.blocks_to_best_other_mean),
        optional(cell.direct_to_blocks),
    ]
}

pub const COMPARISON_HEADINGS: [&str; 8] =
    ["comparison", "first", "its ms", "second", "its ms", "first / second, median of rounds", "should be", "n"];

pub fn comparison_row(c: &Comparison) -> Vec<String> {
    let [a, b] = c.n;
    vec![
        c.name.clone(),
        c.first.clone(),
        sig3(c.first_ms),
        c.second.clone(),
        sig3(c.second_ms),
        sig3(c.ratio),
        c.goal.clone(),
        format!("{a}, {b}"),
    ]
}

/// Milliseconds of every technique: headings, and a row for each of the cells that techniques compete in. In the crowd
/// suite means, as in the figures that it follows; else medians.
pub fn matrix(suite: &SuiteRecord, report: &Report) -> (Vec<String>, Vec<Vec<String>>) {
    let competes = |run: &&RunRecord| match suite.cells.is_empty() {
        true => run.cell.ends_with(" targets"),
        false => suite.cells.iter().any(|cell| cell.name == run.cell),
    };
    let (mut techniques, mut cells): (Vec<&str>, Vec<&str>) = (vec![], vec![]);
    for run in runs(suite, report).filter(competes) {
        if !techniques.contains(&run.technique.as_str()) {
            techniques.push(&run.technique);
        }
        if !cells.contains(&run.cell.as_str()) {
            cells.push(&run.cell);
        }
    }
    let time = |cell: &str, technique: &str| {
        let run = of_cell(suite, report, cell).find(|run| run.technique == technique);
        match run.map(|run| (run, run.time())) {
            Some((run, _)) if !run.verified => "WRONG".into(),
            Some((_, Some(time))) => sig3(if suite.cells.is_empty() { time.mean } else { time.median }),
            _ => "–".to_owned(),
        }
    };
    let row = |cell: &&str| {
        let times = techniques.iter().map(|technique| time(cell, technique));
        std::iter::once((*cell).to_owned()).chain(times).collect()
    };
    let headings = std::iter::once("ms").chain(techniques.iter().copied()).map(str::to_owned).collect();
    (headings, cells.iter().map(row).collect())
}

pub fn text(suite: &SuiteRecord, report: &Report) -> String {
    let table = |headings: &[&str], left: usize, rows: Vec<Vec<String>>| {
        let mut table = Table::new(headings, left);
        let any = !rows.is_empty();
        rows.into_iter().for_each(|row| table.row(row));
        any.then(|| table.to_string())
    };
    let (headings, times) = matrix(suite, report);
    let headings: Vec<&str> = headings.iter().map(String::as_str).collect();
    let cells = suite.cells.iter().map(|cell| cell_row(cell, suite, report)).collect();
    let comparisons = suite.comparisons.iter().map(comparison_row).collect();
    let heading = format!("{} (suite {})", title(&suite.name), suite.name);
    let parts = [
        Some(heading),
        table(&headings, 1, times),
        table(&CELL_HEADINGS, 2, cells),
        table(&COMPARISON_HEADINGS, 2, comparisons),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join("\n\n") + "\n"
}

/// A run as a row: what it competes in, what it is, and its times.
pub fn run_row(run: &RunRecord) -> Vec<String> {
    let time = run.time();
    vec![
        run.cell.clone(),
        label(run),
        if run.verified { optional(run.gpu_ms.map(|t| t.mean)) } else { "WRONG".into() },
        optional(run.draw_ms),
        optional(time.map(|t| t.mean)),
        optional(time.map(|t| t.stderr)),
        optional(run.cpu_ms.map(|t| t.mean)),
        optional(run.upload_ms.map(|t| t.mean)),
        time.map_or("–".into(), |t| t.n.to_string()),
    ]
}

/// The most telling numbers of a suite.
pub fn sentence(suite: &SuiteRecord, report: &Report) -> String {
    let best = |ratios: &[f64]| ratios.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    match suite.name.as_str() {
        "chapter" => match suite.comparisons.iter().max_by(|a, b| a.ratio.total_cmp(&b.ratio)) {
            Some(c) => format!("Chapter: {} is {} times as fast as batch 1 ({}).", c.second, sig3(c.ratio), c.name),
            None => "Chapter: no path with batches could run.".into(),
        },
        "crowd" => {
            let gains: Vec<String> = suite
                .comparisons
                .iter()
                .filter(|c| c.second.contains("crowd"))
                .map(|c| format!("{} times as fast as {} ({})", sig3(c.ratio), c.first, c.name))
                .collect();
            match gains.is_empty() {
                true => format!("Crowd: {} runs.", runs(suite, report).count()),
                false => format!("Crowd: one crowd is {}.", gains.join(", ")),
            }
        }
        name => {
            let ratios: Vec<f64> = suite.cells.iter().filter_map(|c| c.blocks_to_best_other).collect();
            let wins = ratios.iter().filter(|r| **r <= 1.0).count();
            match ratios.is_empty() {
                true => format!("{}: nothing to compare.", title(name)),
                false => format!(
                    "{}: blocks is the fastest GPU path in {wins} of {} cells; in the worst it takes {} \
                     times what the best other takes.",
                    title(name),
                    ratios.len(),
                    sig3(best(&ratios))
                ),
            }
        }
    }
}

/// Milliseconds of each technique in a cell, fastest first, right ones only.
pub fn ranking<'a>(suite: &'a SuiteRecord, report: &'a Report, cell: &'a str) -> Vec<&'a RunRecord> {
    let mut ranked: Vec<&RunRecord> = of_cell(suite, report, cell).filter(|run| run.counts()).collect();
    ranked.sort_by(|a, b| median(a).total_cmp(&median(b)));
    ranked
}
