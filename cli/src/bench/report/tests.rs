//! Reports of made-up runs.

use super::figures::figures;
use super::page::file_name;
use super::sentences::sentences;
use super::*;
use crate::bench::stats::Stats;
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

/// The made-up report, with the runs that `keep` selects, followed by these runs after `change`.
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
    // A clip has a point for each number of instances, even though the mean of changed targets depends on their number.
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
        assert!(line.points.last().is_some_and(|p| p.y > 2.0 && p.high > p.y && p.low < p.y));
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
    // Fixed-point poses, which take half the time, are named.
    let half = |run: RunRecord| {
        let gpu_ms = run.gpu_ms.map(|time| Stats { median: time.median / 2.0, ..time });
        RunRecord { gpu_ms, pose: "fixed32".into(), ..run }
    };
    let fixed = sentences(&self::report(|run| run.path == "compute" && run.format == "snorm16", half));
    assert!(fixed[0].contains(" on compute (snorm16"), "{fixed:?}");
    assert!(fixed[1].contains(" the fastest is compute snorm16 fixed32, one pass: "), "{fixed:?}");
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
    let found = tables::of_suite(&report.suites[0], &report);
    let [(who, cells), (ms, times), (moved, bytes)] = &found[..] else { panic!("three tables") };
    let moves = "Bytes that an update of every technique moves";
    assert_eq!([*who, *ms, *moved], ["Who is fastest on the device", "Milliseconds of every technique", moves]);
    let [cells, times, bytes] = [cells, times, bytes].map(ToString::to_string);
    assert!(cells.contains("45.0") && times.contains("WRONG"), "{cells}\n{times}");
    assert!(bytes.contains("1.00 KiB") && bytes.contains("WRONG"), "{bytes}");
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
        assert_eq!((rows.len(), rows[0].len()), (n, 56));
        assert_eq!((&rows[0][5], &rows[0][10]), (first.path.as_str(), first.batch_size.to_string().as_str()));

        let page = std::fs::read_to_string(folder.join(file_name(report.suites.first()))).expect("read");
        assert_eq!(page.matches("<svg").count(), 2 * figures.len(), "wide and narrow");
        for outside in ["<script src", "fetch(", "import(", "<link", "@import", "src=\"http", "src=\"/", "url(", "<1>"]
        {
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

/// The value of an attribute of an SVG element.
fn number(element: &str, name: &str) -> f64 {
    let value = element.split_once(&format!(" {name}=\"")).and_then(|(_, rest)| rest.split_once('"'));
    value.and_then(|(value, _)| value.parse().ok()).unwrap_or_else(|| panic!("{name}: {element}"))
}

/// Plots are 356 pixels wide on a phone of 390; wide ones are 598 on a page of two columns.
#[test]
fn text_in_plots_is_large_enough_and_within_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let long = report(|run| run.workload == "random", |run| RunRecord { mode: "rebuild".into(), ..run });
    for figure in drawn(&synthetic::suite()).into_iter().chain(drawn(&long)) {
        let drawn = figure.write(folder.path()).expect("drawn");
        for (svg, pixels) in [(&drawn.narrow, 356.0), (&drawn.wide, 598.0)] {
            let [width, height] = ["width", "height"].map(|name| number(svg, name));
            let texts: Vec<&str> = svg.split("<text").skip(1).collect();
            assert!(texts.len() > 5, "{svg}");
            for text in texts {
                let (size, x, y) = (number(text, "font-size"), number(text, "x"), number(text, "y"));
                assert!(size * pixels / width >= 11.0, "{size} of {width}: {text}");
                let words = text.split_once('>').and_then(|(_, rest)| rest.split_once('<')).expect("words").0.trim();
                // Approximate width in sans-serif fonts.
                let length = 0.55 * size * words.chars().count() as f64;
                let turned = text.contains("rotate");
                let start = match () {
                    () if text.contains("text-anchor=\"middle\"") => -length / 2.0,
                    () if text.contains("text-anchor=\"end\"") => -length,
                    () => 0.0,
                };
                let ends = [start, start + length].map(|along| if turned { y + along } else { x + along });
                let room = if turned { height } else { width };
                assert!(ends[0] >= 0.0 && ends[1] <= room, "{ends:?} of {room}: {text}");
                assert!((0.0..height).contains(&y), "{y} of {height}: {text}");
            }
        }
    }
}

#[test]
fn tables_can_be_sorted() {
    let report = synthetic::report();
    let page = page::page(&report, None, &[]);
    assert_eq!(page.matches("<table class=\"sortable\">").count(), 1);
    let headings = page.matches("<th scope=\"col\"").count();
    assert!(headings > 10 && page.contains("aria-sort"), "{headings}");
    // A number has a value to sort by, in any unit; a wrong run has none.
    for part in ["<td data-n=\"Infinity\">all</td>", "<td data-n=\"72\">72</td>", "<td>WRONG</td>"] {
        assert!(page.contains(part), "{part}");
    }
    let row =
        page.split("<tr class=\"wrong\">").nth(1).and_then(|rest| rest.split_once("</tr>")).expect("one is wrong");
    assert!(row.1.starts_with("<tr class=\"reason\"><td colspan="), "the remark follows its row");
}

#[test]
fn other_files_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("report.json");
    assert!(read(&path).is_err());
    let other = Report { schema: 2, ..synthetic::report() };
    let other = output::to_json(&other).expect("text");
    for (text, words) in [
        ("{}", "has no 'runs'; give a report.json that `deltamorph bench` wrote"),
        ("vertices", "is no JSON: expected value at line 1"),
        (r#"{"schema":1,"runs":[]}"#, "missing field `version`"),
        // Another schema is refused, even with the same fields.
        (r#"{"schema":3,"runs":{}}"#, "schema 3"),
        (&other, "schema 2"),
    ] {
        std::fs::write(&path, text).expect("written");
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("report.json"), "{error}");
    }
}
