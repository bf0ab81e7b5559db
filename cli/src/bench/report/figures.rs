//! Figures from runs.

use crate::bench::record::{Report, RunRecord, SuiteRecord, batch_words, fastest, heads_words, unused};
use crate::bench::stats::Stats;
use crate::plots::{ALL, Axes, Bar, Chart, Figure, Look, Point, Series};
use crate::table::{count, percent, sig3, thousands};
use deltamorph::{BatchSize, UpdatePath};

/// A value and its standard error.
type Value = (f64, f64);

/// The content of a line chart: a line for each family of runs.
struct Kind {
    slug: &'static str,
    title: &'static str,
    labels: [&'static str; 2],
    axes: Axes,
    caption: &'static str,
    x: fn(&RunRecord) -> f64,
    /// The value of a run, given its family.
    y: fn(&RunRecord, &[&RunRecord]) -> Option<Value>,
}

const TIME_VS_BATCH: Kind = Kind {
    slug: "time-vs-batch",
    title: "Time per frame against batch size",
    labels: ["targets per pass", "ms per frame"],
    axes: Axes::Counts,
    caption: "Median time per frame; bars are ±1 standard error. Each pass reads and writes the whole pose, so fewer \
              passes mean less traffic. The cpu path has no passes and is drawn as a level.",
    x: |run| match run.batch_size {
        BatchSize::Targets(n) => n.into(),
        BatchSize::All => ALL,
    },
    y: |run, _| run.time().map(|time| (time.median, time.stderr)),
};
const RELATIVE: Kind = Kind {
    slug: "relative-performance",
    title: "Relative performance against batch size",
    labels: ["targets per pass", "times as fast as batch 1"],
    axes: Axes::CountsFromZero,
    caption: "Time at batch 1 divided by time at batch b, each path against itself: what batching alone gains.",
    y: relative,
    ..TIME_VS_BATCH
};
const TIME_VS_CHANGED: Kind = Kind {
    slug: "time-vs-changed",
    title: "Time per frame against changed targets",
    labels: ["targets changed per frame", "ms per frame"],
    caption: "Each point is the fastest batch size of its path. An incremental update pays for what changed.",
    x: |run| run.changed,
    ..TIME_VS_BATCH
};
const TIME_VS_HEADS: Kind = Kind {
    slug: "time-vs-heads",
    title: "Time per frame against heads",
    labels: ["heads", "ms per frame"],
    caption: "Each point is the fastest batch size of its path. Every head has its own weights; where they are shared, \
              one head is updated for all.",
    x: |run| run.heads.into(),
    ..TIME_VS_CHANGED
};
const DEVICE_TIME: Kind = Kind {
    slug: "gpu",
    title: "Device time",
    labels: ["targets kept", "ms per frame"],
    caption: "Mean time of the update and of a draw for each head on the device; bars are ±1 standard error.",
    x: |run| run.targets as f64,
    y: |run, _| run.update_and_draw_ms.map(mean),
    ..TIME_VS_BATCH
};
const ROUND_TRIP: Kind = Kind {
    slug: "round-trip",
    title: "Round trip",
    caption: "Mean time from weights to fence, update and draws included; bars are ±1 standard error. Of the path cpu \
              the update alone: upload and draw are in the table below.",
    y: |run, _| run.cpu_ms.map(mean),
    ..DEVICE_TIME
};

impl Kind {
    /// The figure, if there is more than a point to draw; `subtitle` states the constants.
    fn figure(&self, suffix: &str, subtitle: &[String; 2], runs: &[&RunRecord]) -> Option<Figure> {
        let Self { labels, axes, .. } = *self;
        let (all, mut series) = (families(runs), vec![]);
        for (family, own) in by_family(runs) {
            let best = partition(&own, self.x).into_iter().filter_map(|(x, runs)| Some((x, fastest(runs)?)));
            let point = |(x, run)| (self.y)(run, &own).map(|(y, error)| Point::new(x, y, error));
            let mut points: Vec<Point> = best.filter_map(point).collect();
            points.sort_by(|a, b| a.x.total_cmp(&b.x));
            if !points.is_empty() {
                series.push(Series { label: family.label(&all), look: family.look(&all), points });
            }
        }
        series.iter().any(|line| line.points.len() > 1).then(|| Figure {
            slug: format!("{}{suffix}", self.slug),
            caption: self.caption.into(),
            title: self.title.into(),
            subtitle: subtitle.clone(),
            chart: Chart::Lines { labels, axes, series },
        })
    }
}

/// All figures that there are enough runs for, of `suite` or of an ordinary run.
pub fn figures(report: &Report, suite: Option<&SuiteRecord>) -> Vec<Figure> {
    let runs: Vec<&RunRecord> = report.runs_of(suite).filter(|run| run.counts()).collect();
    let mut figures = match suite {
        None if report.suites.is_empty() => sweep(report, &runs),
        // Each suite has its own figures.
        None => vec![],
        Some(suite) if suite.name == "chapter" => chapter(report, &runs),
        Some(suite) if suite.name == "crowd" => crowd(report, &runs),
        Some(suite) => suite.cells.iter().filter_map(|cell| ranking(report, suite, &cell.name)).collect(),
    };
    let of_suite = suite.map_or(String::new(), |suite| format!("{}-", suite.name));
    // Names of clips may differ only in characters that file names here replace.
    let mut taken: Vec<String> = vec![];
    for figure in &mut figures {
        figure.slug = unused(&(of_suite.clone() + &figure.slug), "-", |name| taken.iter().any(|other| other == name));
        taken.push(figure.slug.clone());
    }
    figures
}

/// Figures of an ordinary run: a set for each workload and number of instances, and one against instances for each
/// workload.
fn sweep(report: &Report, runs: &[&RunRecord]) -> Vec<Figure> {
    let workloads = partition(runs, |run| run.workload.clone());
    let mut figures = vec![];
    for (workload, runs) in &workloads {
        let of_workload = if workloads.len() > 1 { format!("-{}", slug(workload)) } else { String::new() };
        let clip = if workload == "random" { String::new() } else { format!("clip {workload}: ") };
        let (groups, mut every) = (partition(runs, |run| run.heads), vec![]);
        for (heads, runs) in &groups {
            let of_heads = if groups.len() > 1 { format!("-{heads}heads") } else { String::new() };
            let suffix = of_workload.clone() + &of_heads;
            let heads = if *heads == 1 { String::new() } else { format!(" · {heads} heads") };
            let here = |work: String| [format!("{clip}{work}{heads}"), mesh(report, runs)];
            let hardest = hardest(runs);
            let most = here(change(hardest[0]));
            let figure = |kind: Kind| kind.figure(&suffix, &most, &hardest);
            figures.extend([TIME_VS_BATCH, RELATIVE].into_iter().filter_map(figure));
            figures.extend(TIME_VS_CHANGED.figure(&suffix, &here(format!("{} targets", runs[0].targets)), runs));
            figures.extend(floor(&suffix, most, &hardest));
            every.extend(hardest);
        }
        // Instances play a clip from different frames on, so the mean depends on their number: take the hardest of each
        // group.
        let work = clip.strip_suffix(": ").map_or_else(|| change(every[0]), Into::into);
        figures.extend(TIME_VS_HEADS.figure(&of_workload, &[work, mesh(report, runs)], &every));
    }
    figures
}

fn chapter(report: &Report, runs: &[&RunRecord]) -> Vec<Figure> {
    let mut figures = vec![];
    for (changed, runs) in partition(runs, |run| run.changed) {
        let subtitle = [change(runs[0]), mesh(report, &runs)];
        let figure = |kind: Kind| kind.figure(&format!("-{changed}-changed"), &subtitle, &runs);
        figures.extend([TIME_VS_BATCH, RELATIVE].into_iter().filter_map(figure));
    }
    figures
}

fn crowd(report: &Report, runs: &[&RunRecord]) -> Vec<Figure> {
    let runs: Vec<&RunRecord> = runs.iter().copied().filter(|run| run.cell.ends_with(" targets")).collect();
    let mut figures = vec![];
    for ((heads, shared), runs) in partition(&runs, |run| (run.heads, run.shared)) {
        let name = heads_words(heads, shared);
        let subtitle = [format!("{name}; all targets kept change in every frame"), mesh(report, &runs)];
        let figure = |kind: Kind| kind.figure(&format!("-{}", slug(&name)), &subtitle, &runs);
        figures.extend([DEVICE_TIME, ROUND_TRIP].into_iter().filter_map(figure));
    }
    figures
}

/// A bar for each technique of a cell, the fastest on top.
fn ranking(report: &Report, suite: &SuiteRecord, cell: &str) -> Option<Figure> {
    let all = families(&report.runs_of(Some(suite)).collect::<Vec<_>>());
    let (mut right, wrong): (Vec<&RunRecord>, Vec<&RunRecord>) =
        report.runs_of(Some(suite)).filter(|run| run.cell == cell).partition(|run| run.counts());
    right.sort_by(|a, b| a.median().total_cmp(&b.median()));
    let bar = |run: &&RunRecord| Bar {
        label: run.label(),
        remark: format!("{} · n = {}", remark(run), run.time().map_or(0, |time| time.n)),
        length: run.median(),
        look: Family::of(run).look(&all),
    };
    let wrong = match wrong.len() {
        0 => String::new(),
        n => format!(" {n} gave a wrong result and are not drawn."),
    };
    (!right.is_empty()).then(|| Figure {
        slug: slug(cell),
        caption: format!(
            "Median time of the update and of one draw for each head, measured interleaved; of the path cpu the update \
             alone: upload and draw are in the table below.{wrong}"
        ),
        title: cell.to_owned(),
        subtitle: ["ms per frame: the update, and one draw for each head".into(), mesh(report, &right)],
        chart: Chart::Bars { least: 0.0, bars: right.iter().map(bar).collect() },
    })
}

fn floor(suffix: &str, subtitle: [String; 2], runs: &[&RunRecord]) -> Option<Figure> {
    let all = families(runs);
    let bar = |(family, own): (Family, Vec<&RunRecord>)| {
        let run = fastest(own)?;
        let share = run.floor_fraction.filter(|share| share.is_finite())?;
        let remark = format!("{} · {}", percent(share), remark(run));
        Some(Bar { label: family.label(&all), remark, length: 100.0 * share, look: family.look(&all) })
    };
    let mut bars: Vec<Bar> = by_family(runs).into_iter().filter_map(bar).collect();
    bars.sort_by(|a, b| b.length.total_cmp(&a.length));
    (!bars.is_empty()).then(|| Figure {
        slug: format!("floor{suffix}"),
        caption: "The floor is the time to move each delta of a changed target once, and what is updated of the pose \
                  in and out, at the best bandwidth of plain reading and copying. What stays in a cache can beat it."
            .into(),
        title: "How near the memory-bandwidth floor, in %".into(),
        subtitle,
        // A path can beat a floor measured with a copy: the axis extends to include it.
        chart: Chart::Bars { least: 100.0, bars },
    })
}

/// The text at the end of a bar: its time, and its batch if its path has batches.
fn remark(run: &RunRecord) -> String {
    let batch = match (run.batch_size, run.batch_max) {
        (BatchSize::All, None) => String::new(),
        (batch, _) => format!(" · {}", batch_words(batch)),
    };
    format!("{} ms{batch}", sig3(run.median()))
}

fn change(run: &RunRecord) -> String {
    format!("{} of {} targets changed per frame", count(run.changed), run.targets)
}

/// The constants: the mesh and the device.
fn mesh(report: &Report, runs: &[&RunRecord]) -> String {
    let mesh = report.meshes.iter().find(|mesh| mesh.name == runs[0].mesh).unwrap_or(&report.input);
    format!("{}, {} vertices · {}", mesh.name, thousands(mesh.vertices), report.device.name)
}

/// `name` as a part of a file name.
fn slug(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect()
}

/// The runs with the most changed targets.
pub fn hardest<'a>(runs: &[&'a RunRecord]) -> Vec<&'a RunRecord> {
    let most = runs.iter().map(|run| run.changed).fold(0.0, f64::max);
    runs.iter().copied().filter(|run| run.changed == most).collect()
}

