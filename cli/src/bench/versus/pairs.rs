//! Configurations that are in two reports, and how their times compare.

use super::significance::{ALPHA, Ratio, by_errors, by_ranks, holm};
use crate::bench::record::{Report, RunRecord};
use crate::bench::stats::Stats;
use serde::Serialize;
use serde_json::{Map, Value};

/// The fields of a run that say which configuration it is.
pub const KEY: [&str; 18] = [
    "suite",
    "cell",
    "technique",
    "mesh",
    "path",
    "mode",
    "format",
    "pose",
    "accumulate",
    "workload",
    "shared",
    "targets",
    "batch_size",
    "changed",
    "heads",
    "crowds",
    "slots",
    "error_budget",
];

/// Which configuration it is.
pub type Key = Map<String, Value>;
/// A run, with which configuration it is.
pub type Keyed<'a> = (Key, &'a RunRecord);

/// A report against the first.
#[derive(Debug, Serialize)]
pub struct Against {
    pub name: String,
    pub baseline: String,
    pub faster: usize,
    pub slower: usize,
    /// Not significantly different.
    pub not_significant: usize,
    /// Timed too briefly to tell.
    pub undecided: usize,
    pub wrong: usize,
    /// Geometric mean of the ratios.
    pub ratio_mean: Option<f64>,
    pub configurations: Vec<Pair>,
    pub only_in_baseline: Vec<Map<String, Value>>,
    pub only_here: Vec<Map<String, Value>>,
}

/// A configuration that is in both.
#[derive(Debug, Serialize)]
pub struct Pair {
    #[serde(flatten)]
    pub key: Map<String, Value>,
    pub verdict: Verdict,
    /// "update", "update and draws", or "round trip".
    pub time: &'static str,
    /// Medians, and how many values they are of: rounds, or else frames.
    pub baseline_ms: Option<f64>,
    pub ms: Option<f64>,
    pub n: [usize; 2],
    /// Time over that of the baseline.
    pub ratio: Option<f64>,
    /// The 95% confidence interval of the ratio.
    pub low: Option<f64>,
    pub high: Option<f64>,
    pub p: Option<f64>,
    /// `p`, corrected for the number of configurations.
    pub p_corrected: Option<f64>,
    /// "ranks" (of rounds), or "standard errors".
    pub test: Option<&'static str>,
    /// What was wrong, and in which report.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    Faster,
    Slower,
    NotSignificant,
    Undecided,
    Wrong,
}

impl Verdict {
    pub fn word(self) -> &'static str {
        match self {
            Self::Faster => "faster",
            Self::Slower => "slower",
            Self::NotSignificant => "not significant",
            Self::Undecided => "undecided",
            Self::Wrong => "wrong",
        }
    }
}

/// The runs of a report with what tells them apart.
pub fn keyed(report: &Report) -> Vec<Keyed<'_>> {
    let mut all: Vec<Keyed<'_>> = vec![];
    for run in &report.runs {
        let mut fields = serde_json::to_value(run).unwrap_or_default();
        // Reports of versions that did not have them.
        let mut default = |field: &str, value: Value| {
            if fields[field] == "" || fields[field] == 0 {
                fields[field] = value;
            }
        };
        default("mesh", report.input.name.clone().into());
        default("targets", report.input.targets.into());
        default("pose", "float32".into());
        // Of a clip a mean over the frames that were timed: what changes is what the clip says.
        if run.workload != "random" {
            fields["changed"] = Value::Null;
        }
        let mut key: Key = KEY.iter().map(|field| ((*field).into(), fields[*field].take())).collect();
        // The same work twice in a report: the first is compared with the first.
        let same = all.iter().filter(|(other, _)| KEY.iter().all(|field| other[*field] == key[*field])).count();
        if same > 0 {
            key.insert("occurrence".into(), (same + 1).into());
        }
        all.push((key, run));
    }
    all
}

