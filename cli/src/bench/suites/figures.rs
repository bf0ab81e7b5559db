//! The figures of a suite.

use super::crowd::case;
use super::record::{SuiteRecord, label};
use super::text::{of_cell, ranking, runs};
use crate::bench::family::{Family, families, look};
use crate::bench::record::{Report, RunRecord};
use crate::bench::select::{absolute, batch_words, batch_x, median, relative, series, slug, with_names_of_their_own};
use crate::bench::stats::Stats;
use crate::plots::bars::{Bar, BarChart, Unit};
use crate::plots::chart::{Axes, LineChart, Point, Series, X};
use crate::plots::{Chart, Figure};
use crate::table::{sig3, thousands};
use deltamorph::BatchSize;

/// All figures that the runs of `suite` are enough for.
pub fn figures(suite: &SuiteRecord, report: &Report) -> Vec<Figure> {
    with_names_of_their_own(match suite.name.as_str() {
        "chapter" => chapter(suite, report),
        "crowd" => crowd(suite, report),
        _ => suite.cells.iter().filter_map(|cell| bars(suite, report, &cell.name)).collect(),
    })
}

/// What is constant: the mesh and the device.
fn mesh_line(runs: &[&RunRecord], report: &Report) -> String {
    let mesh = runs.first().and_then(|run| report.meshes.iter().find(|mesh| mesh.name == run.mesh));
    let mesh = mesh.map_or(String::new(), |m| format!("{}, {} vertices · ", m.name, thousands(m.vertices)));
    format!("{mesh}{}", report.device.name)
}

fn chapter(suite: &SuiteRecord, report: &Report) -> Vec<Figure> {
    let all: Vec<&RunRecord> = runs(suite, report).filter(|run| run.counts()).collect();
    let mut counts: Vec<f64> = all.iter().map(|run| run.changed).collect();
    counts.sort_by(f64::total_cmp);
    counts.dedup();
    let mut figures = vec![];
    for changed in counts {
        let runs: Vec<&RunRecord> = all.iter().copied().filter(|run| run.changed == changed).collect();
        let subtitle =
            [format!("{changed} of {} targets changed per frame", runs[0].targets), mesh_line(&runs, report)];
        let mut add = |name: &str, caption: &str, title: &str, y_label: &str, series: Vec<Series>, reference| {
            let labels = ["targets per pass", y_label];
            let chart = LineChart::new(title, subtitle.clone(), labels, Axes::CountsFromZero, series);
            let chart = LineChart { reference, ..chart };
            let slug = format!("chapter-{name}-{changed}-changed");
            figures.push(Figure { slug, caption: caption.into(), chart: Chart::Lines(chart) });
        };
        add(
            "relative",
            "Time at batch 1 divided by time at batch b, each path against itself: the chapter's figure.",
            "Relative performance against batch size",
            "times as fast as batch 1",
            series(&runs, batch_x, relative),
            Some(1.0),
        );
        add(
            "time",
            "Median time of the update; bars are ±1 standard error.",
            "Time per frame against batch size",
            "ms per frame",
            series(&runs, batch_x, absolute),
            None,
        );
    }
    figures
}

fn crowd(suite: &SuiteRecord, report: &Report) -> Vec<Figure> {
    let all: Vec<&RunRecord> =
        runs(suite, report).filter(|run| run.counts() && run.cell.ends_with(" targets")).collect();
    let mut cases: Vec<(u32, bool)> = vec![];
    for run in &all {
        if !cases.contains(&(run.heads, run.shared)) {
            cases.push((run.heads, run.shared));
        }
    }
    let mut figures = vec![];
    for (heads, shared) in cases {
        let runs: Vec<&RunRecord> =
            all.iter().copied().filter(|run| (run.heads, run.shared) == (heads, shared)).collect();
        let name = case(heads, shared);
        let mut add = |what: &str, title: &str, caption: &str, of: fn(&RunRecord) -> Option<Stats>| {
            let series = against_targets(&runs, of);
            if series.is_empty() {
                return;
            }
            let subtitle = ["all targets kept change in every frame".into(), mesh_line(&runs, report)];
            let labels = ["targets kept", "ms per frame"];
            let chart = LineChart::new(&format!("{title}: {name}"), subtitle, labels, Axes::Counts, series);
            let slug = format!("crowd-{what}-{}", slug(&name));
            figures.push(Figure { slug, caption: caption.into(), chart: Chart::Lines(chart) });
        };
        add(
            "gpu",
            "Device time",
            "Mean time of the update and of a draw for each head on the device; bars are ±1 standard error.",
            |run| run.update_and_draw_ms,
        );
        add(
            "round-trip",
            "Round trip",
            "Mean time from weights to fence, update and draws included; bars are ±1 standard error. Of the \
             path cpu the update alone: upload and draw are in the table below.",
            |run| run.cpu_ms,
        );
    }
    figures
}

/// A line for each technique.
fn against_targets(runs: &[&RunRecord], of: fn(&RunRecord) -> Option<Stats>) -> Vec<Series> {
    let all = families(runs);
    let mut lines: Vec<(String, Series)> = vec![];
    for run in runs {
        let Some(time) = of(run) else { continue };
        let point = Point { x: X::Value(run.targets as f64), y: time.mean, error: time.stderr };
        match lines.iter_mut().find(|(technique, _)| *technique == run.technique) {
            Some((_, line)) => line.points.push(point),
            None => {
                let (color, marker) = look(&Family::of(run), &all);
                lines.push((run.technique.clone(), Series { label: label(run), color, marker, points: vec![point] }));
            }
        }
    }
    lines.into_iter().map(|(_, line)| line).collect()
}

/// A bar for each technique of a cell, the fastest on top.
fn bars(suite: &SuiteRecord, report: &Report, cell: &str) -> Option<Figure> {
    let everything: Vec<&RunRecord> = runs(suite, report).collect();
    let all = families(&everything);
    let ranked = ranking(suite, report, cell);
    let bar = |run: &&RunRecord| {
        let batch = match (run.batch_size, run.batch_max) {
            // A path without batches has none to speak of.
            (BatchSize::All, None) => String::new(),
            (batch, _) => format!(" · {}", batch_words(batch)),
        };
        let n = run.time().map_or(0, |t| t.n);
        Bar {
            label: label(run),
            remark: format!("{} ms{batch} · n = {n}", sig3(median(run))),
            length: median(run),
            color: look(&Family::of(run), &all).0,
        }
    };
    let bars: Vec<Bar> = ranked.iter().map(bar).collect();
    let wrong = of_cell(suite, report, cell).filter(|run| !run.verified).count();
    let wrong = if wrong == 0 { String::new() } else { format!(" {wrong} gave a wrong result and are not drawn.") };
    (!bars.is_empty()).then(|| Figure {
        slug: format!("{}-{}", suite.name, slug(cell)),
        caption: format!(
            "Median time of the update and of one draw for each head, measured in turns; of the path cpu the update \
             alone: upload and draw are in the table below.{wrong}"
        ),
        chart: Chart::Bars(BarChart {
            title: cell.to_owned(),
            subtitle: ["ms per frame: the update, and one draw for each head".into(), mesh_line(&ranked, report)],
            unit: Unit::Milliseconds,
            bars,
        }),
    })
}
