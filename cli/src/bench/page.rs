//! index.html: the whole report on one page that needs no other file. Plots are SVG.

use super::group::{by_family, gain, hardest, partition};
use super::record::{Report, RunRecord, SuiteRecord, batch_words, fastest, heads_words};
use super::sentences::{of_suite, sentences, title};
use super::tables;
use crate::table::{Table, count, percent, sig3, thousands};
use deltamorph::{BatchSize, UpdatePath};

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

/// Colours that colour-blind people can tell apart (after Okabe and Ito), in light and dark schemes.
const HUES: [&str; 9] =
    ["#0072b2", "#d55e00", "#cc79a7", "#009e73", "#7a5fd0", "#808890", "#b08a00", "#2aa5b0", "#c04040"];
/// Lines of one path differ in their dashes.
const DASHES: [&str; 4] = ["none", "7 4", "2 3", "9 3 2 3"];
/// Width of a plot, its height without a legend, and the room on its left, on its right, and below.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 20.0;
const BELOW: f64 = 44.0;
/// Height of a line of text, of a bar, or of the legend.
const LINE: f64 = 20.0;

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
    body += &format!("<h2>All configurations</h2><p>{}</p>{all}", escaped(&same));
    let skipped =
        report.skipped.iter().map(|s| format!("<li><b>{}</b>: {}</li>", escaped(&s.what), escaped(&s.reason)));
    let skipped: String = skipped.collect();
    if !skipped.is_empty() {
        body += &format!("<h2>Not run</h2><ul>{skipped}</ul>");
    }
    body += &format!(
        "<h2>Measure it again</h2><pre><code>{}</code></pre><p>All numbers: <a href=\"report.json\">report.json</a>, \
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
    let (device, b) = (&report.device, &report.bandwidth);
    let rates = [b.device_copy_gb_s, b.device_read_gb_s, b.cpu_copy_gb_s, b.cpu_read_gb_s];
    let [device_copy, device_read, cpu_copy, cpu_read] = rates.map(|rate| rate.map_or("–".into(), sig3));
    format!(
        "Measured is the time per frame to move the vertices of {}, in {} configurations. Device: {} ({}, {} {}, Vulkan \
         {}); processor: {}, {} threads. Memory bandwidth in GB/s: device, copy {device_copy}, read {device_read}; \
         processor, copy {cpu_copy}, read {cpu_read}.",
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
        Some("chapter") => partition(&runs, |run| run.changed).iter().map(|(_, runs)| batches(runs)).collect(),
        Some("crowd") => {
            let points: Vec<&RunRecord> = runs.into_iter().filter(|run| run.cell.ends_with(" targets")).collect();
            let groups = partition(&points, |run| (run.heads, run.shared));
            let plot = |((heads, shared), runs): &((u32, bool), Vec<&RunRecord>)| {
                let what = format!("{}; all targets kept change", heads_words(*heads, *shared));
                lines(["Time per frame against targets", &what], "targets kept", runs, |r| r.targets as f64, time)
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
            plots += &lines(titles, "targets changed", &runs, |r| r.changed, time);
        }
        let hardest: Vec<&RunRecord> =
            partition(&runs, |run| run.heads).iter().flat_map(|(_, own)| hardest(own)).collect();
        let titles = ["Time per frame against heads", &what(&hardest)];
        plots += &lines(titles, "heads", &hardest, |r| r.heads.into(), time);
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
    let relative = lines(titles, "targets per pass (times as fast as batch 1)", runs, size, relative);
    relative + &lines(["Time per frame against batch size", &what(runs)], "targets per pass (ms)", runs, size, time)
}

/// Least, median and most of the time of a run's rounds.
fn time(run: &RunRecord, _: &[&RunRecord]) -> Option<[f64; 3]> {
    let times = run.rounds.iter().map(|round| round.ms);
    let [least, most] = [times.clone().fold(run.median(), f64::min), times.fold(run.median(), f64::max)];
    Some([least, run.median(), most])
}

fn hue(run: &RunRecord) -> &'static str {
    let path = UpdatePath::ALL.iter().position(|path| path.name() == run.path).unwrap_or(0);
    HUES[path % HUES.len()]
}

/// A plot with a line for each family of runs, if there is more than a point to draw. Of several runs at one `x` the
/// fastest counts; an infinite `x` comes last.
fn lines(
    titles: [&str; 2],
    name: &str,
    runs: &[&RunRecord],
    x: fn(&RunRecord) -> f64,
    y: fn(&RunRecord, &[&RunRecord]) -> Option<[f64; 3]>,
) -> String {
    let families = by_family(runs);
    let mut series = vec![];
    for (family, own) in &families {
        let best = partition(own, x).into_iter().filter_map(|(x, runs)| Some((x, fastest(runs)?)));
        let mut points: Vec<(f64, [f64; 3])> = best.filter_map(|(x, run)| Some((x, y(run, own)?))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        if !points.is_empty() {
            series.push((family.label(&families), own[0], points));
        }
    }
    if series.iter().all(|(_, _, points)| points.len() < 2) {
        return String::new();
    }
    let all = || series.iter().flat_map(|(_, _, points)| points);
    let mut places: Vec<f64> = all().map(|point| point.0).collect();
    places.sort_by(f64::total_cmp);
    places.dedup();
    let most = places.iter().copied().filter(|x| x.is_finite()).fold(1.0, f64::max);
    // Logarithmic, with room for 0 on the left and for all targets in one pass on the right.
    let along = |x: f64| (1.0 + x.min(1.6 * most)).ln();
    let [first, last] = [places[0], places[places.len() - 1]].map(along);
    let px = |x: f64| LEFT + 12.0 + (along(x) - first) / (last - first).max(1e-9) * (WIDTH - LEFT - RIGHT - 24.0);
    let [low, high] = all().fold([f64::INFINITY, 0.0], |[low, high], (_, y)| [y[0].min(low), y[2].max(high)]);
    let scale = Scale::new(low, high);
    let py = |y: f64| 8.0 + (1.0 - scale.share(y)) * (HEIGHT - BELOW - 8.0);

    let mut svg = String::new();
    let mut free = 0.0;
    for tick in &scale.ticks {
        let (y, end) = (py(*tick), WIDTH - RIGHT);
        svg += &format!("<path d=\"M{LEFT} {y:.1}H{end}\" stroke=\"currentColor\" stroke-opacity=\".15\"/>");
        svg += &text([LEFT - 6.0, y + 4.0], "end", &plain(*tick));
    }
    for place in places {
        let label = if place.is_finite() { count(place) } else { "all".into() };
        if px(place) >= free {
            svg += &text([px(place), HEIGHT - BELOW + 18.0], "middle", &label);
            free = px(place) + 8.0 * (label.len() + 1) as f64;
        }
    }
    let named = if scale.logarithmic { format!("{name}; the axis of values is logarithmic") } else { name.into() };
    svg += &text([WIDTH / 2.0, HEIGHT - 8.0], "middle", &named);
    for (i, (label, run, points)) in series.iter().enumerate() {
        let earlier = series[..i].iter().filter(|(_, other, _)| other.path == run.path).count();
        let look = format!("stroke=\"{}\" stroke-dasharray=\"{}\"", hue(run), DASHES[earlier % DASHES.len()]);
        let at = |(x, [_, y, _]): &(f64, [f64; 3])| format!("{:.1} {:.1}", px(*x), py(*y));
        let path = points.iter().map(at).collect::<Vec<_>>().join("L");
        svg += &format!("<path d=\"M{path}\" fill=\"none\" stroke-width=\"2\" {look}/>");
        for (x, [low, y, high]) in points {
            let [x, low, y, high] = [px(*x), py(*low), py(*y), py(*high)];
            svg += &format!("<path d=\"M{x:.1} {low:.1}V{high:.1}\" stroke=\"{}\"/>", hue(run));
            svg += &format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{}\"/>", hue(run));
        }
        let [left, y] = [LEFT + (i % 2) as f64 * WIDTH / 2.0, HEIGHT + LINE * (i / 2) as f64 + 10.0];
        svg += &format!("<path d=\"M{left} {y}h28\" stroke-width=\"2\" {look}/>");
        svg += &text([left + 36.0, y + 4.0], "start", label);
    }
    figure(titles, HEIGHT + LINE * series.len().div_ceil(2) as f64, &svg)
}

/// A plot with a bar for each run, the fastest on top.
fn bars(title: &str, runs: &[&RunRecord]) -> String {
    let mut runs = runs.to_vec();
    runs.sort_by(|a, b| a.median().total_cmp(&b.median()));
    let most = runs.iter().map(|run| run.median()).fold(0.0, f64::max);
    let mut svg = String::new();
    for (i, run) in runs.iter().enumerate() {
        let name = if run.technique.is_empty() { format!("{} {}", run.path, run.formats()) } else { run.label() };
        let batch = if run.batch_max.is_some() { format!(", {}", batch_words(run.batch_size)) } else { String::new() };
        let (y, width) = (LINE * i as f64, run.median() / most * (WIDTH - 420.0));
        svg += &text([230.0, y + 14.0], "end", &name);
        svg += &format!("<rect x=\"236\" y=\"{}\" width=\"{width:.1}\" height=\"14\" fill=\"{}\"/>", y + 3.0, hue(run));
        svg += &text([242.0 + width, y + 14.0], "start", &format!("{} ms{batch}", sig3(run.median())));
    }
    figure([title, "Median time per frame; draws, where frames have them, included"], LINE * runs.len() as f64, &svg)
}

fn figure([title, note]: [&str; 2], height: f64, svg: &str) -> String {
    format!(
        "<figure><figcaption>{}<span>{}</span></figcaption><svg viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" \
         aria-label=\"{}\">{svg}</svg></figure>",
        escaped(title),
        escaped(note),
        escaped(title)
    )
}

fn text([x, y]: [f64; 2], anchor: &str, words: &str) -> String {
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>", escaped(words))
}

/// A number on an axis: 0.05, 20, 5000.
fn plain(value: f64) -> String {
    format!("{}", (value * 1e6).round() / 1e6)
}

/// The vertical axis: from 0, or logarithmic if values span a large ratio.
struct Scale {
    logarithmic: bool,
    ends: [f64; 2],
    ticks: Vec<f64>,
}

impl Scale {
    fn new(low: f64, high: f64) -> Self {
        let logarithmic = low > 0.0 && high / low > 20.0;
        // 1, 2, 5, 10, 20, … of a power of ten below all values.
        let base = 10f64.powf((if logarithmic { low } else { high / 10.0 }).log10().floor());
        let round = |i: i32| base * 10f64.powi(i.div_euclid(3)) * [1.0, 2.0, 5.0][i.rem_euclid(3) as usize];
        if logarithmic {
            let ticks: Vec<f64> = (0..60).map(round).filter(|tick| (low..=high).contains(tick)).collect();
            let every = ticks.len().div_ceil(8).max(1);
            return Self { logarithmic, ends: [low, high], ticks: ticks.into_iter().step_by(every).collect() };
        }
        let step = (0..9).map(round).find(|step| high / step <= 7.0).unwrap_or(high);
        let ticks = (0..8).map(|i| step * f64::from(i)).filter(|tick| *tick <= high).collect();
        Self { logarithmic, ends: [0.0, high], ticks }
    }

    /// Where a value lies, from 0 at the lower end to 1.
    fn share(&self, value: f64) -> f64 {
        let [value, low, high] = [value, self.ends[0], self.ends[1]].map(|v| if self.logarithmic { v.ln() } else { v });
        (value - low) / (high - low)
    }
}

/// A table as HTML; rows of `runs` that are wrong, uneven or the fastest of their work are marked.
fn table(table: &Table, runs: &[&RunRecord]) -> String {
    let class = |column: usize| if column < table.left { " class=word" } else { "" };
    let cells = |tag: &str, cells: &[String]| -> String {
        let cell = |(i, cell): (usize, &String)| format!("<{tag}{}>{}</{tag}>", class(i), escaped(cell));
        cells.iter().enumerate().map(cell).collect()
    };
    let mut html = format!("<div class=scroll><table><thead><tr>{}</tr></thead><tbody>", cells("th", &table.headings));
    let work = |r: &RunRecord| (r.suite.clone(), r.cell.clone(), r.workload.clone(), r.heads, r.changed.to_bits());
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

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
