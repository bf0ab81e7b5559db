//! index.html: one page that needs nothing but itself.

use super::headline::sentences;
use super::record::{MeshInfo, Report, RunRecord};
use super::select::median;
use super::suites;
use crate::page::{document, figures, table, verdict};
use crate::plots::Figure;
use crate::table::{bytes, count, optional, percent, sig3, thousands};
use maud::{Markup, html};

/// The page. Figures come with their SVG.
pub fn page(report: &Report, drawn: &[(Figure, String)]) -> String {
    let headline = sentences(report);
    let (title, rest) = headline.split_first().map_or(("", &[][..]), |(t, r)| (t.trim_end_matches('.'), r));
    let day = report.created.split('T').next().unwrap_or_default();
    let body = html! {
        header {
            p.kicker { "deltamorph bench · " (report.input.name) " · " (day) }
            h1 { (title) }
            @for sentence in rest { p.lead { (sentence) } }
        }
        (warning(report))
        (facts(report))
        @if !report.suites.is_empty() {
            section {
                h2 { "Suites" }
                ul {
                    @for suite in &report.suites {
                        li { a href=(suites::page::file_name(suite)) { (suites::text::title(&suite.name)) } }
                    }
                }
            }
        }
        (figures(drawn))
        section {
            h2 { "All configurations" }
            (table(HEADINGS.split('|'), rows(report)))
            (not_run(report))
        }
        section {
            h2 { "Measure it again" }
            pre { code { (report.command) } }
            p.note {
                "All numbers: " a href="report.json" { "report.json" } ", " a href="runs.csv" { "runs.csv" }
                ". deltamorph " (report.version) ", " (report.created) "."
            }
        }
    };
    document(&format!("{} · deltamorph bench", report.input.name), &body)
}

/// What a reader of times from a software driver has to know.
pub fn warning(report: &Report) -> Markup {
    html! {
        @if report.device.is_software() {
            p.warning {
                "This ran on a software driver: the processor played the GPU. Compare the configurations with each \
                 other; the times say little about any GPU."
            }
        }
    }
}

/// The facts that the numbers depend on, as cards.
pub fn facts(report: &Report) -> Markup {
    let (d, i, b) = (&report.device, &report.input, &report.bandwidth);
    let rate = |v: Option<f64>| v.map_or("not measured".to_owned(), |v| format!("{} GB/s", sig3(v)));
    let driver = [d.driver.as_str(), d.driver_info.as_str()].join(" ");
    let api = if d.api_version.is_empty() { String::new() } else { format!("Vulkan {}", d.api_version) };
    let cards = [
        ("Device", d.name.clone(), vec![format!("{} {}", driver.trim(), api), kind(&d.kind).to_owned()]),
        ("Processor", d.cpu.clone(), vec![format!("{} threads", d.threads)]),
        (
            "Mesh",
            format!("{} vertices × {} targets", thousands(i.vertices), i.targets),
            match report.meshes.is_empty() {
                true => vec![
                    format!("{} triangles, {}", thousands(i.triangles), i.origin),
                    format!("a target moves {} of the vertices", percent(i.moved_mean)),
                ],
                false => report.meshes.iter().map(mesh).collect(),
            },
        ),
        (
            "Memory bandwidth",
            format!("{} copy on the device", rate(b.device_copy_gb_s)),
            vec![
                format!("device read {}", rate(b.device_read_gb_s)),
                format!("processor copy {}, read {}", rate(b.cpu_copy_gb_s), rate(b.cpu_read_gb_s)),
            ],
        ),
    ];
    html! {
        section.cards {
            @for (label, value, notes) in &cards {
                div.card {
                    h3 { (label) }
                    p.value { (value) }
                    @for note in notes { p { (note.trim()) } }
                }
            }
        }
    }
}

/// One of the meshes of the suites.
fn mesh(m: &MeshInfo) -> String {
    let (vertices, moved) = (thousands(m.vertices), percent(m.moved_mean));
    format!("{}: {vertices} vertices, {} targets, each moves {moved}", m.name, m.targets)
}

fn kind(kind: &str) -> &str {
    match kind {
        "cpu" => "software driver",
        "discrete" => "discrete GPU",
        "integrated" => "integrated GPU",
        "virtual" => "virtual GPU",
        "none" => "no Vulkan device used",
        other => other,
    }
}

const HEADINGS: &str = "result|path|format|mode|workload|heads|changed|batch|passes|ms per frame|round trip ms|bytes|\
    of the floor|error / diagonal";

fn rows(report: &Report) -> impl Iterator<Item = Markup> {
    // The fastest of each kind of work is worth finding at a glance.
    let work = |r: &RunRecord| (r.suite.clone(), r.cell.clone(), r.workload.clone(), r.heads, r.changed.to_bits());
    let timed = |r: &RunRecord| r.verified && r.time().is_some();
    report.runs.iter().map(move |run| {
        let rivals = report.runs.iter().filter(|r| work(r) == work(run) && timed(r));
        let best = timed(run) && rivals.map(median).fold(f64::INFINITY, f64::min) >= median(run);
        row(run, best)
    })
}

/// What was asked for and could not run.
pub fn not_run(report: &Report) -> Markup {
    html! {
        @if !report.skipped.is_empty() {
            h3 { "Not run" }
            ul { @for skipped in &report.skipped { li { b { (skipped.what) } ": " (skipped.reason) } } }
        }
    }
}

fn row(run: &RunRecord, best: bool) -> Markup {
    let class = if run.verified { best.then_some("best") } else { Some("wrong") };
    html! {
        tr class=[class] {
            td { (verdict(run.verified)) }
            @for word in [&run.path, &run.format, &run.mode, &run.workload] { td { (word) } }
            @for number in [run.heads.to_string(), count(run.changed), run.batch_size.to_string(), count(run.passes)] {
                td { (number) }
            }
            td { @match run.time() {
                Some(time) => { (sig3(time.median)) " " small { "± " (sig3(time.stderr)) } }
                None => "–",
            } }
            td { (optional(run.cpu_ms.map(|t| t.median))) }
            td { (bytes(run.bytes_moved)) }
            td { (run.floor_fraction.map_or("–".to_owned(), percent)) }
            td { (optional(run.max_error_rel)) }
        }
        // The reason has a row of its own: in a column it would widen the table beyond the page.
        @if let Some(problem) = &run.problem { tr.reason { td colspan=(HEADINGS.split('|').count()) { (problem) } } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{select::figures, synthetic};

    #[test]
    fn the_page_needs_nothing_else() {
        let report = synthetic::report();
        let drawn: Vec<_> = figures(&report)
            .into_iter()
            .map(|f| {
                let svg = f.svg().expect("drawn");
                (f, svg)
            })
            .collect();
        let page = page(&report, &drawn);
        assert_eq!(page.matches("<svg").count(), drawn.len());
        for outside in ["<script", "<link", "@import", "src=", "url("] {
            assert!(!page.contains(outside), "{outside}");
        }
        assert_eq!(page.matches("<tr class=\"wrong\"").count(), 2);
        assert!(page.contains("class=\"best\"") && page.contains("prefers-color-scheme"));
        assert!(page.contains("Example GPU &lt;1&gt;") && !page.contains("Example GPU <1>"));
        assert!(page.contains(&report.command));
        for tag in ["section", "figure", "table", "tr", "td", "div", "main"] {
            let opened = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}
