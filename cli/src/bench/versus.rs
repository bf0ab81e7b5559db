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
use crate::table::{Table, count, listed, optional, percent, sig3};
use serde::Serialize;
use serde_json::{Map, Value};
use std::iter::once;
use std::path::PathBuf;

/// Fields that identify a configuration: words, which tables align left, and numbers.
const WORDS: &str = "suite cell technique mesh path mode format pose accumulate workload shared";
const NUMBERS: &str = "targets batch_size changed heads crowds slots error_budget";
/// Fewest times with a meaningful spread.
const LEAST: usize = 4;

type Key = Map<String, Value>;
/// A run, and the key of its configuration.
type Keyed<'a> = (Key, &'a RunRecord);

/// The JSON of `bench --compare`.
#[derive(Debug, Serialize)]
struct Comparison {
    schema: u32,
    version: &'static str,
    /// "A", "B", … in the order given; the others are compared with the first.
    reports: Vec<Source>,
    /// Differences besides the program.
    warnings: Vec<String>,
    comparisons: Vec<Against>,
}

/// A compared report.
#[derive(Debug, Serialize)]
struct Source {
    name: String,
    file: String,
    version: String,
    created: String,
    command: String,
    device: DeviceInfo,
    input: MeshInfo,
    runs: usize,
}

/// A report, compared with the first.
#[derive(Debug, Serialize)]
struct Against {
    name: String,
    baseline: String,
    faster: usize,
    slower: usize,
    within_spread: usize,
    undecided: usize,
    wrong: usize,
    /// Geometric mean of the ratios.
    ratio_mean: Option<f64>,
    configurations: Vec<Pair>,
    only_in_baseline: Vec<Key>,
    only_here: Vec<Key>,
}

/// A configuration in both reports.
#[derive(Debug, Serialize)]
struct Pair {
    #[serde(flatten)]
    key: Key,
    verdict: Verdict,
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Verdict {
    Faster,
    Slower,
    /// The spreads overlap.
    WithinSpread,
    /// Fewer than [`LEAST`] times.
    Undecided,
    Wrong,
}

impl Verdict {
    /// The verdict in tables: "within spread".
    fn word(self) -> String {
        plain(&serde_json::to_value(self).unwrap_or_default()).replace('_', " ")
    }

    fn of([before, after]: [Stats; 2]) -> Self {
        match before.n.min(after.n) < LEAST {
            true => Self::Undecided,
            false if after.max < before.min => Self::Faster,
            false if after.min > before.max => Self::Slower,
            false => Self::WithinSpread,
        }
    }
}

pub fn run(args: &BenchArgs, out: &Output) -> Result<(), Failure> {
    let read = |path: &PathBuf| Ok((path.display().to_string(), report::read(path)?));
    let reports: Vec<(String, Report)> = args.compare.iter().map(read).collect::<Result<_, Failure>>()?;
    let found = Comparison::new(reports)?;
    out.say(found.text());
    found.warnings.iter().for_each(|warning| out.note(warning));
    out.json(&found)
}

impl Comparison {
    /// Compares the first of `reports`, which come with their files, with each of the others.
    fn new(reports: Vec<(String, Report)>) -> Result<Self, Failure> {
        let names: Vec<String> = (0..reports.len()).map(name).collect();
        let keyed: Vec<Vec<Keyed<'_>>> = reports.iter().map(|(_, report)| keyed(report)).collect();
        let others = || keyed.iter().zip(&names).skip(1);
        let comparisons: Vec<Against> =
            others().map(|(runs, name)| Against::new(&keyed[0], runs, [&names[0], name])).collect();
        if comparisons.iter().all(|found| found.configurations.is_empty()) {
            return Err(Failure::Failed(format!(
                "{} and {}: no configuration is in both{}; measure both with the same INPUT and options",
                reports[0].0,
                reports[1].0,
                difference(&keyed[0], &keyed[1]).map_or(String::new(), |why| format!(" ({why})")),
            )));
        }
        let mut warnings: Vec<String> = vec![];
        for (((file, report), name), found) in reports.iter().zip(&names).skip(1).zip(&comparisons) {
            warnings.extend(differences(&reports[0].1, report, [&names[0], name]));
            if found.configurations.is_empty() {
                warnings.push(format!("{name} ({file}) has no configuration in common with {}.", names[0]));
            }
        }
        let source = |((file, report), name): ((String, Report), String)| {
            let Report { version, created, command, device, input, runs, .. } = report;
            Source { name, file, version, created, command, device, input, runs: runs.len() }
        };
        let reports = reports.into_iter().zip(names).map(source).collect();
        Ok(Self { schema: 1, version: env!("CARGO_PKG_VERSION"), reports, warnings, comparisons })
    }

