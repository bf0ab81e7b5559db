//! What reports say of made-up runs.

use super::figures::figures;
use super::page::file_name;
use super::sentences::sentences;
use super::*;
use crate::bench::synthetic;
use crate::plots::{ALL, Chart, Figure, Series};
use std::collections::HashSet;

fn drawn(report: &Report) -> Vec<Figure> {
    figures(report, report.suites.first())
}

fn slugs(report: &Report) -> Vec<String> {
    drawn(report).into_iter().map(|figure| figure.slug).collect()
}

fn lines(report: &Report, slug: &str) -> Vec<Series> {
    match drawn(report).into_iter().find(|figure| figure.slug == slug).expect(slug).chart {
        Chart::Lines { series, .. } => series,
        Chart::Bars { .. } => panic!("{slug} has bars"),
    }
}

/// The made-up report, with the runs that `keep` wants, and these once more as `change` makes them.
fn report(keep: fn(&RunRecord) -> bool, change: fn(RunRecord) -> RunRecord) -> Report {
    let mut report = synthetic::report();
    report.runs.retain(keep);
    report.runs.extend(report.runs.clone().into_iter().map(change));
    report
}

#[test]
fn one_set_of_figures_per_workload() {
    let mut report = synthetic::report();
    let sets = ["time-vs-batch", "relative-performance", "time-vs-changed", "floor"];
    let mut expected: Vec<String> = sets.map(|name| format!("{name}-random")).into();
    expected.extend(["time-vs-batch", "relative-performance", "floor"].map(|name| format!("{name}-speech-30fps")));
    assert_eq!(slugs(&report), expected);
    report.runs.retain(|r| r.workload == "random" && r.changed == 4.0);
    assert_eq!(slugs(&report), ["time-vs-batch", "relative-performance", "floor"]);
    report.runs.clear();
    assert!(slugs(&report).is_empty());
    assert_eq!(slugs(&synthetic::suite()), ["techniques-dense--1---1-head"]);
    assert!(drawn(&synthetic::suite())[0].caption.contains("1 gave a wrong result"));
}

#[test]
fn heads_get_a_figure_of_their_own() {
    let work = |r: &RunRecord| r.workload == "random" && r.changed == 4.0;
    let slugs = slugs(&report(work, |run| RunRecord { heads: 16, ..run }));
    assert!(slugs.contains(&"time-vs-heads".into()) && slugs.contains(&"floor-16heads".into()), "{slugs:?}");
    // A clip has a point for each number of heads, though the mean of what changes depends on their number.
    let clip = |r: &RunRecord| r.workload == "speech_30fps" && r.verified;
    for line in lines(&report(clip, |run| RunRecord { heads: 16, changed: 2.5, ..run }), "time-vs-heads") {
        assert_eq!(line.points.iter().map(|p| p.x).collect::<Vec<_>>(), [1.0, 16.0]);
    }
}

#[test]
fn lines_have_the_right_runs_in_order() {
    let report = synthetic::report();
    for line in lines(&report, "relative-performance-random") {
        assert_eq!((line.points[0].x, line.points[0].y), (1.0, 1.0), "{}", line.label);
        assert!(line.points.last().is_some_and(|p| p.y > 2.0 && p.error > 0.0));
    }
    let lines = lines(&report, "time-vs-batch-random");
    let points = |label: &str| &lines.iter().find(|line| line.label == label).expect(label).points;
    assert_eq!((points("feedback float32").len(), points("cpu float32").len()), (14, 1), "one is wrong");
    assert_eq!(points("compute snorm16").last().map(|p| p.x), Some(ALL));
}

#[test]
fn families_look_different_and_are_named_by_what_varies() {
    let exact = report(|_| true, |run| RunRecord { accumulate: "exact".into(), ..run });
    for (report, looks) in [(synthetic::report(), 5), (exact, 10)] {
        let lines = lines(&report, "time-vs-batch-random");
        let look = |line: &Series| format!("{:?}", (line.look.color(), line.look.marker()));
        assert_eq!(lines.iter().map(look).collect::<HashSet<_>>().len(), looks);
        assert_eq!(lines.iter().filter(|line| line.label.ends_with(" exact")).count(), looks - 5);
    }
    let rebuild = report(|run| run.workload == "random", |run| RunRecord { mode: "rebuild".into(), ..run });
    let labels: Vec<_> = lines(&rebuild, "time-vs-batch").into_iter().map(|line| line.label).collect();
    let expected = ["feedback float32 rebuild", "cpu float32 incremental"];
    assert!(expected.iter().all(|label| labels.iter().any(|own| own == label)), "{labels:?}");
}