/// The speedup over batch 1 of the same family.
pub fn relative(run: &RunRecord, own: &[&RunRecord]) -> Option<Value> {
    let single = BatchSize::Targets(1);
    if run.batch_size == single {
        return Some((1.0, 0.0));
    }
    let (one, this) = (own.iter().find(|run| run.batch_size == single)?.time()?, run.time()?);
    let ratio = one.median / this.median;
    Some((ratio, ratio * (one.stderr / one.median).hypot(this.stderr / this.median)))
}

fn mean(time: Stats) -> Value {
    (time.mean, time.stderr)
}

/// A family of configurations, which differ only in the parameter along an axis: path, format, mode, poses, slots, and
/// whether instances share an animation, each as it is named.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Family([String; 6]);

impl Family {
    fn of(run: &RunRecord) -> Self {
        // Float32 poses are not named.
        let sums = if run.sums().is_empty() { String::new() } else { format!(" {}", run.sums()) };
        let (format, mode, slots) = (&run.format, &run.mode, run.slots);
        let [format, mode, slots] = [format!(" {format}"), format!(" {mode}"), format!(" {slots} slots")];
        Self([run.path.clone(), format, mode, sums, slots, if run.shared { " shared".into() } else { String::new() }])
    }

    /// Its name; with mode, poses and slots if they differ among `all`.
    fn label(&self, all: &[Family]) -> String {
        let told = |i: &usize| !(2..5).contains(i) || all.iter().any(|other| other.0[*i] != self.0[*i]);
        (0..6).filter(told).map(|i| self.0[i].as_str()).collect()
    }

