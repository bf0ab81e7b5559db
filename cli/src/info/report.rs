//! The report folder of `info`: index.html, the plots, and the numbers as info.json.

use super::Info;
use super::measure::{PoseRow, SweepRow};
use crate::output::{self, Failure, publish, to_json, write_file};
use crate::page::{self, document, table};
use crate::plots::{Axes, Chart, Drawn, Figure, Look, Point, Series};
use crate::table::{Column, Table, bytes, percent, sig3, thousands};
use maud::{Markup, html};
use std::path::Path;

/// Ensures that `dir` may be written: it is new, empty, or has an earlier report.
pub fn claim(dir: &Path) -> Result<(), Failure> {
    let complaint = "holds something else than a report of info; name another one with --report";
    let sweep = |text: String| serde_json::from_str::<serde_json::Value>(&text).ok()?.get("sweep").cloned();
    output::claim(dir, complaint, || std::fs::read_to_string(dir.join("info.json")).ok().and_then(sweep).is_some())
}

/// Writes everything into `dir`; replaces the files of an earlier run once all is drawn.
pub fn write(info: &Info, dir: &Path) -> Result<(), Failure> {
    let write = |dir: &Path| {
        write_file(&dir.join("info.json"), to_json(info)?)?;
        let drawn = figures(info).into_iter().map(|figure| figure.write(dir));
        write_file(&dir.join("index.html"), page(info, &drawn.collect::<Result<Vec<_>, _>>()?))
    };
    publish(dir, |_| false, write)
}

fn page(info: &Info, drawn: &[Drawn]) -> String {
    let dense = info.formats.first().map_or(0, |f| f.cost.dense_f32_bytes);
    let body = html! {
        header {
            p.kicker { "deltamorph info · " (info.input.name) }
            h1 { "Error against bytes" }
            p.about {
                "How much memory do the expressions of a face take, and what is lost where they take less? The mesh “"
                (info.input.name) "” has " (thousands(info.input.vertices)) " points (vertices) and "
                (info.input.targets) " morph targets; a target says how far each point moves in one expression. As six \
                 floats for every vertex and target that is " (bytes(dense as f64)) ". Each storage format was \
                 packed and unpacked, no device taking part; its error is the largest distance of a position, and \
                 the largest angle of a normal, from those of the input: for each target alone at its full weight, and \
                 for whole poses from frames of clips."
            }
        }
        (page::figures(drawn))
        section { h2 { "Whole poses" } (pose_table(info.poses.as_deref().unwrap_or_default())) }
        section { h2 { "Every point" } (sweep_table(info.sweep.as_deref().unwrap_or_default())) }
        p.note { "All numbers: " a href="info.json" { "info.json" } "." }
    };
    document(&format!("{} · deltamorph info", info.input.name), &body)
}

type Error = fn(&SweepRow) -> f64;

fn figures(info: &Info) -> [Figure; 2] {
    let chart = |slug: &str, title: &str, y_label: &'static str, error: Error| Figure {
        slug: slug.into(),
        caption: "Lines: the format small, for errors allowed from 1e-3 to 1e-6 of the diagonal, that of normals in \
                  proportion. Points: every format as it is by default. A format without any error stands at the foot."
            .into(),
        title: title.into(),
        subtitle: [
            format!("{}: {} vertices × {} targets", info.input.name, info.input.vertices, info.input.targets),
            "largest error measured, of a single target at weight 1".into(),
        ],
        chart: Chart::Lines {
            labels: ["bytes, as a share of float32 for every vertex and target", y_label],
            axes: Axes::Values,
            series: series(info.sweep.as_deref().unwrap_or_default(), error),
        },
    };
    [
        chart("position-error", "Position error against bytes", "of the diagonal", |r| r.cost.position_error_rel),
        chart("normal-error", "Normal error against bytes", "degrees", |r| r.cost.normal_error_deg),
    ]
}

/// A line for each block size of the sweep, and a point for each format.
fn series(rows: &[SweepRow], error: Error) -> Vec<Series> {
    let label = |row: &SweepRow| match (row.position_allowed_rel, row.block_size) {
        (Some(_), Some(size)) => format!("small, blocks of {size}"),
        _ => format!("{} (default)", row.format),
    };
    let mut all: Vec<Series> = vec![];
    for row in rows {
        let (label, point) = (label(row), Point::new(row.share, error(row), 0.0));
        match all.iter_mut().find(|s| s.label == label) {
            Some(series) => series.points.push(point),
            None => all.push(Series { label, look: Look::new(all.len(), all.len()), points: vec![point] }),
        }
    }
    all
}

fn pose_table(rows: &[PoseRow]) -> Markup {
    let columns: [Column<'_, PoseRow>; 6] = [
        ("clip", &|r| r.clip.clone()),
        ("frames", &|r| r.frames.to_string()),
        ("format", &|r| r.format.into()),
        ("position error / diagonal", &|r| sig3(r.position_error_rel)),
        ("normals", &|r| degrees(r.normal_error_deg)),
        ("999 of 1000 normals", &|r| degrees(r.normal_error_p999_deg)),
    ];
    html! {
        @if rows.is_empty() {
            p.note { "There is no clip to take poses from." }
        } @else {
            (table("Whole poses", &Table::of(rows, &columns), |_| (None, None)))
            p.note {
                "Largest errors against the raw files: dropped deltas and packing together, the weights as captured. \
                 Where targets fold a normal to almost nothing, a small error turns it far: the last column leaves out \
                 one normal of a thousand."
            }
        }
    }
}

fn sweep_table(rows: &[SweepRow]) -> Markup {
    let optional = |value: Option<String>| value.unwrap_or_else(|| "–".into());
    let columns: &[Column<'_, SweepRow>] = &[
        ("format", &|r| r.format.into()),
        ("block size", &|r| optional(r.block_size.map(|n| n.to_string()))),
        ("positions allowed", &|r| optional(r.position_allowed_rel.map(|v| format!("{v:.1e}")))),
        ("normals allowed", &|r| optional(r.normal_allowed_deg.map(|v| degrees(v.into())))),
        ("bytes", &|r| bytes(r.bytes as f64)),
        ("of float32", &|r| percent(r.share)),
        ("position error / diagonal", &|r| sig3(r.cost.position_error_rel)),
        ("normals", &|r| degrees(r.cost.normal_error_deg)),
    ];
    table("Every point", &Table::of(rows, columns), |_| (None, None))
}

fn degrees(angle: f64) -> String {
    format!("{}°", sig3(angle))
}