    fn text(&self) -> String {
        let of = |against: &Against| format!("{}\n\n{}", against.table(), against.summary());
        let reports: Vec<_> = self.reports.iter().map(|source| format!("{}: {}", source.name, source.file)).collect();
        let limits = "Spread: the least and the greatest time of a run. What differed during the whole of one run, such as \
                      another program at work or a warmer processor, counts as a difference of the program's: compare \
                      two runs of one program to learn how far apart they are.";
        once(reports.join("\n"))
            .chain(self.comparisons.iter().map(of))
            .chain([limits.to_owned()])
            .collect::<Vec<_>>()
            .join("\n\n")
    }
}

/// Names of the fields that identify a configuration.
fn names() -> impl Iterator<Item = &'static str> {
    WORDS.split(' ').chain(NUMBERS.split(' '))
}

/// A, B, … Z, A2, B2, …
fn name(i: usize) -> String {
    let letter = char::from(b'A' + (i % 26) as u8);
    if i < 26 { letter.into() } else { format!("{letter}{}", i / 26 + 1) }
}

/// The runs of a report with their keys.
fn keyed(report: &Report) -> Vec<Keyed<'_>> {
    let mut all: Vec<Keyed<'_>> = vec![];
    for run in &report.runs {
        let mut fields = serde_json::to_value(run).unwrap_or_default();
        // Defaults of fields that earlier versions did not have.
        let mut default = |field: &str, value: Value| {
            if fields[field] == "" || fields[field] == 0 {
                fields[field] = value;
            }
        };
        default("mesh", report.input.name.clone().into());
        default("targets", report.input.targets.into());
        default("pose", "float32".into());
        // For clips, a mean over the timed frames: not part of the configuration.
        if run.workload != "random" {
            fields["changed"] = Value::Null;
        }
        let mut key: Key = names().map(|field| (field.into(), fields[field].take())).collect();
        // The same configuration several times in a report: they are paired in order.
        let same = all.iter().filter(|(other, _)| names().all(|field| other[field] == key[field])).count();
        if same > 0 {
            key.insert("occurrence".into(), (same + 1).into());
        }
        all.push((key, run));
    }
    all
}

impl Against {
    fn new(before: &[Keyed<'_>], after: &[Keyed<'_>], [baseline, name]: [&str; 2]) -> Self {
        let other = |key: &Key, runs: &[Keyed<'_>]| runs.iter().position(|(other, _)| other == key);
        let pair = |(key, run): &Keyed<'_>| {
            let (_, other) = after[other(key, after)?];
            Some(Pair::new(key.clone(), [(baseline, run), (name, other)]))
        };
        let pairs: Vec<Pair> = before.iter().filter_map(pair).collect();
        let count = |verdict: Verdict| pairs.iter().filter(|pair| pair.verdict == verdict).count();
        let only = |own: &[Keyed<'_>], others: &[Keyed<'_>]| {
            own.iter().filter(|(key, _)| other(key, others).is_none()).map(|(key, _)| key.clone()).collect()
        };
        let logs: Vec<f64> = pairs.iter().filter_map(|pair| Some(pair.ratio?.ln())).collect();
        Self {
            name: name.into(),
            baseline: baseline.into(),
            faster: count(Verdict::Faster),
            slower: count(Verdict::Slower),
            within_spread: count(Verdict::WithinSpread),
            undecided: count(Verdict::Undecided),
            wrong: count(Verdict::Wrong),
            ratio_mean: Stats::of(&logs).map(|s| s.mean.exp()),
            only_in_baseline: only(before, after),
            only_here: only(after, before),
            configurations: pairs,
        }
    }

