//! Plots of runs, as figures with SVG in them.

use super::group::{by_family, partition};
use super::record::{RunRecord, batch_words, draws_words, fastest};
use crate::table::{count, sig3};
use deltamorph::UpdatePath;

/// Colours that colour-blind people can tell apart (after Okabe and Ito), in light and dark schemes.
const HUES: [&str; 9] =
    ["#0072b2", "#d55e00", "#cc79a7", "#009e73", "#7a5fd0", "#808890", "#b08a00", "#2aa5b0", "#c04040"];
/// Lines of one path differ in their dashes.
const DASHES: [&str; 8] = ["none", "7 4", "2 3", "9 3 2 3", "16 4", "1 6", "9 3 2 3 2 3", "16 4 4 4"];
/// Width of a plot, its height without a legend, and the room on its left, on its right, and below.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 20.0;
const BELOW: f64 = 44.0;
/// Height of a line of text, of a bar, or of the legend.
const LINE: f64 = 20.0;

fn hue(run: &RunRecord) -> &'static str {
    let path = UpdatePath::ALL.iter().position(|path| path.name() == run.path).unwrap_or(0);
    HUES[path % HUES.len()]
}

/// A plot with a line for each family of runs, if there is more than a point to draw. Of several runs at one `x` the
/// fastest counts; an infinite `x` comes last.
pub fn lines(
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
pub fn bars(title: &str, runs: &[&RunRecord]) -> String {
    let mut runs = runs.to_vec();
    runs.sort_by(|a, b| a.median().total_cmp(&b.median()));
    let most = runs.iter().map(|run| run.median()).fold(0.0, f64::max);
    let mut svg = String::new();
    for (i, run) in runs.iter().enumerate() {
        let name = match run.technique.is_empty() {
            true => format!("{} {}{}", run.path, run.formats(), draws_words(run.draws)),
            // The cell names the draws.
            false => run.label(),
        };
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

pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