impl Against {
    pub fn new(before: &[Keyed<'_>], after: &[Keyed<'_>], [baseline, name]: [&str; 2]) -> Self {
        let other = |key: &Key, runs: &[Keyed<'_>]| runs.iter().position(|(other, _)| other == key);
        let pair = |(key, run): &Keyed<'_>| {
            let (_, other) = after[other(key, after)?];
            Some(Pair::new(key.clone(), [(baseline, run), (name, other)]))
        };
        let mut pairs: Vec<Pair> = before.iter().filter_map(pair).collect();
        let told: Vec<f64> = pairs.iter().filter_map(|pair| pair.p).collect();
        let mut corrected = holm(&told).into_iter();
        for pair in pairs.iter_mut().filter(|pair| pair.p.is_some()) {
            pair.p_corrected = corrected.next();
            pair.verdict = match (pair.p_corrected, pair.ratio) {
                (Some(p), Some(ratio)) if p < ALPHA && ratio < 1.0 => Verdict::Faster,
                (Some(p), Some(ratio)) if p < ALPHA && ratio > 1.0 => Verdict::Slower,
                _ => Verdict::NotSignificant,
            };
        }
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
            not_significant: count(Verdict::NotSignificant),
            undecided: count(Verdict::Undecided),
            wrong: count(Verdict::Wrong),
            ratio_mean: Stats::of(&logs).map(|s| s.mean.exp()),
            only_in_baseline: only(before, after),
            only_here: only(after, before),
            configurations: pairs,
        }
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
        let [a, b] = runs.map(|(_, run)| run);
        let (time, times) = both(a, b);
        let samples = [a, b].map(|run| run.rounds.iter().map(|round| round.ms).collect::<Vec<_>>());
        // Rounds have the time that a run is judged by: not one that only the other has.
        let judged = [a, b].map(RunRecord::time) == times;
        let ranks = by_ranks(&samples[0], &samples[1]).filter(|_| judged);
        let errors = || times[0].zip(times[1]).and_then(|(a, b)| by_errors(a, b));
        let found = ranks.map(|found| (found, "ranks")).or_else(|| Some((errors()?, "standard errors")));
        let found = found.filter(|_| problems.is_empty());
        let [of_ranks, of_frames] =
            [samples.map(|ms| Stats::of(&ms)), times].map(|stats| stats.map(|s| s.filter(|_| problems.is_empty())));
        let of = if ranks.is_some() { of_ranks } else { of_frames };
        let [baseline_ms, ms] = of.map(|stats| stats.map(|s| s.median));
        let test = found.map(|(_, test)| test);
        let value = |of: fn(&Ratio) -> f64| found.as_ref().map(|(ratio, _)| of(ratio));
        Self {
            key,
            verdict: if problems.is_empty() { Verdict::Undecided } else { Verdict::Wrong },
            time,
            ratio: baseline_ms.zip(ms).map(|(a, b)| b / a),
            baseline_ms,
            ms,
            n: of.map(|stats| stats.map_or(0, |s| s.n)),
            low: value(|r| r.low),
            high: value(|r| r.high),
            p: value(|r| r.p),
            p_corrected: None,
            test,
            problem: (!problems.is_empty()).then(|| problems.join("; ")),
        }
    }
}

/// The time that both have, in the order in which runs are judged by them.
fn both(a: &RunRecord, b: &RunRecord) -> (&'static str, [Option<Stats>; 2]) {
    type Time = fn(&RunRecord) -> Option<Stats>;
    let times: [(&str, Time); 3] = [
        ("update and draws", |run| run.update_and_draw_ms),
        ("update", |run| run.gpu_ms),
        ("round trip", |run| run.cpu_ms),
    ];
    let had = times.into_iter().map(|(name, of)| (name, [of(a), of(b)]));
    had.into_iter().find(|(_, both)| both.iter().all(Option::is_some)).unwrap_or(("round trip", [None, None]))
}

/// A value of a key as tables have it.
pub fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => "–".into(),
        other => other.to_string(),
    }
}
