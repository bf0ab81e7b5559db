//! `bench --compare`: reports of earlier runs, configuration by configuration.
//!
//! A time is the median of a run's rounds, or of its frames in reports without rounds; its spread is their minimum and
//! maximum. Configurations with overlapping spreads count as no different: a repeated run of the same program differs
//! as well.

use super::record::{DeviceInfo, Report, RunRecord};
use super::report;
use super::stats::Stats;
use crate::args::bench::BenchArgs;
use crate::input::MeshInfo;
use crate::output::{Failure, Output};
use crate::table::{Table, count, optional, sig3};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::iter::once;
use std::path::PathBuf;

/// Fields that identify a configuration: words, which tables align left, and numbers.
const WORDS: [&str; 11] =
    ["suite", "cell", "technique", "mesh", "path", "mode", "format", "pose", "accumulate", "workload", "shared"];
const NUMBERS: [&str; 7] = ["targets", "batch_size", "changed", "heads", "crowds", "slots", "error_budget"];
/// Fewest times with a meaningful spread.
const LEAST: usize = 4;

type Key = Map<String, Value>;
/// A run, and the key of its configuration.
type Keyed<'a> = (Key, &'a RunRecord);

/// The JSON of `bench --compare`.
#[derive(Debug, Serialize)]
struct Comparison {
    schema: u32,
    /// Name ('A', 'B', …), file and number of runs, in the order given; the others are compared with the first.
    reports: Vec<Value>,
    /// Differences besides the program.
    warnings: Vec<String>,
    comparisons: Vec<Against>,
}

/// A report, compared with the first.
#[derive(Debug, Serialize)]
struct Against {
    name: char,
    configurations: Vec<Pair>,
    only_in_baseline: Vec<Key>,
    only_here: Vec<Key>,
}

/// A configuration in both reports.
#[derive(Debug, Serialize)]
struct Pair {
    #[serde(flatten)]
    key: Key,
    /// "faster", "slower", "within_spread" (the spreads overlap), "undecided" (fewer than [`LEAST`] times, or times of
    /// different kinds) or "wrong".
    verdict: &'static str,
    /// "update", "update and draws", or "round trip".
    time: &'static str,
    baseline_ms: Option<f64>,
    ms: Option<f64>,
    /// Minimum and maximum of the times that the medians are of.
    baseline_spread: Option<[f64; 2]>,
    spread: Option<[f64; 2]>,
    /// Number of these times.
    n: [usize; 2],
    /// Time over that of the baseline.
    ratio: Option<f64>,
    /// The errors of wrong runs, and their reports.
    #[serde(skip_serializing_if = "Option::is_none")]
    problem: Option<String>,
}

pub fn run(args: &BenchArgs, out: &Output) -> Result<(), Failure> {
    let read = |path: &PathBuf| Ok((path.display().to_string(), report::read(path)?));
    let reports: Vec<(String, Report)> = args.compare.iter().map(read).collect::<Result<_, Failure>>()?;
    let found = Comparison::new(&reports)?;
    out.say(found.text());
    found.warnings.iter().for_each(|warning| out.note(warning));
    out.json(&found)
}

impl Comparison {
    /// Compares the first of `reports`, which come with their files, with each of the others.
    fn new(reports: &[(String, Report)]) -> Result<Self, Failure> {
        let keyed: Vec<Vec<Keyed<'_>>> = reports.iter().map(|(_, report)| keyed(report)).collect();
        let others = keyed.iter().zip('A'..).skip(1);
        let comparisons: Vec<Against> = others.map(|(runs, name)| Against::new(&keyed[0], runs, name)).collect();
        if comparisons.iter().all(|found| found.configurations.is_empty()) {
            let files: Vec<&str> = reports.iter().map(|(file, _)| file.as_str()).collect();
            return Err(Failure::Failed(format!(
                "{}: no configuration is in the first and in another; measure both with the same INPUT and options",
                files.join(", ")
            )));
        }
        let warnings = reports.iter().zip('A'..).skip(1);
        let warnings = warnings.flat_map(|((_, report), name)| differences(&reports[0].1, report, name)).collect();
        let reports = reports.iter().zip('A'..);
        let reports =
            reports.map(|((file, report), name)| json!({"name": name, "file": file, "runs": report.runs.len()}));
        Ok(Self { schema: 1, reports: reports.collect(), warnings, comparisons })
    }

