//! From runs to figures: what is compared with what.

use super::family::{Family, families, look};
use super::record::{Report, RunRecord};
use crate::plots::bars::{Bar, BarChart, Unit, remark};
use crate::plots::chart::{Axes, LineChart, Point, Series, X};
use crate::plots::{Chart, Figure};
use crate::table::{count, thousands};
use deltamorph::BatchSize;
use std::collections::HashSet;

/// Runs of one workload and number of heads.
struct Group<'a> {
    workload: &'a str,
    heads: u32,
    runs: Vec<&'a RunRecord>,
}

/// Runs that were right and timed, by workload and heads, in the order they ran.
fn groups(report: &Report) -> Vec<Group<'_>> {
    let mut groups: Vec<Group<'_>> = Vec::new();
    for run in report.runs.iter().filter(|r| r.counts()) {
        match groups.iter_mut().find(|g| g.workload == run.workload && g.heads == run.heads) {
            Some(group) => group.runs.push(run),
            None => groups.push(Group { workload: &run.workload, heads: run.heads, runs: vec![run] }),
        }
    }
    groups
}

/// The time that a run is judged by, in ms.
pub fn median(run: &RunRecord) -> f64 {
    run.time().map_or(f64::INFINITY, |t| t.median)
}

fn error(run: &RunRecord) -> f64 {
    run.time().map_or(0.0, |t| t.stderr)
}

pub fn fastest<'a>(runs: impl IntoIterator<Item = &'a RunRecord>) -> Option<&'a RunRecord> {
    runs.into_iter().min_by(|a, b| median(a).total_cmp(&median(b)))
}

/// "batch 7", or "one pass".
pub fn batch_words(batch: BatchSize) -> String {
    match batch {
        BatchSize::Targets(n) => format!("batch {n}"),
        BatchSize::All => "one pass".into(),
    }
}

/// A line for each family: `x` and `y` make the points, `y` the value and its error.
pub fn series(
    runs: &[&RunRecord],
    x: impl Fn(&RunRecord) -> X,
    y: impl Fn(&RunRecord, &[&RunRecord]) -> Option<(f64, f64)>,
) -> Vec<Series> {
    let all = families(runs);
    let line = |family: &Family| {
        let own: Vec<&RunRecord> = runs.iter().filter(|r| Family::of(r) == *family).copied().collect();
        let mut points: Vec<Point> =
            own.iter().filter_map(|r| y(r, &own).map(|(y, error)| Point { x: x(r), y, error })).collect();
        let order = |x: X| if let X::Value(v) = x { v } else { f64::INFINITY };
        points.sort_by(|a, b| order(a.x).total_cmp(&order(b.x)));
        let (color, marker) = look(family, &all);
        Series { label: family.label(&all), color, marker, points }
    };
    all.iter().map(line).filter(|s| !s.points.is_empty()).collect()
}

/// The batch size as a place on the axis.
pub fn batch_x(run: &RunRecord) -> X {
    match run.batch_size {
        BatchSize::Targets(n) => X::Value(n.into()),
        BatchSize::All => X::All,
    }
}

pub fn absolute(run: &RunRecord, _: &[&RunRecord]) -> Option<(f64, f64)> {
    Some((median(run), error(run)))
}

/// How much faster than batch 1 of the same family.
pub fn relative(run: &RunRecord, own: &[&RunRecord]) -> Option<(f64, f64)> {
    let one = own.iter().find(|r| r.batch_size == BatchSize::Targets(1))?;
    let ratio = median(one) / median(run);
    if run.batch_size == BatchSize::Targets(1) {
        return Some((1.0, 0.0));
    }
    Some((ratio, ratio * (error(one) / median(one)).hypot(error(run) / median(run))))
}

