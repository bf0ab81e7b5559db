//! The table of runs for the terminal; the page of a report has its own.

use super::record::RunRecord;
use crate::table::{Table, bytes, count, optional, percent, sig3};

/// The text of an empty table cell.
const NONE: &str = "–";

/// Heading and cell of a column.
type Column = (&'static str, fn(&RunRecord) -> String);

/// A row for each of the runs that were measured in turns. Columns that are empty in every run are left out.
pub fn runs(runs: &[RunRecord]) -> Table {
    let columns: [Column; 13] = [
        ("technique", |run| run.technique.clone()),
        ("format", |run| run.format.clone()),
        ("batch", |run| run.batch_size.to_string()),
        ("ms/frame", |run| if run.verified { optional(run.time().map(|t| t.median)) } else { "WRONG".into() }),
        ("rounds", |run| match run.rounds_ratio {
            Some(ratio) => format!("{ratio:.2}×{}", if run.uneven() { " UNEVEN" } else { "" }),
            None => NONE.into(),
        }),
        ("of floor", |run| run.floor_fraction.map_or(NONE.into(), percent)),
        ("changed", |run| count(run.changed)),
        ("passes", |run| count(run.passes)),
        // Where nothing is drawn, the update is what ms/frame says.
        ("update ms", |run| optional(run.gpu_ms.filter(|_| run.update_and_draw_ms.is_some()).map(|t| t.median))),
        ("draw ms", |run| optional(run.draw_ms.filter(|_| run.draws > 0))),
        // What a device plans is not counted.
        ("moved", |run| if run.bytes_moved > 0.0 { bytes(run.bytes_moved) } else { NONE.into() }),
        ("error / diagonal", |run| run.max_error_rel.map_or(NONE.into(), sig3)),
        ("measured", |run| if run.alone { "alone".into() } else { NONE.into() }),
    ];
    let told = columns.iter().filter(|(_, cell)| runs.iter().any(|run| cell(run) != NONE));
    let told: Vec<_> = told.collect();
    let mut table = Table::new(&told.iter().map(|(heading, _)| *heading).collect::<Vec<_>>(), 2);
    runs.iter().for_each(|run| table.row(told.iter().map(|(_, cell)| cell(run))));
    table
}
