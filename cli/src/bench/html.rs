//! index.html: one page that needs nothing but itself.

use super::headline::sentences;
use super::record::{MeshInfo, Report, RunRecord, Skipped};
use super::select::median;
use super::suites::{self, record::SuiteRecord};
use crate::page::{document, escape, figure};
use crate::plots::Figure;
use crate::table::{bytes, percent, sig3, thousands};
use std::fmt::Write;

/// The page. Figures come with their SVG.
pub fn page(report: &Report, figures: &[(Figure, String)]) -> String {
    let headline = sentences(report);
    let (title, rest) = headline.split_first().map_or(("", &[][..]), |(t, r)| (t.trim_end_matches('.'), r));
    let mut body = String::new();
    let mut add = |html: String| {
        body.push_str(&html);
        body.push('\n');
    };
    add(format!(
        "<header><p class=\"kicker\">deltamorph bench · {} · {}</p><h1>{}</h1>",
        escape(&report.input.name),
        escape(&day(&report.created)),
        escape(title)
    ));
    add(rest.iter().map(|s| format!("<p class=\"lead\">{}</p>", escape(s))).collect());
    add("</header>".into());
    add(warning(report));
    add(facts(report));
    add(links(report));
    add("<section class=\"figures\">".into());
    figures.iter().for_each(|(drawn, svg)| add(figure(drawn, svg)));
    add("</section>".into());
    add(table(report));
    add(format!(
        "<section><h2>Measure it again</h2><pre><code>{}</code></pre><p class=\"note\">All numbers: \
         <a href=\"report.json\">report.json</a>, <a href=\"runs.csv\">runs.csv</a>. deltamorph {}, {}.</p></section>",
        escape(&report.command),
        escape(&report.version),
        escape(&report.created),
    ));
    document(&format!("{} · deltamorph bench", report.input.name), &body)
}

/// What a reader of times from a software driver has to know.
pub fn warning(report: &Report) -> String {
    if !report.device.is_software() {
        return String::new();
    }
    "<p class=\"warning\">This ran on a software driver: the processor played the GPU. Compare the configurations with \
     each other; the times say little about any GPU.</p>"
        .into()
}

fn links(report: &Report) -> String {
    let link = |suite: &SuiteRecord| {
        let name = suites::page::file_name(suite);
        format!("<li><a href=\"{name}\">{}</a></li>", escape(suites::text::title(&suite.name)))
    };
    match report.suites.iter().map(link).collect::<String>() {
        links if links.is_empty() => links,
        links => format!("<section><h2>Suites</h2><ul>{links}</ul></section>"),
    }
}

/// The facts that the numbers depend on, as cards.
pub fn facts(report: &Report) -> String {
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
    let card = |(label, value, notes): &(&str, String, Vec<String>)| {
        let notes: String = notes.iter().map(|n| format!("<p>{}</p>", escape(n.trim()))).collect();
        format!("<div class=\"card\"><h3>{label}</h3><p class=\"value\">{}</p>{notes}</div>", escape(value))
    };
    format!("<section class=\"cards\">{}</section>", cards.iter().map(card).collect::<String>())
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

fn table(report: &Report) -> String {
    let mut out = String::from("<section><h2>All configurations</h2><div class=\"scroll\"><table><thead><tr>");
    for heading in [
        "result",
        "path",
        "format",
        "mode",
        "workload",
        "heads",
        "changed",
        "batch",
        "passes",
        "ms per frame",
        "round trip ms",
        "bytes",
        "of the floor",
        "error / diagonal",
    ] {
        let _ = write!(out, "<th>{heading}</th>");
    }
    out.push_str("</tr></thead><tbody>\n");
    // The fastest of each kind of work is worth finding at a glance.
    let work = |r: &RunRecord| (r.suite.clone(), r.cell.clone(), r.workload.clone(), r.heads, r.changed.to_bits());
    let timed = |r: &RunRecord| r.verified && r.time().is_some();
    for run in &report.runs {
        let rivals = report.runs.iter().filter(|r| work(r) == work(run) && timed(r));
        let best = timed(run) && rivals.map(median).fold(f64::INFINITY, f64::min) >= median(run);
        out.push_str(&row(run, best));
    }
    out.push_str("</tbody></table></div>");
    out.push_str(&not_run(report));
    out.push_str("</section>");
    out
}

/// What was asked for and could not run.
pub fn not_run(report: &Report) -> String {
    let item = |s: &Skipped| format!("<li><b>{}</b>: {}</li>", escape(&s.what), escape(&s.reason));
    match report.skipped.iter().map(item).collect::<String>() {
        items if items.is_empty() => items,
        items => format!("<h3>Not run</h3><ul>{items}</ul>"),
    }
}

fn row(run: &RunRecord, best: bool) -> String {
    let number = |v: Option<f64>| v.map_or("–".to_owned(), sig3);
    let time = run.time();
    let count = |v: f64| if v.fract() == 0.0 { format!("{v:.0}") } else { sig3(v) };
    let class = match (run.verified, best) {
        (false, _) => " class=\"wrong\"",
        (true, true) => " class=\"best\"",
        _ => "",
    };
    let result = if run.verified { "<span class=\"ok\">right</span>" } else { "<span class=\"bad\">wrong</span>" };
    let words = [&run.path, &run.format, &run.mode, &run.workload];
    let mut cells: Vec<String> = std::iter::once(result.into()).chain(words.map(|w| escape(w))).collect();
    cells.extend([
        run.heads.to_string(),
        count(run.changed),
        run.batch_size.to_string(),
        count(run.passes),
        time.map_or("–".to_owned(), |t| format!("{} <small>± {}</small>", sig3(t.median), sig3(t.stderr))),
        number(run.cpu_ms.map(|t| t.median)),
        bytes(run.bytes_moved),
        run.floor_fraction.map_or("–".to_owned(), percent),
        number(run.max_error_rel),
    ]);
    let columns = cells.len();
    let cells: String = cells.iter().map(|c| format!("<td>{c}</td>")).collect();
    // The reason has a row of its own: in a column it would widen the table beyond the page.
    let reason = run
        .problem
        .as_deref()
        .map_or(String::new(), |p| format!("<tr class=\"reason\"><td colspan=\"{columns}\">{}</td></tr>\n", escape(p)));
    format!("<tr{class}>{cells}</tr>\n{reason}")
}

fn day(created: &str) -> String {
    created.split('T').next().unwrap_or_default().to_owned()
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
        assert!(page.contains(&escape(&report.command)));
        for tag in ["section", "figure", "table", "tr", "td", "div", "main"] {
            let opened = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}