/// For each family and each value of `key`, the fastest run.
fn best_by<'a>(runs: &[&'a RunRecord], key: impl Fn(&RunRecord) -> f64) -> Vec<&'a RunRecord> {
    let mut best: Vec<&RunRecord> = Vec::new();
    for &run in runs {
        let same = |other: &&RunRecord| Family::of(other) == Family::of(run) && key(other) == key(run);
        match best.iter().position(same) {
            Some(i) if median(run) < median(best[i]) => best[i] = run,
            Some(_) => {}
            None => best.push(run),
        }
    }
    best
}

fn several(runs: &[&RunRecord], key: impl Fn(&RunRecord) -> f64) -> bool {
    runs.windows(2).any(|w| key(w[0]) != key(w[1]))
}

/// All figures that the runs are enough for.
pub fn figures(report: &Report) -> Vec<Figure> {
    let groups = groups(report);
    let several_workloads = groups.iter().any(|g| g.workload != groups[0].workload);
    let several_heads = groups.iter().any(|g| g.heads != groups[0].heads);
    let mut figures = Vec::new();
    for group in &groups {
        let suffix = [
            several_workloads.then(|| format!("-{}", slug(group.workload))),
            several_heads.then(|| format!("-{}heads", group.heads)),
        ];
        let suffix: String = suffix.into_iter().flatten().collect();
        group_figures(group, report, &suffix, &mut figures);
    }
    if several_heads {
        for workload in workloads(&groups) {
            let suffix = if several_workloads { format!("-{}", slug(workload)) } else { String::new() };
            figures.push(heads_figure(&groups, report, workload, &suffix));
        }
    }
    with_names_of_their_own(figures)
}

/// Number the names of figures that are called alike: clips may differ in what file names here do not have.
pub fn with_names_of_their_own(mut figures: Vec<Figure>) -> Vec<Figure> {
    let mut taken = HashSet::new();
    for figure in &mut figures {
        let numbered = (2..).map(|n| format!("{}-{n}", figure.slug));
        let name = std::iter::once(figure.slug.clone()).chain(numbered).find(|name| !taken.contains(name));
        figure.slug = name.unwrap_or_default();
        taken.insert(figure.slug.clone());
    }
    figures
}

fn workloads<'a>(groups: &[Group<'a>]) -> Vec<&'a str> {
    let mut names: Vec<&str> = groups.iter().map(|g| g.workload).collect();
    names.dedup();
    names.sort_unstable();
    names.dedup();
    names
}

/// `name` as a part of a file name.
pub fn slug(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect()
}

/// What is constant in a figure.
fn setting(report: &Report, workload: &str, heads: u32, changed: Option<f64>) -> [String; 2] {
    let work = match (workload, changed) {
        ("random", Some(n)) => format!("{} of {} targets changed per frame", count(n), report.input.targets),
        ("random", None) => format!("{} targets", report.input.targets),
        (clip, Some(n)) => format!("clip {clip}: {} of {} targets changed per frame", count(n), report.input.targets),
        (clip, None) => format!("clip {clip}"),
    };
    let heads = if heads == 1 { String::new() } else { format!(" · {heads} heads") };
    let mesh = format!("{}, {} vertices", report.input.name, thousands(report.input.vertices));
    [format!("{work}{heads}"), format!("{mesh} · {}", report.device.name)]
}