    fn text(&self) -> String {
        let of = |against: &Against| format!("{}\n\n{}", against.table(), against.summary());
        let report = |report: &Value| format!("{}: {}", plain(&report["name"]), plain(&report["file"]));
        let reports = self.reports.iter().map(report).collect::<Vec<_>>().join("\n");
        let limits = "Spread: the least and the greatest time of a run. What differed during the whole of one run, such as \
                      another program at work or a warmer processor, counts as a difference of the program's: compare \
                      two runs of one program to learn how far apart they are.";
        let parts = once(reports).chain(self.comparisons.iter().map(of)).chain([limits.to_owned()]);
        parts.collect::<Vec<_>>().join("\n\n")
    }
}

/// The runs of a report with their keys. The changed targets of a clip are a mean over the timed frames, and not part
/// of its key.
fn keyed(report: &Report) -> Vec<Keyed<'_>> {
    let key = |run: &RunRecord| {
        let mut fields = serde_json::to_value(run).unwrap_or_default();
        if run.workload != "random" {
            fields["changed"] = Value::Null;
        }
        WORDS.into_iter().chain(NUMBERS).map(|field| (field.into(), fields[field].take())).collect()
    };
    report.runs.iter().map(|run| (key(run), run)).collect()
}

impl Against {
    fn new(before: &[Keyed<'_>], after: &[Keyed<'_>], name: char) -> Self {
        fn find<'a>(key: &Key, runs: &[Keyed<'a>]) -> Option<&'a RunRecord> {
            runs.iter().find(|(other, _)| other == key).map(|(_, run)| *run)
        }
        let pair = |(key, run): &Keyed<'_>| Some(Pair::new(key, [('A', run), (name, find(key, after)?)]));
        let only = |own: &[Keyed<'_>], others: &[Keyed<'_>]| {
            own.iter().filter(|(key, _)| find(key, others).is_none()).map(|(key, _)| key.clone()).collect()
        };
        let configurations = before.iter().filter_map(pair).collect();
        Self { name, configurations, only_in_baseline: only(before, after), only_here: only(after, before) }
    }

    /// "B against A: of 120 configurations in both 3 are faster, …".
    fn summary(&self) -> String {
        let (name, all) = (self.name, self.configurations.len());
        let number = |verdict: &str| self.configurations.iter().filter(|pair| pair.verdict == verdict).count();
        let [faster, slower, within] = ["faster", "slower", "within_spread"].map(number);
        let others = [
            (number("undecided"), "undecided".to_owned()),
            (number("wrong"), "wrong".into()),
            (self.only_in_baseline.len(), "only in A".into()),
            (self.only_here.len(), format!("only in {name}")),
        ];
        let others = others.into_iter().filter(|(number, _)| *number > 0);
        let others: String = others.map(|(number, what)| format!(", {number} {what}")).collect();
        format!(
            "{name} against A: of {all} configurations in both {faster} are faster, {slower} slower, {within} within the \
             spread{others}."
        )
    }

    /// A row for each configuration; fields that are the same in all are left out.
    fn table(&self) -> Table {
        let pairs = &self.configurations;
        let differs = |field: &&str| pairs.iter().any(|pair| pair.key.get(*field) != pairs[0].key.get(*field));
        let (words, numbers) = (WORDS.into_iter().filter(differs), NUMBERS.into_iter().filter(differs));
        let left = 1 + words.clone().count();
        let fields: Vec<&str> = words.chain(numbers).collect();
        let name = self.name;
        let own = [format!("{name} is"), format!("{name} ms"), format!("{name} spread"), format!("{name} / A")];
        let [first, measures @ ..] = own.each_ref().map(String::as_str);
        let headings = once(first).chain(fields.iter().copied()).chain(["A ms", "A spread"]).chain(measures);
        let mut table = Table::new(&headings.chain(["time of"]).collect::<Vec<_>>(), left);
        let spread = |of: Option<[f64; 2]>| of.map_or("–".into(), |of| of.map(sig3).join("–"));
        for pair in pairs {
            let keys = fields.iter().map(|field| plain(pair.key.get(*field).unwrap_or(&Value::Null)));
            let measures = [
                optional(pair.baseline_ms),
                spread(pair.baseline_spread),
                optional(pair.ms),
                spread(pair.spread),
                optional(pair.ratio),
                pair.problem.clone().unwrap_or_else(|| pair.time.into()),
            ];
            table.row(once(pair.verdict.replace('_', " ")).chain(keys).chain(measures));
        }
        table
    }
}

