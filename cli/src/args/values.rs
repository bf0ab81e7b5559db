//! Values of the command line: their ranges and their spelling.

use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use deltamorph::{BatchSize, UpdateMode, UpdatePath};
use deltamorph_headless::DeviceChoice;
use std::collections::BTreeSet;

/// Largest number of targets of the built-in head.
pub const MAX_TARGETS: usize = 65_536;

/// A choice among the library's values, spelled as in the library, each with a line of help.
pub fn named<T: Copy + Send + Sync + 'static>(
    all: &'static [T],
    name: fn(T) -> &'static str,
    help: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.iter().map(|&one| PossibleValue::new(name(one)).help(help(one))))
        .try_map(move |given| all.iter().copied().find(|one| name(*one) == given).ok_or("no such value"))
}

/// How the command line spells a value.
pub fn name(value: impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

pub fn mode() -> impl TypedValueParser<Value = UpdateMode> {
    named(&[UpdateMode::Incremental, UpdateMode::Rebuild], UpdateMode::name, |mode| match mode {
        UpdateMode::Incremental => "Update the current pose with the changed targets",
        UpdateMode::Rebuild => "Evaluate all active targets from the base pose",
    })
}

/// An error budget as the command line states it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BudgetSpec {
    /// A length in input units.
    Length(f32),
    /// A fraction of the diagonal.
    Diagonal(f32),
}

/// An entry of `--batch-sizes`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BatchSpec {
    /// This many targets per pass.
    Size(u32),
    /// Every size from the first to the last, both included; `None` is the largest that the path allows.
    Range(u32, Option<u32>),
    /// The largest size that the path allows.
    Max,
    /// Every target in one pass.
    All,
}

/// A whole number within bounds, or a sentence that states the bounds.
pub fn whole<T>(lo: T, hi: T) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: std::str::FromStr + PartialOrd + std::fmt::Display + Copy + Send + Sync + 'static,
{
    move |s| {
        let parsed = s.trim().parse().ok().filter(|v| (lo..=hi).contains(v));
        parsed.ok_or_else(|| format!("give a whole number from {lo} to {hi}"))
    }
}

/// A finite number that `fits`, or a sentence that names the requirement `what`.
pub fn number(
    what: &'static str,
    fits: fn(f32) -> bool,
) -> impl Fn(&str) -> Result<f32, String> + Clone + Send + Sync + 'static {
    move |s| {
        let parsed = s.trim().parse::<f32>().ok().filter(|v| v.is_finite() && fits(*v));
        parsed.ok_or_else(|| format!("give {what}"))
    }
}

pub fn positive(s: &str) -> Result<f32, String> {
    number("a number above 0", |v| v > 0.0)(s)
}

pub fn zoom(s: &str) -> Result<f32, String> {
    number("a number from 0.2 to 20", |v| (0.2..=20.0).contains(&v))(s)
}

pub fn fps(s: &str) -> Result<f32, String> {
    number("a number of frames per second from 0.1 to 1000", |v| (0.1..=1000.0).contains(&v))(s)
}

pub fn device(s: &str) -> Result<DeviceChoice, String> {
    match s.trim() {
        "" => Err("give an index or a part of the name, as `deltamorph devices` lists them".into()),
        s => Ok(s.parse().map_or_else(|_| DeviceChoice::Name(s.into()), DeviceChoice::Index)),
    }
}

pub fn block_size(s: &str) -> Result<u32, &'static str> {
    s.trim().parse().ok().filter(|size| matches!(size, 32 | 64 | 128)).ok_or("give 32, 64 or 128")
}

pub fn budget(s: &str) -> Result<BudgetSpec, String> {
    let length = number("a length in input units, or a number with \"d\" (of the diagonal)", |v| v >= 0.0);
    match s.trim().strip_suffix('d') {
        Some(s) => length(s).map(BudgetSpec::Diagonal),
        None => length(s).map(BudgetSpec::Length),
    }
}