    /// "B against A: of 120 configurations in both 3 are faster, …".
    fn summary(&self) -> String {
        let Self { name, baseline, faster, slower, within_spread, .. } = self;
        let mut text = format!(
            "{name} against {baseline}: of {} configurations in both {faster} are faster, {slower} slower, \
             {within_spread} within the spread",
            self.configurations.len()
        );
        for (count, what) in [
            (self.undecided, "timed too briefly to tell".into()),
            (self.wrong, "wrong".into()),
            (self.only_in_baseline.len(), format!("only in {baseline}")),
            (self.only_here.len(), format!("only in {name}")),
        ] {
            if count > 0 {
                text += &format!(", {count} {what}");
            }
        }
        if let Some(mean) = self.ratio_mean {
            let less_or_more = if mean < 1.0 { "less" } else { "more" };
            let change = percent((mean - 1.0).abs());
            text += &format!(". On geometric average {name} takes {change} {less_or_more} time");
        }
        text + "."
    }

    /// A row for each configuration; fields that are the same in all are left out.
    fn table(&self) -> Table {
        let pairs = &self.configurations;
        let differs = |field: &&str| {
            let mut values = pairs.iter().map(|pair| pair.key.get(*field));
            let first = values.next();
            values.any(|value| Some(value) != first)
        };
        let fields: Vec<&str> = names().chain(["occurrence"]).filter(differs).collect();
        let words = fields.iter().filter(|field| WORDS.split(' ').any(|word| word == **field)).count();
        let own = |what: &str| [&self.baseline, &self.name].map(|name| format!("{name} {what}"));
        let ([ms_a, ms_b], [spread_a, spread_b]) = (own("ms"), own("spread"));
        let (ratio, first) = (format!("{} / {}", self.name, self.baseline), format!("{} is", self.name));
        let headings: Vec<&str> = once(first.as_str())
            .chain(fields.iter().copied())
            .chain([&ms_a, &spread_a, &ms_b, &spread_b, &ratio].map(String::as_str))
            .chain(["time of"])
            .collect();
        let mut table = Table::new(&headings, 1 + words);
        for pair in pairs {
            let keys = fields.iter().map(|field| plain(pair.key.get(*field).unwrap_or(&Value::Null)));
            let spread = |of: Option<[f64; 2]>| of.map_or("–".into(), |of| of.map(sig3).join("–"));
            let measures = [
                optional(pair.baseline_ms),
                spread(pair.baseline_spread),
                optional(pair.ms),
                spread(pair.spread),
                optional(pair.ratio),
                pair.problem.clone().unwrap_or_else(|| pair.time.into()),
            ];
            table.row(once(pair.verdict.word()).chain(keys).chain(measures));
        }
        table
    }
}

impl Pair {
    /// A configuration in the baseline and in another report, each with its name.
    fn new(key: Key, runs: [(&str, &RunRecord); 2]) -> Self {
        let wrong = |(name, run): (&str, &RunRecord)| {
            let why = run.problem.as_deref().unwrap_or("it has no times");
            (!run.counts()).then(|| format!("{name}: {why}"))
        };
        let problems: Vec<String> = runs.into_iter().filter_map(wrong).collect();
        let (time, times) = times(runs.map(|(_, run)| run));
        let times = times.filter(|_| problems.is_empty());
        let stats = |i: usize| times.map(|times| times[i]);
        let [before, after] = [stats(0), stats(1)];
        Self {
            key,
            verdict: if problems.is_empty() { times.map_or(Verdict::Undecided, Verdict::of) } else { Verdict::Wrong },
            time,
            ratio: times.map(|[before, after]| after.median / before.median),
            baseline_ms: before.map(|s| s.median),
            ms: after.map(|s| s.median),
            baseline_spread: before.map(|s| [s.min, s.max]),
            spread: after.map(|s| [s.min, s.max]),
            n: [before, after].map(|of| of.map_or(0, |s| s.n)),
            problem: (!problems.is_empty()).then(|| problems.join("; ")),
        }
    }
}