impl Pair {
    /// A configuration in the baseline and in another report, each with its name.
    fn new(key: &Key, runs: [(char, &RunRecord); 2]) -> Self {
        let wrong = |(name, run): (char, &RunRecord)| {
            let why = run.problem.as_deref().unwrap_or("it has no times");
            (!run.counts()).then(|| format!("{name}: {why}"))
        };
        let problems: Vec<String> = runs.into_iter().filter_map(wrong).collect();
        let [(time, before), (other, after)] = runs.map(|(_, run)| time(run));
        let times = before.zip(after).filter(|_| problems.is_empty() && time == other);
        let verdict = match times {
            _ if !problems.is_empty() => "wrong",
            Some((a, b)) if a.n.min(b.n) >= LEAST && b.max < a.min => "faster",
            Some((a, b)) if a.n.min(b.n) >= LEAST && b.min > a.max => "slower",
            Some((a, b)) if a.n.min(b.n) >= LEAST => "within_spread",
            _ => "undecided",
        };
        let spread = |of: Stats| [of.min, of.max];
        let (before, after) = times.unzip();
        Self {
            key: key.clone(),
            verdict,
            time,
            ratio: times.map(|(a, b)| b.median / a.median),
            baseline_ms: before.map(|s| s.median),
            ms: after.map(|s| s.median),
            baseline_spread: before.map(spread),
            spread: after.map(spread),
            n: [before, after].map(|of| of.map_or(0, |s| s.n)),
            problem: (!problems.is_empty()).then(|| problems.join("; ")),
        }
    }
}

/// The kind of time that a run is judged by, and its statistics: of rounds if it has any, otherwise of frames.
fn time(run: &RunRecord) -> (&'static str, Option<Stats>) {
    let kind = match (run.update_and_draw_ms, run.gpu_ms) {
        (Some(_), _) => "update and draws",
        (None, Some(_)) => "update",
        (None, None) => "round trip",
    };
    (kind, Stats::of(&run.rounds.iter().map(|round| round.ms).collect::<Vec<_>>()).or(run.time()))
}

/// A value of a key, as in tables.
fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.as_f64().map_or_else(|| number.to_string(), count),
        Value::Null => "–".into(),
        other => other.to_string(),
    }
}

/// Differences besides the program: devices, processors, and meshes of the same name.
fn differences(a: &Report, b: &Report, name: char) -> Vec<String> {
    let of_device = |d: &DeviceInfo| {
        [&d.name, &d.driver, &d.driver_info, &d.api_version].map(|part| part.trim()).join(" ").trim_end().to_owned()
    };
    let of_cpu = |d: &DeviceInfo| format!("{}, {} threads", d.cpu, d.threads);
    let of_mesh = |m: &MeshInfo| format!("'{}' of {} vertices and {} targets", m.name, m.vertices, m.targets);
    let meshes = |report: &Report| once(report.input.clone()).chain(report.meshes.clone()).collect::<Vec<_>>();
    let (own, others) = (meshes(a), meshes(b));
    let same = own.iter().filter_map(|mesh| Some((mesh, others.iter().find(|other| other.name == mesh.name)?)));
    let pairs = same.map(|(mesh, other)| ("mesh", of_mesh(mesh), of_mesh(other)));
    let pairs = pairs.chain([
        ("device", of_device(&a.device), of_device(&b.device)),
        ("processor", of_cpu(&a.device), of_cpu(&b.device)),
    ]);
    let told = |(what, a, b)| format!("The {what} differs: {a} in A, {b} in {name}. Ratios compare that as well.");
    pairs.filter(|(_, a, b)| a != b).map(told).collect()
}

#[cfg(test)]
mod tests;
