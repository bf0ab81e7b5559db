//! docs/results/kernels.md: the table for readers, with a section per vendor.

use crate::statistics::{UNITS, full_occupancy};
use crate::table::{self, Figures, Row, Table};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/results/kernels.md");

/// Reads all checked-in tables, by name.
pub fn tables() -> Vec<Table> {
    let folder = table::file("").parent().expect("a folder").to_owned();
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let names = entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned());
    let mut gpus: Vec<String> = names.filter_map(|name| Some(name.strip_suffix(".csv")?.to_owned())).collect();
    gpus.sort_unstable();
    gpus.iter().map(|gpu| Table::read(gpu)).collect()
}

pub fn write() {
    std::fs::write(FILE, text(&tables())).unwrap_or_else(|e| panic!("{FILE}: {e}"));
}

pub fn is_up_to_date() -> bool {
    std::fs::read_to_string(Path::new(FILE)).is_ok_and(|file| file == text(&tables()))
}

fn text(tables: &[Table]) -> String {
    let mut text = String::from(
        "# What compilers of GPUs make of the kernels\n\n\
         Of tests/budgets/*.csv, which `bash .ci/budgets` measures and compares; nothing ran. docs/notes/shaders.md\n\
         says how. A cell is instructions / registers / occupancy / cycles, as far as the driver tells;\n\
         **bold** is what a kernel spills, and what it keeps in memory. Code counts as it lies there: a loop once.\n",
    );
    for (vendor, units) in UNITS {
        let of_vendor: Vec<&Table> =
            tables.iter().filter(|table| table.gpu.split('-').next() == Some(vendor)).collect();
        let Some(first) = of_vendor.first() else { continue };
        writeln!(text, "\n## {vendor} (driver {})\n\n{units}", first.driver).unwrap();
        // GPUs with the same figures share a column.
        let mut columns: Vec<(&Table, Vec<&str>)> = vec![];
        for table in of_vendor {
            let same = |(column, _): &&mut (&Table, Vec<&str>)| {
                let figures = |table: &Table| table.rows.iter().map(|row| row.figures).collect::<Vec<_>>();
                full_occupancy(&column.gpu) == full_occupancy(&table.gpu) && figures(column) == figures(table)
            };
            match columns.iter_mut().find(same) {
                Some((_, names)) => names.push(&table.gpu),
                None => columns.push((table, vec![&table.gpu])),
            }
        }
        let heads = columns
            .iter()
            .map(|(table, names)| format!(" {} (full: {}) |", names.join(", "), full_occupancy(&table.gpu)));
        writeln!(text, "\n| kernel |{}\n|---{}|", heads.collect::<String>(), "|---".repeat(columns.len())).unwrap();
        for (i, row) in columns[0].0.rows.iter().enumerate() {
            let cells = columns.iter().map(|(table, _)| format!(" {} |", cell(&table.rows[i])));
            writeln!(text, "| {} |{}", row.name(), cells.collect::<String>()).unwrap();
        }
    }
    text + &reasons(tables)
}

fn cell(row: &Row) -> String {
    let Figures { instructions, registers, occupancy, spills, scratch, cycles, .. } = row.figures;
    let figures = [Some(instructions), registers, Some(occupancy), cycles].into_iter().flatten();
    let mut text = figures.map(|figure| format!("{}", (figure * 10.0).round() / 10.0)).collect::<Vec<_>>().join(" / ");
    for (figure, name) in [(spills, "spills"), (scratch, "memory")] {
        if figure > 0.0 {
            write!(text, ", **{name} {figure}**").unwrap();
        }
    }
    text
}

/// Lists the reasons for shortfalls: by reason and kernel, the GPUs.
fn reasons(tables: &[Table]) -> String {
    let mut reasons = BTreeMap::<&str, BTreeMap<String, Vec<&str>>>::new();
    for table in tables {
        for row in table.rows.iter().filter(|row| !row.why.is_empty()) {
            reasons.entry(&row.why).or_default().entry(row.name()).or_default().push(&table.gpu);
        }
    }
    let mut text = String::from("\n## Why kernels fall short\n");
    for (why, kernels) in reasons {
        writeln!(text, "\n{why}:\n").unwrap();
        for (kernel, gpus) in kernels {
            writeln!(text, "- {kernel}: {}", gpus.join(", ")).unwrap();
        }
    }
    text
}