#[test]
fn sentences_have_numbers_from_the_runs() {
    let mut report = synthetic::report();
    let all = sentences(&report);
    for (sentence, words) in [
        (0, "Batch 16 is 7.7× as fast as batch 1 on feedback (snorm16)"),
        (1, "With 72 targets changed per frame the fastest is compute snorm16, one pass: "),
        (2, "Changing 4 of 72 targets"),
        (3, "2 of "),
    ] {
        assert!(all[sentence].starts_with(words), "{all:?}");
    }
    let suite = sentences(&synthetic::suite());
    assert!(suite[0].contains("fastest GPU path in 1 of 1 cells"), "{suite:?}");

    report.runs.retain(|r| r.path == "cpu" && r.changed == 72.0);
    let few = sentences(&report);
    assert!(few[0].contains("the fastest is cpu") && few[1].contains("match the float64 reference"), "{few:?}");
    report.runs.clear();
    assert_eq!(sentences(&report), ["0 configurations, none of them timed"]);
}

#[test]
fn tables_have_a_line_per_run_and_name_what_is_wrong() {
    let report = synthetic::report();
    for terminal in [true, false] {
        let text = tables::runs(&report.runs, terminal).to_string();
        assert_eq!((text.lines().count(), text.matches("WRONG").count()), (report.runs.len() + 1, 2));
        assert_eq!((text.contains("round trip ms"), text.contains("technique")), (!terminal, false));
    }
    let report = synthetic::suite();
    let [(who, cells), (ms, times)] = &tables::of_suite(&report.suites[0], &report)[..] else { panic!("two tables") };
    assert_eq!([*who, *ms], ["Who is fastest", "Milliseconds of every technique"]);
    let (cells, times) = (cells.to_string(), times.to_string());
    assert!(cells.contains("45.0") && times.contains("WRONG"), "{cells}\n{times}");
}

#[test]
fn the_folder_is_complete_and_its_pages_need_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path().join("new/report");
    for (report, wrong, name) in
        [(synthetic::report(), 2, "Example GPU &lt;1&gt;"), (synthetic::suite(), 1, "dense &lt;1&gt;")]
    {
        write(&report, &folder).expect("written");
        let figures = drawn(&report);
        for Figure { slug, .. } in &figures {
            let svg = std::fs::read_to_string(folder.join(format!("{slug}.svg"))).expect("read");
            assert!(svg.contains("<svg") && svg.contains("</svg>") && svg.contains("sans-serif"), "{svg}");
            assert_eq!(std::fs::read(folder.join(format!("{slug}.png"))).expect("read")[..4], *b"\x89PNG");
        }
        assert!(folder.join("index.html").is_file());
        let (first, n) = (&report.runs[0], report.runs.len());
        assert_eq!(read(&folder.join("report.json")).expect("read").runs.len(), n);
        let mut csv = csv::Reader::from_path(folder.join("runs.csv")).expect("read");
        let rows: Vec<csv::StringRecord> = csv.records().collect::<Result<_, _>>().expect("a cell for every column");
        assert_eq!((rows.len(), rows[0].len()), (n, 55));
        assert_eq!((&rows[0][5], &rows[0][10]), (first.path.as_str(), first.batch_size.to_string().as_str()));

        let page = std::fs::read_to_string(folder.join(file_name(report.suites.first()))).expect("read");
        assert_eq!(page.matches("<svg").count(), figures.len());
        for outside in ["<script", "<link", "@import", "src=", "url(", "<1>"] {
            assert!(!page.contains(outside), "{outside}");
        }
        assert_eq!(page.matches("<tr class=\"wrong\"").count(), wrong);
        let problem = report.runs.iter().find_map(|r| r.problem.as_deref()).expect("one is wrong");
        for part in ["class=\"best\"", "prefers-color-scheme", name, &report.command, problem] {
            assert!(page.contains(part), "{part}");
        }
        for tag in ["section", "figure", "table", "tr", "td", "div", "main"] {
            let opened = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}

#[test]
fn other_files_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("report.json");
    assert!(read(&path).is_err());
    let other = Report { schema: 2, ..synthetic::report() };
    for (text, words) in [("{}".into(), "deltamorph bench"), (output::to_json(&other).expect("text"), "schema 2")] {
        std::fs::write(&path, text).expect("written");
        assert!(read(&path).unwrap_err().to_string().contains(words), "{words}");
    }
}