/// The first time in order of preference that both runs have; of rounds if both have them.
fn times(runs: [&RunRecord; 2]) -> (&'static str, Option<[Stats; 2]>) {
    type Time = fn(&RunRecord) -> Option<Stats>;
    let all: [(&str, Time); 3] = [
        ("update and draws", |run| run.update_and_draw_ms),
        ("update", |run| run.gpu_ms),
        ("round trip", |run| run.cpu_ms),
    ];
    let both = |of: &dyn Fn(&RunRecord) -> Option<Stats>| Some([of(runs[0])?, of(runs[1])?]);
    let had = all.into_iter().find_map(|(name, of)| Some((name, both(&of)?)));
    let Some((name, frames)) = had else { return ("round trip", None) };
    let rounds = both(&|run| Stats::of(&run.rounds.iter().map(|round| round.ms).collect::<Vec<_>>()));
    // Rounds hold each run's preferred time, which the other run may lack.
    let judged = runs.map(RunRecord::time) == frames.map(Some);
    (name, Some(rounds.filter(|_| judged).unwrap_or(frames)))
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

/// A field without a value in common, for reports that share no configuration.
fn difference(a: &[Keyed<'_>], b: &[Keyed<'_>]) -> Option<String> {
    let values = |runs: &[Keyed<'_>], field: &str| {
        let mut values: Vec<String> = runs.iter().map(|(key, _)| plain(&key[field])).collect();
        values.sort();
        values.dedup();
        values
    };
    let field = names().find(|field| {
        let (a, b) = (values(a, field), values(b, field));
        !a.is_empty() && !b.is_empty() && a.iter().all(|value| !b.contains(value))
    })?;
    let [a, b] = [a, b].map(|runs| listed(values(runs, field).into_iter().take(4)));
    Some(format!("{field}: {a} in the one, {b} in the other"))
}

/// Differences besides the program.
fn differences(a: &Report, b: &Report, [first, second]: [&str; 2]) -> Vec<String> {
    let device =
        |d: &DeviceInfo| [&d.name, &d.driver, &d.driver_info, &d.api_version].map(|part| part.trim()).join(" ");
    let cpu = |d: &DeviceInfo| format!("{}, {} threads", d.cpu, d.threads);
    let size = |m: &MeshInfo| {
        let MeshInfo { vertices, targets, triangles, diagonal, tolerance, .. } = m;
        let moved = percent(m.moved_mean);
        format!(
            "{vertices} vertices, {triangles} triangles, {targets} targets, each moving {moved}, diagonal {diagonal}, \
             tolerance {tolerance}"
        )
    };
    let mut pairs = vec![
        ("device".to_owned(), device(&a.device), device(&b.device)),
        ("processor".to_owned(), cpu(&a.device), cpu(&b.device)),
    ];
    let meshes =
        |report: &Report| if report.meshes.is_empty() { vec![report.input.clone()] } else { report.meshes.clone() };
    let others = meshes(b);
    for mesh in meshes(a) {
        let other = others.iter().find(|other| other.name == mesh.name);
        pairs.extend(other.map(|other| (format!("mesh '{}'", mesh.name), size(&mesh), size(other))));
    }
    pairs.retain(|(_, a, b)| a != b);
    let told = |(what, a, b): (String, String, String)| {
        format!("The {what} differs: {} in {first}, {} in {second}. Ratios compare that as well.", a.trim(), b.trim())
    };
    pairs.into_iter().map(told).collect()
}

#[cfg(test)]
mod tests;
