//! The tables of a report for the terminal; its page has its own.

use super::record::{CellRecord, Comparison, Report, RunRecord, SuiteRecord};
use crate::table::{Table, bytes, count, optional, percent, sig3};
use std::iter::once;

/// The text of an empty table cell.
const NONE: &str = "–";

/// Heading and cell of a column about runs.
type Column = (&'static str, fn(&RunRecord) -> String);

/// Columns of words, then columns of numbers.
const WORDS: [Column; 6] = [
    ("cell", |run| run.cell.clone()),
    ("technique", |run| run.technique.clone()),
    ("path", |run| run.path.clone()),
    ("format", RunRecord::formats),
    ("mode", |run| run.mode.clone()),
    ("workload", |run| run.workload.clone()),
];
const NUMBERS: [Column; 14] = [
    ("ms/frame", |run| if run.verified { optional(run.time().map(|t| t.median)) } else { "WRONG".into() }),
    ("rounds", |run| match run.rounds_ratio {
        Some(ratio) if run.uneven() => format!("{ratio:.2}× UNEVEN"),
        Some(ratio) => format!("{ratio:.2}×"),
        None => NONE.into(),
    }),
    ("of floor", |run| run.floor_fraction.map_or(NONE.into(), percent)),
    ("heads", |run| run.heads.to_string()),
    ("draws", |run| if run.draws > 0 { run.draws.to_string() } else { NONE.into() }),
    ("changed", |run| count(run.changed)),
    ("batch", |run| run.batch_size.to_string()),
    ("passes", |run| count(run.passes)),
    ("±", |run| optional(run.time().map(|t| t.stderr))),
    // Where nothing is drawn, the update is what ms/frame says.
    ("update ms", |run| optional(run.gpu_ms.filter(|_| run.update_and_draw_ms.is_some()).map(|t| t.median))),
    ("draw ms", |run| optional(run.draw_ms)),
    ("measured", |run| match (run.suite.is_empty(), run.alone) {
        (true, _) => String::new(),
        (false, true) => "alone".into(),
        (false, false) => "interleaved".into(),
    }),
    ("moved", |run| bytes(run.bytes_moved)),
    ("error / diagonal", |run| optional(run.max_error_rel)),
];
/// The parts of a frame that is drawn; left out if none is.
const PARTS: [&str; 2] = ["update ms", "draw ms"];

/// Columns that are there even if all runs have the same in them.
const KEYS: [&str; 5] = ["path", "format", "ms/frame", "rounds", "of floor"];

/// What all of several runs have, a column with its cell; it is no column of [`runs`].
fn common<'a>(runs: &'a [&RunRecord]) -> impl Iterator<Item = (&'static str, String)> + 'a {
    let same = |(heading, cell): &Column| {
        let first = runs.first().map(|run| cell(run)).filter(|_| runs.len() > 1 && !KEYS.contains(heading))?;
        runs.iter().all(|run| cell(run) == first).then_some((*heading, first))
    };
    WORDS.iter().chain(&NUMBERS).filter_map(same)
}

/// What all of these runs have, in words: "In all of them: mode incremental, heads 1."
pub fn of_all<'a>(runs: impl IntoIterator<Item = &'a RunRecord>) -> Option<String> {
    let runs: Vec<&RunRecord> = runs.into_iter().collect();
    let told = common(&runs).filter(|(_, cell)| ![String::new(), NONE.into()].contains(cell));
    let told = told.map(|(heading, cell)| format!("{heading} {cell}")).collect::<Vec<_>>().join(", ");
    (!told.is_empty()).then(|| format!("In all of them: {told}."))
}

/// A row for each run. Columns that are empty or the same in every run are left out.
pub fn runs<'a>(runs: impl IntoIterator<Item = &'a RunRecord>) -> Table {
    let runs: Vec<&RunRecord> = runs.into_iter().collect();
    let same: Vec<&str> = common(&runs).map(|(heading, _)| heading).collect();
    let drawn = runs.iter().any(|run| run.draws > 0);
    let told = |(heading, cell): &&Column| {
        let empty = |run: &&RunRecord| [String::new(), NONE.into()].contains(&cell(run));
        !(runs.iter().all(empty) || same.contains(heading) || !drawn && PARTS.contains(heading))
    };
    let words: Vec<&Column> = WORDS.iter().filter(told).collect();
    let columns: Vec<&Column> = words.iter().copied().chain(NUMBERS.iter().filter(told)).collect();
    let headings: Vec<&str> = columns.iter().map(|(heading, _)| *heading).collect();
    let mut table = Table::new(&headings, words.len());
    runs.iter().for_each(|run| table.row(columns.iter().map(|(_, cell)| cell(run))));
    table
}