fn group_figures(group: &Group<'_>, report: &Report, suffix: &str, figures: &mut Vec<Figure>) {
    let most = group.runs.iter().map(|r| r.changed).fold(0.0, f64::max);
    let full: Vec<&RunRecord> = group.runs.iter().filter(|r| r.changed == most).copied().collect();
    let here = |changed| setting(report, group.workload, group.heads, changed);
    let mut add = |name: &str, caption: String, chart: Chart| {
        figures.push(Figure { slug: format!("{name}{suffix}"), caption, chart });
    };
    let batches = series(&full, batch_x, absolute);
    if batches.iter().any(|s| s.points.len() > 1) {
        add(
            "time-vs-batch",
            "Median time per frame; bars are ±1 standard error. Each pass reads and writes the whole pose, so \
             fewer passes mean less traffic. The cpu path has no passes and is drawn as a level."
                .into(),
            Chart::Lines(LineChart::new(
                "Time per frame against batch size",
                here(Some(most)),
                ["targets per pass", "ms per frame"],
                Axes::Counts,
                batches,
            )),
        );
    }
    let mut relatives = series(&full, batch_x, relative);
    relatives.retain(|s| s.points.len() > 1);
    if !relatives.is_empty() {
        add(
            "relative-performance",
            "Time at batch 1 divided by time at batch b, each path against itself: what batching alone gains.".into(),
            Chart::Lines(LineChart {
                reference: Some(1.0),
                ..LineChart::new(
                    "Relative performance against batch size",
                    here(Some(most)),
                    ["targets per pass", "times as fast as batch 1"],
                    Axes::CountsFromZero,
                    relatives,
                )
            }),
        );
    }
    if several(&group.runs, |r| r.changed) {
        let best = best_by(&group.runs, |r| r.changed);
        add(
            "time-vs-changed",
            "Each point is the fastest batch size of its path. An incremental update pays for what changed.".into(),
            Chart::Lines(LineChart::new(
                "Time per frame against changed targets",
                here(None),
                ["targets changed per frame", "ms per frame"],
                Axes::CountsFromZero,
                series(&best, |r| X::Value(r.changed), absolute),
            )),
        );
    }
    if let Some(chart) = floor_chart(&full, here(Some(most))) {
        add(
            "floor",
            "The floor is the time to move each delta of a changed target once, and what is updated of the pose in and \
             out, at the best bandwidth of plain reading and copying. What stays in a cache can beat it."
                .into(),
            Chart::Bars(chart),
        );
    }
}

fn floor_chart(runs: &[&RunRecord], subtitle: [String; 2]) -> Option<BarChart> {
    let all = families(runs);
    let bar = |family: &Family| {
        let best = fastest(runs.iter().filter(|r| Family::of(r) == *family).copied())?;
        let share = best.floor_fraction.filter(|s| s.is_finite() && *s >= 0.0)?;
        // A path without passes has no batches to speak of.
        let batch = best.gpu_ms.map(|_| batch_words(best.batch_size));
        let remark = remark(share, median(best), batch.as_deref());
        Some(Bar { label: family.label(&all), remark, length: share, color: look(family, &all).0 })
    };
    let mut bars: Vec<Bar> = all.iter().filter_map(bar).collect();
    bars.sort_by(|a, b| b.length.total_cmp(&a.length));
    let title = "How near the memory-bandwidth floor".into();
    (!bars.is_empty()).then_some(BarChart { title, subtitle, unit: Unit::Share, bars })
}

fn heads_figure(groups: &[Group<'_>], report: &Report, workload: &str, suffix: &str) -> Figure {
    // In each group for itself: heads play a clip from different frames on, so that the mean depends on their number.
    let mut full: Vec<&RunRecord> = vec![];
    for group in groups.iter().filter(|g| g.workload == workload) {
        let most = group.runs.iter().map(|r| r.changed).fold(0.0, f64::max);
        full.extend(group.runs.iter().filter(|r| r.changed == most));
    }
    let changed = full.first().map(|r| r.changed).filter(|n| full.iter().all(|r| r.changed == *n));
    let best = best_by(&full, |r| r.heads.into());
    Figure {
        slug: format!("time-vs-heads{suffix}"),
        caption: match full.iter().any(|r| r.shared) {
            true => "Each point is the fastest batch size of its path. One head is updated for all.".into(),
            false => "Each point is the fastest batch size of its path. Every head has its own weights.".into(),
        },
        chart: Chart::Lines(LineChart::new(
            "Time per frame against heads",
            setting(report, workload, 1, changed),
            ["heads", "ms per frame"],
            Axes::CountsFromZero,
            series(&best, |r| X::Value(r.heads.into()), absolute),
        )),
    }
}

#[cfg(test)]
#[path = "select_tests.rs"]
mod tests;