/// Parse an entry of `--batch-sizes`. Ranges include both ends: "1..7" are the seven sizes of Jones (GPU Pro 5).
pub fn batch(s: &str) -> Result<BatchSpec, String> {
    let size = |s: &str| whole(1, 65_536)(s).map_err(|e| format!("{e}, \"max\", \"all\" or a range as \"1..7\""));
    match (s.trim(), s.split_once("..")) {
        ("all", _) => Ok(BatchSpec::All),
        ("max", _) => Ok(BatchSpec::Max),
        (s, None) => size(s).map(BatchSpec::Size),
        (_, Some((lo, hi))) => match (size(lo)?, hi.trim()) {
            (lo, "max") => Ok(BatchSpec::Range(lo, None)),
            (lo, hi) => match size(hi)? {
                hi if hi < lo => Err(format!("the range runs backwards; write {hi}..{lo}")),
                hi => Ok(BatchSpec::Range(lo, Some(hi))),
            },
        },
    }
}

/// Parse `--batch-size`: one size, no range.
pub fn one_batch(s: &str) -> Result<BatchSpec, String> {
    match batch(s)? {
        BatchSpec::Range(..) => Err("give one size, not a range".into()),
        one => Ok(one),
    }
}

/// Parse an entry of `--changed`: a number of targets; `None` is all of them.
pub fn changed(s: &str) -> Result<Option<usize>, String> {
    match s.trim() {
        "all" => Ok(None),
        s => whole(0, MAX_TARGETS)(s).map(Some).map_err(|e| format!("{e}, or \"all\"")),
    }
}

/// Parse `--set`: settings with commas between them. Names may have commas, too, so one ends a setting only where that
/// has a weight. Blanks before the first one may be part of its name.
pub fn settings(s: &str) -> Result<Vec<(String, f32)>, String> {
    let mut all = vec![];
    let mut from = 0;
    for end in s.match_indices(',').map(|(at, _)| at).chain([s.len()]) {
        let one = &s[from..end];
        match setting(if from > 0 { one.trim_start() } else { one }) {
            Ok(one) => {
                all.push(one);
                from = end + 1;
            }
            Err(why) if end == s.len() => return Err(why),
            Err(_) => {}
        }
    }
    Ok(all)
}

/// The last "=" divides: names may have one.
fn setting(s: &str) -> Result<(String, f32), String> {
    let (name, weight) = s.rsplit_once('=').ok_or("write NAME=WEIGHT, as in jawOpen=0.5")?;
    if name.is_empty() {
        return Err("the name before \"=\" is missing; write NAME=WEIGHT, as in jawOpen=0.5".into());
    }
    Ok((name.to_owned(), number("a finite weight after \"=\", as in jawOpen=0.5", |_| true)(weight)?))
}

/// The batch sizes that `specs` request and `path` allows with at most `max` targets per pass, ascending, without
/// repeats; and those that it does not allow. A path without batches, with a `max` of 0, runs once, as "all".
pub fn expand_batches(specs: &[BatchSpec], path: UpdatePath, max: u32) -> (Vec<BatchSize>, Vec<BatchSize>) {
    if max == 0 {
        return (vec![BatchSize::All], Vec::new());
    }
    let ranges = specs.iter().map(|&spec| match spec {
        BatchSpec::Size(n) => n..=n,
        BatchSpec::Range(lo, hi) => lo..=hi.unwrap_or(max),
        BatchSpec::Max => max..=max,
        BatchSpec::All => 0..=0,
    });
    let sizes: BTreeSet<_> =
        ranges.flatten().map(|n| if n == 0 { BatchSize::All } else { BatchSize::Targets(n) }).collect();
    sizes.into_iter().partition(|s| match s {
        BatchSize::Targets(n) => *n <= max,
        BatchSize::All => path.takes_all_targets(),
    })
}

/// The numbers of changed targets that entries of `--changed` request on a mesh with `targets`, ascending, without
/// repeats. Without entries: a few sizes that the mesh has, and all.
pub fn expand_changed(entries: &[Option<usize>], targets: usize) -> Result<Vec<usize>, String> {
    if entries.is_empty() {
        return Ok([1, 4, 8, 16, 32].into_iter().filter(|n| *n < targets).chain([targets]).collect());
    }
    let counts: BTreeSet<usize> = entries.iter().map(|entry| entry.unwrap_or(targets)).collect();
    match counts.last() {
        Some(n) if *n > targets => {
            Err(format!("--changed {n}: the mesh has {targets} targets; give at most that, or \"all\""))
        }
        _ => Ok(counts.into_iter().collect()),
    }
}