    /// A hue for each path; among those of its path in `all`, a variant for each family.
    fn look(&self, all: &[Family]) -> Look {
        let path = UpdatePath::ALL.iter().position(|path| path.name() == self.0[0]).unwrap_or(UpdatePath::ALL.len());
        Look::new(path, all.iter().filter(|other| other.0[0] == self.0[0] && *other < self).count())
    }
}

/// Groups runs by `key`, in the order of the first of each.
pub fn partition<'a, K: PartialEq>(
    runs: &[&'a RunRecord],
    key: impl Fn(&RunRecord) -> K,
) -> Vec<(K, Vec<&'a RunRecord>)> {
    let mut groups: Vec<(K, Vec<&RunRecord>)> = vec![];
    for &run in runs {
        let key = key(run);
        match groups.iter_mut().find(|(other, _)| *other == key) {
            Some((_, group)) => group.push(run),
            None => groups.push((key, vec![run])),
        }
    }
    groups
}

/// The families of runs: those of one path together, otherwise in the order that they ran.
pub fn by_family<'a>(runs: &[&'a RunRecord]) -> Vec<(Family, Vec<&'a RunRecord>)> {
    partition(runs, |run| run.path.clone()).iter().flat_map(|(_, own)| partition(own, Family::of)).collect()
}

fn families(runs: &[&RunRecord]) -> Vec<Family> {
    by_family(runs).into_iter().map(|(family, _)| family).collect()
}
