//! Tests of the choice of figures.

use super::*;
use crate::bench::synthetic;

fn slugs(report: &Report) -> Vec<String> {
    figures(report).into_iter().map(|f| f.slug).collect()
}

fn lines<'a>(figures: &'a [Figure], slug: &str) -> &'a LineChart {
    match &figures.iter().find(|f| f.slug == slug).expect(slug).chart {
        Chart::Lines(chart) => chart,
        Chart::Bars(_) => panic!("{slug} has bars"),
    }
}

#[test]
fn one_set_per_workload() {
    let mut report = synthetic::report();
    let mut expected = Vec::new();
    for workload in ["random", "speech-30fps"] {
        expected.push(format!("time-vs-batch-{workload}"));
        expected.push(format!("relative-performance-{workload}"));
        if workload == "random" {
            expected.push(format!("time-vs-changed-{workload}"));
        }
        expected.push(format!("floor-{workload}"));
    }
    assert_eq!(slugs(&report), expected);
    report.runs.retain(|r| r.workload == "random" && r.changed == 4.0);
    assert_eq!(slugs(&report), ["time-vs-batch", "relative-performance", "floor"]);
    report.runs.clear();
    assert!(slugs(&report).is_empty());
}

#[test]
fn heads_get_a_figure_of_their_own() {
    let mut report = synthetic::report();
    report.runs.retain(|r| r.workload == "random" && r.changed == 4.0);
    let crowd: Vec<RunRecord> = report.runs.iter().cloned().map(|r| RunRecord { heads: 16, ..r }).collect();
    report.runs.extend(crowd);
    let slugs = slugs(&report);
    assert!(slugs.contains(&"time-vs-heads".into()) && slugs.contains(&"floor-16heads".into()), "{slugs:?}");
}

#[test]
fn a_clip_has_a_point_for_each_number_of_heads() {
    let mut report = synthetic::report();
    report.runs.retain(|r| r.workload == "speech_30fps" && r.verified);
    let more: Vec<RunRecord> =
        report.runs.iter().cloned().map(|r| RunRecord { heads: 16, changed: 2.5, ..r }).collect();
    report.runs.extend(more);
    let figures = figures(&report);
    for series in &lines(&figures, "time-vs-heads").series {
        assert_eq!(series.points.iter().map(|p| p.x).collect::<Vec<_>>(), [X::Value(1.0), X::Value(16.0)]);
    }
}

#[test]
fn relative_performance_starts_at_one() {
    let figures = figures(&synthetic::report());
    for series in &lines(&figures, "relative-performance-random").series {
        assert_eq!((series.points[0].x, series.points[0].y), (X::Value(1.0), 1.0), "{}", series.label);
        assert!(series.points.last().is_some_and(|p| p.y > 2.0 && p.error > 0.0));
    }
}

#[test]
fn wrong_runs_are_not_drawn_and_all_comes_last() {
    let figures = figures(&synthetic::report());
    let chart = lines(&figures, "time-vs-batch-random");
    let by = |label: &str| chart.series.iter().find(|s| s.label == label).expect(label);
    assert_eq!(by("feedback float32").points.len(), 14);
    assert_eq!(by("compute snorm16").points.last().map(|p| p.x), Some(X::All));
    assert_eq!(by("cpu float32").points.len(), 1);
    let colors: std::collections::HashSet<_> = chart.series.iter().map(|s| (s.color.0, s.color.1, s.color.2)).collect();
    assert_eq!(colors.len(), chart.series.len());
}

#[test]
fn formats_with_both_sums_look_different() {
    let mut report = synthetic::report();
    let exact: Vec<RunRecord> =
        report.runs.iter().cloned().map(|r| RunRecord { accumulate: "exact".into(), ..r }).collect();
    report.runs.extend(exact);
    let figures = figures(&report);
    let series = &lines(&figures, "time-vs-batch-random").series;
    let look = |s: &Series| ((s.color.0, s.color.1, s.color.2), format!("{:?}", s.marker));
    let looks: std::collections::HashSet<_> = series.iter().map(look).collect();
    assert_eq!(looks.len(), series.len());
    assert!(series.len() > 6 && series.iter().filter(|s| s.label.ends_with(" exact")).count() * 2 == series.len());
}

#[test]
fn labels_name_what_varies() {
    let mut report = synthetic::report();
    report.runs.retain(|r| r.workload == "random");
    let rebuild: Vec<RunRecord> =
        report.runs.iter().cloned().map(|r| RunRecord { mode: "rebuild".into(), ..r }).collect();
    report.runs.extend(rebuild);
    let figures = figures(&report);
    let labels: Vec<_> = lines(&figures, "time-vs-batch").series.iter().map(|s| s.label.as_str()).collect();
    assert!(labels.contains(&"feedback float32 rebuild") && labels.contains(&"cpu float32 incremental"), "{labels:?}");
}