/// The tables of a suite, with headings; empty ones are left out.
pub fn of_suite(suite: &SuiteRecord, report: &Report) -> Vec<(&'static str, Table)> {
    let mut tables = vec![];
    if !suite.comparisons.is_empty() {
        tables.push(("Compared", comparisons(&suite.comparisons)));
    }
    if !suite.cells.is_empty() {
        tables.push(("Who is fastest on the device", cells(suite, report)));
    }
    let time = |run: &RunRecord| run.time().map(|time| sig3(time.median));
    tables.extend(matrix(suite, report, "ms", time).map(|times| ("Milliseconds of every technique", times)));
    let moved = matrix(suite, report, "bytes", |run| {
        // What a device plans is not counted.
        (run.bytes_moved > 0.0 || run.changed == 0.0).then(|| bytes(run.bytes_moved))
    });
    tables.extend(moved.map(|moved| ("Bytes that an update of every technique moves", moved)));
    tables
}

fn comparisons(comparisons: &[Comparison]) -> Table {
    let headings = "comparison|second is … times as fast|should be|first|its ms|second|its ms|n";
    let mut table = Table::new(&headings.split('|').collect::<Vec<_>>(), 1);
    for Comparison { name, first, second, first_ms, second_ms, ratio, n: [a, b], goal } in comparisons {
        let [first_ms, second_ms, ratio] = [first_ms, second_ms, ratio].map(|value| sig3(*value));
        let [name, first, second, goal] = [name, first, second, goal].map(String::clone);
        table.row([name, ratio, goal, first, first_ms, second, second_ms, format!("{a}, {b}")]);
    }
    table
}

fn cells(suite: &SuiteRecord, report: &Report) -> Table {
    // How many times as fast `blocks` is.
    let headings = "cell|fastest|its ms|blocks is … times as fast as the best other|by means|as direct|blocks|its ms|\
                    best other|its ms";
    let mut table = Table::new(&headings.split('|').collect::<Vec<_>>(), 2);
    for cell in &suite.cells {
        let of_cell = || report.runs_of(Some(suite)).filter(|run| run.cell == cell.name);
        let time = |name: &Option<String>| {
            let time = of_cell().find(|run| Some(run.label()) == *name).and_then(RunRecord::time);
            time.map_or(NONE.into(), |t| format!("{} (n = {})", sig3(t.median), t.n))
        };
        let CellRecord { blocks_to_best_other, blocks_to_best_other_mean, direct_to_blocks, .. } = cell;
        let who = [&cell.fastest, &cell.blocks, &cell.best_other];
        let mut who = who.into_iter().flat_map(|name| [name.clone().unwrap_or(NONE.into()), time(name)]);
        let fastest: Vec<String> = once(cell.name.clone()).chain(who.by_ref().take(2)).collect();
        let [other, by_means] = [blocks_to_best_other, blocks_to_best_other_mean].map(|ratio| ratio.map(|r| 1.0 / r));
        let speeds = [other, by_means, *direct_to_blocks].map(optional);
        table.row(fastest.into_iter().chain(speeds).chain(who));
    }
    table
}

/// What `of` says of every technique, a row for each cell.
fn matrix(
    suite: &SuiteRecord,
    report: &Report,
    what: &str,
    of: impl Fn(&RunRecord) -> Option<String>,
) -> Option<Table> {
    let competes = |run: &&RunRecord| match suite.cells.is_empty() {
        true => run.cell.ends_with(" targets"),
        false => suite.cells.iter().any(|cell| cell.name == run.cell),
    };
    let runs: Vec<&RunRecord> = report.runs_of(Some(suite)).filter(competes).collect();
    let techniques = partition(&runs, |run| run.technique.clone());
    let headings: Vec<&str> = once(what).chain(techniques.iter().map(|(name, _)| name.as_str())).collect();
    let mut table = Table::new(&headings, 1);
    for (cell, runs) in partition(&runs, |run| run.cell.clone()) {
        let value = |name: &str| match runs.iter().find(|run| run.technique == name) {
            Some(run) if !run.verified => "WRONG".into(),
            run => run.and_then(|run| of(run)).unwrap_or(NONE.into()),
        };
        table.row(once(cell).chain(headings[1..].iter().map(|name| value(name))));
    }
    (!runs.is_empty()).then_some(table)
}

/// Groups runs by `key`, in the order of the first of each.
fn partition<'a, K: PartialEq>(runs: &[&'a RunRecord], key: impl Fn(&RunRecord) -> K) -> Vec<(K, Vec<&'a RunRecord>)> {
    let mut groups: Vec<(K, Vec<&RunRecord>)> = vec![];
    for &run in runs {
        let key = key(run);
        match groups.iter_mut().find(|(other, _)| *other == key) {
            Some((_, group)) => group.push(run),
            None => groups.push((key, vec![run])),
        }
    }
    groups
}
