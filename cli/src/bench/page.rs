//! index.html: the whole report on one page that needs no other file.

use super::group::{by_family, gain, hardest, partition};
use super::plot::{bars, escaped, lines};
use super::record::{Report, RunRecord, SuiteRecord, UNEVEN, draws_words, fastest, heads_words};
use super::sentences::{of_suite, sentences, title};
use super::tables;
use crate::table::{Table, count, percent, thousands};
use deltamorph::BatchSize;

const STYLE: &str = "
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1500px; margin: 2em auto; padding: 0 1em; }
figure { display: inline-block; width: 640px; max-width: 100%; margin: 0 1em 2em 0; vertical-align: top; }
figcaption { font-weight: 600; }
figcaption span { display: block; font-weight: normal; opacity: .75; font-size: 13px; }
svg { width: 100%; height: auto; color: inherit; }
svg text { font: 12px system-ui, sans-serif; fill: currentColor; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 8px; text-align: right; white-space: nowrap; border-bottom: 1px solid #8884; }
.word { text-align: left; }
.best { background: #00a06026; }
.wrong, .note { background: #d0202026; }
.uneven { background: #e0a00033; }
.note { padding: 8px 12px; }
";

/// What columns and bars mean, besides times and rounds.
const COLUMNS: &str = "Of floor: the time of copying the fewest bytes that have to move, over the median; data in a cache \
                       can beat it. ±: the standard error of the mean. Bars in plots: the fastest round to the slowest.";

pub fn page(report: &Report) -> String {
    let name = escaped(&report.input.name);
    let found: String = sentences(report).iter().map(|text| format!("<li>{}</li>", escaped(text))).collect();
    let mut body = format!("<h1>Time to update “{name}”</h1><p>{}</p><ul>{found}</ul>", escaped(&about(report)));
    if report.device.kind == "cpu" {
        body += "<p class=note>This ran on a software driver: the processor played the GPU. Compare the configurations \
                 with each other; the times say little about any GPU.</p>";
    }
    if report.suites.is_empty() {
        body += &figures(report, None);
    }
    for suite in &report.suites {
        body += &format!("<h2>{}</h2><p>{}</p>", title(suite), escaped(&of_suite(suite)));
        for (heading, found) in tables::of_suite(suite, report) {
            body += &format!("<h3>{heading}</h3>{}", table(&found, &[]));
        }
        body += &figures(report, Some(suite));
    }
    let runs: Vec<&RunRecord> = report.runs.iter().collect();
    let same = tables::of_all(&report.runs).unwrap_or_default();
    let all = table(&tables::runs(&report.runs, false), &runs);
    body += &format!(
        "<h2>All configurations</h2><p>{} Times are medians. Rounds: how many times as long a slow round took as a fast \
         one; uneven above {UNEVEN}. {COLUMNS}</p>{all}",
        escaped(&same)
    );
    let skipped =
        report.skipped.iter().map(|s| format!("<li><b>{}</b>: {}</li>", escaped(&s.what), escaped(&s.reason)));
    let skipped: String = skipped.collect();
    if !skipped.is_empty() {
        body += &format!("<h2>Not run</h2><ul>{skipped}</ul>");
    }
    body += &format!(
        "<h2>Measure it again</h2><pre><code>{}</code></pre><p>In a clone, ./with-vulkan cargo run --release -- stands for \
         deltamorph. All numbers: <a href=\"report.json\">report.json</a>, \
         <a href=\"runs.csv\">runs.csv</a>. deltamorph {}, {}.</p>",
        escaped(&report.command),
        report.version,
        report.created
    );
    format!(
        "<!DOCTYPE html><html lang=en><head><meta charset=utf-8><meta name=viewport \
         content=\"width=device-width\"><title>{name} · deltamorph bench</title><style>{STYLE}</style></head>\
         <body>{body}</body></html>\n"
    )
}

/// What was measured, for a reader who has never seen the project.
fn about(report: &Report) -> String {
    let meshes = if report.meshes.is_empty() { std::slice::from_ref(&report.input) } else { &report.meshes };
    let mesh = |m: &crate::input::MeshInfo| {
        format!(
            "{} ({} vertices, {} targets, each moves {})",
            m.name,
            thousands(m.vertices),
            m.targets,
            percent(m.moved_mean)
        )
    };
    let meshes: Vec<String> = meshes.iter().map(mesh).collect();
    let device = &report.device;
    format!(
        "Measured is the time per frame to move the vertices of {}, in {} configurations. Device: {} ({}, {} {}, Vulkan \
         {}); processor: {}, {} threads.",
        meshes.join("; "),
        thousands(report.runs.len()),
        device.name,
        device.kind,
        device.driver,
        device.driver_info,
        device.api_version,
        device.cpu,
        device.threads,
    )
}

/// The plots of a suite, or of an ordinary run.
fn figures(report: &Report, suite: Option<&SuiteRecord>) -> String {
    let runs: Vec<&RunRecord> = report.runs_of(suite).filter(|run| run.counts()).collect();
    match suite.map(|suite| suite.name.as_str()) {
        None => sweep(&runs),
        Some("crowd") => {
            let points: Vec<&RunRecord> = runs.into_iter().filter(|run| run.cell.ends_with(" targets")).collect();
            let groups = partition(&points, |run| (run.heads, run.shared, run.draws));
            let plot = |((heads, shared, draws), runs): &((u32, bool, u32), Vec<&RunRecord>)| {
                let heads = heads_words(*heads, *shared);
                let what = format!("{heads}{}; all targets kept change", draws_words(*draws));
                lines(
                    ["Time per frame against targets", &what],
                    "x: targets kept; y: ms",
                    runs,
                    |r| r.targets as f64,
                    time,
                )
            };
            groups.iter().map(plot).collect()
        }
        Some(_) => partition(&runs, |run| run.cell.clone()).iter().map(|(cell, runs)| bars(cell, runs)).collect(),
    }
}

/// The plots of an ordinary run: a set for each workload and number of instances.
fn sweep(runs: &[&RunRecord]) -> String {
    let mut plots = String::new();
    for (workload, runs) in partition(runs, |run| run.workload.clone()) {
        for (heads, runs) in partition(&runs, |run| run.heads) {
            let hardest = hardest(&runs);
            plots += &batches(&hardest);
            let best: Vec<&RunRecord> = by_family(&hardest).into_iter().filter_map(|(_, own)| fastest(own)).collect();
            plots += &bars(&format!("The paths at their best: {}", what(&best)), &best);
            let given = format!("{workload}, {}", heads_words(heads, false));
            let titles = ["Time per frame against targets changed", &given];
            plots += &lines(titles, "x: targets changed; y: ms", &runs, |r| r.changed, time);
        }
        let hardest: Vec<&RunRecord> =
            partition(&runs, |run| run.heads).iter().flat_map(|(_, own)| hardest(own)).collect();
        let titles = ["Time per frame against heads", &what(&hardest)];
        plots += &lines(titles, "x: heads; y: ms", &hardest, |r| r.heads.into(), time);
    }
    plots
}

/// The work that runs have in common.
fn what(runs: &[&RunRecord]) -> String {
    let Some(run) = runs.first() else { return String::new() };
    let heads = heads_words(run.heads, run.shared);
    format!("{}: {} of {} targets change, {heads}", run.workload, count(run.changed), run.targets)
}

/// The plots against batch size.
fn batches(runs: &[&RunRecord]) -> String {
    let size = |run: &RunRecord| match run.batch_size {
        BatchSize::Targets(n) => n.into(),
        BatchSize::All => f64::INFINITY,
    };
    let relative = |run: &RunRecord, own: &[&RunRecord]| gain(run, own).map(|gain| [gain.min, gain.median, gain.max]);
    let titles = ["Relative performance against batch size", &what(runs)];
    let relative = lines(titles, "x: targets per pass; y: times as fast as batch 1", runs, size, relative);
    relative
        + &lines(["Time per frame against batch size", &what(runs)], "x: targets per pass; y: ms", runs, size, time)
}

/// Least, median and most of the time of a run's rounds.
fn time(run: &RunRecord, _: &[&RunRecord]) -> Option<[f64; 3]> {
    let times = run.rounds.iter().map(|round| round.ms);
    let [least, most] = [times.clone().fold(run.median(), f64::min), times.fold(run.median(), f64::max)];
    Some([least, run.median(), most])
}

/// A table as HTML; rows of `runs` that are wrong, uneven or the fastest of their work are marked.
fn table(table: &Table, runs: &[&RunRecord]) -> String {
    let class = |column: usize| if column < table.left { " class=word" } else { "" };
    let cells = |tag: &str, cells: &[String]| -> String {
        let cell = |(i, cell): (usize, &String)| format!("<{tag}{}>{}</{tag}>", class(i), escaped(cell));
        cells.iter().enumerate().map(cell).collect()
    };
    let mut html = format!("<div class=scroll><table><thead><tr>{}</tr></thead><tbody>", cells("th", &table.headings));
    let work =
        |r: &RunRecord| (r.suite.clone(), r.cell.clone(), r.workload.clone(), r.heads, r.draws, r.changed.to_bits());
    let best = partition(&runs.iter().copied().filter(|run| run.counts()).collect::<Vec<_>>(), work);
    let best: Vec<&RunRecord> = best.into_iter().filter_map(|(_, rivals)| fastest(rivals)).collect();
    for (i, row) in table.rows.iter().enumerate() {
        let mark = match runs.get(i) {
            Some(run) if !run.verified => " class=wrong",
            Some(run) if run.uneven() => " class=uneven",
            Some(run) if best.iter().any(|best| std::ptr::eq(*best, *run)) => " class=best",
            _ => "",
        };
        html += &format!("<tr{mark}>{}</tr>", cells("td", row));
        if let Some(problem) = runs.get(i).and_then(|run| run.problem.as_deref()) {
            html += &format!("<tr class=wrong><td class=word colspan={}>{}</td></tr>", row.len(), escaped(problem));
        }
    }
    html + "</tbody></table></div>"
}
