//! The table of runs for the terminal; the page of a report has its own.

use super::record::RunRecord;
use crate::table::{Column, NONE, Table, bytes, count, optional, percent, sig3};

/// A row for each of the runs that were measured in turns.
pub fn runs(runs: &[RunRecord]) -> Table {
    let columns: &[Column<'_, RunRecord>] = &[
        ("technique", &|run| run.technique.clone()),
        ("format", &|run| run.format.into()),
        ("batch", &|run| run.batch_size.to_string()),
        ("ms/frame", &|run| if run.verified { optional(run.time().map(|t| t.median)) } else { "WRONG".into() }),
        ("rounds", &|run| match run.rounds_ratio {
            Some(ratio) => format!("{ratio:.2}×{}", if run.uneven() { " UNEVEN" } else { "" }),
            None => NONE.into(),
        }),
        ("of bandwidth limit", &|run| run.floor_fraction.map_or(NONE.into(), percent)),
        ("changed", &|run| count(run.changed)),
        ("passes", &|run| count(run.passes)),
        // Where nothing is drawn, the update is what ms/frame says.
        ("update ms", &|run| optional(run.gpu_ms.filter(|_| run.update_and_draw_ms.is_some()).map(|t| t.median))),
        ("draw ms", &|run| optional(run.draw_ms.filter(|_| run.draws > 0))),
        // What a device plans is not counted.
        ("moved", &|run| if run.bytes_moved > 0.0 { bytes(run.bytes_moved) } else { NONE.into() }),
        ("error / diagonal", &|run| run.max_error_rel.map_or(NONE.into(), sig3)),
        ("measured", &|run| if run.alone { "alone".into() } else { NONE.into() }),
    ];
    Table::of(runs, 2, columns)
}
