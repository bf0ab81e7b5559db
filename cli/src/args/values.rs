//! Values of the command line: what they may be, and how they are spelled.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use deltamorph::headless::DeviceChoice;
use deltamorph::{Accumulate, BatchSize, DeltaFormat, UpdateMode, UpdatePath};

/// Largest built-in head. A number beyond it is a slip of the finger, and would take all memory.
const MAX_VERTICES: usize = 10_000_000;
/// Largest number of targets of the built-in head.
const MAX_TARGETS: usize = 65_536;
/// Largest number of slots: each is a whole pose per head.
const MAX_SLOTS: u32 = 64;

/// Float and exact, as `--accumulate` lists them.
pub const SUMS: [Accumulate; 2] = [Accumulate::Float { tolerance: 0.0 }, Accumulate::Exact];

/// A choice of what the library has, spelled as the library spells it, each with a line of help.
fn named<T: Copy + Send + Sync + 'static>(
    all: &'static [T],
    name: fn(T) -> &'static str,
    help: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.iter().map(|&one| PossibleValue::new(name(one)).help(help(one))))
        .try_map(move |given| all.iter().copied().find(|one| name(*one) == given).ok_or("no such value"))
}

pub fn path() -> impl TypedValueParser<Value = UpdatePath> {
    named(&UpdatePath::ALL, UpdatePath::name, UpdatePath::summary)
}

pub fn mode() -> impl TypedValueParser<Value = UpdateMode> {
    named(&[UpdateMode::Incremental, UpdateMode::Rebuild], UpdateMode::name, |mode| match mode {
        UpdateMode::Incremental => "From the pose in the buffer, applying the changed targets",
        UpdateMode::Rebuild => "From the base pose, applying all active targets",
    })
}

pub fn format() -> impl TypedValueParser<Value = DeltaFormat> {
    named(&DeltaFormat::ALL, DeltaFormat::name, DeltaFormat::summary)
}

pub fn sums() -> impl TypedValueParser<Value = Accumulate> {
    named(&SUMS, Accumulate::name, |sums| match sums {
        Accumulate::Float { .. } => "float32 sums, with a bound that is kept",
        Accumulate::Exact => "Integer sums, equal to a full evaluation bit for bit (formats fast and small)",
    })
}

/// `format` on `path`, where float32 may mean that of blocks; `None` where the path does not take it.
pub fn format_on(path: UpdatePath, format: DeltaFormat) -> Option<DeltaFormat> {
    let of_blocks = (path, format) == (UpdatePath::Blocks, DeltaFormat::Float32);
    let format = if of_blocks { DeltaFormat::BlockFloat32 } else { format };
    path.formats().contains(&format).then_some(format)
}

/// An error budget as the command line states it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BudgetSpec {
    /// A length in input units.
    Length(f32),
    /// A fraction of the bounding-box diagonal.
    Diagonal(f32),
    /// Pixels, through the projection given beside it.
    Pixels(f32),
}

/// A perspective camera, as far as it turns pixels into lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Vertical angle of view in degrees.
    pub fov_degrees: f32,
    /// Height of the picture in pixels.
    pub height: f32,
    /// Distance to the face in input units.
    pub distance: f32,
}

impl Projection {
    /// The length that one pixel shows at the distance of the face.
    pub fn pixel(&self) -> f32 {
        2.0 * self.distance * (self.fov_degrees.to_radians() / 2.0).tan() / self.height
    }
}

/// An entry of `--batch-sizes`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BatchSpec {
    /// This many targets per pass.
    Size(u32),
    /// Every size from the first to the last, both included; `None` is the largest that the path allows.
    Range(u32, Option<u32>),
    /// The largest that the path allows.
    Max,
    /// Every target in one pass.
    All,
}

/// An entry of `--changed`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangedSpec {
    /// This many targets per frame.
    Count(usize),
    /// Every target.
    All,
}

/// An entry of `--set`.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightSetting {
    pub name: String,
    pub weight: f32,
}

/// A whole number within bounds, or a sentence that says which.
fn whole<T>(s: &str, lo: T, hi: T) -> Result<T, String>
where
    T: std::str::FromStr + PartialOrd + std::fmt::Display,
{
    let complaint = || format!("give a whole number from {lo} to {hi}");
    s.trim().parse().ok().filter(|v| (&lo..=&hi).contains(&v)).ok_or_else(complaint)
}

/// A finite number that `fits`, or a sentence that says what would.
fn number(s: &str, fits: impl Fn(f32) -> bool, what: &str) -> Result<f32, String> {
    let parsed = s.trim().parse::<f32>().ok().filter(|v| v.is_finite() && fits(*v));
    parsed.ok_or_else(|| format!("give {what}"))
}

pub fn device(s: &str) -> Result<DeviceChoice, String> {
    match s.trim() {
        "" => Err("give an index or a part of the name, as `deltamorph devices` lists them".into()),
        s => Ok(s.parse().map_or_else(|_| DeviceChoice::Name(s.into()), DeviceChoice::Index)),
    }
}

pub fn vertices(s: &str) -> Result<usize, String> {
    whole(s, 1, MAX_VERTICES)
}

pub fn targets(s: &str) -> Result<usize, String> {
    whole(s, 0, MAX_TARGETS)
}

pub fn slots(s: &str) -> Result<u32, String> {
    whole(s, 1, MAX_SLOTS)
}

pub fn heads(s: &str) -> Result<u32, String> {
    whole(s, 1, 1_000_000)
}

/// Parse a count that can't be 0.
pub fn at_least_one(s: &str) -> Result<usize, String> {
    whole(s, 1, 1_000_000)
}

pub fn warmup(s: &str) -> Result<usize, String> {
    whole(s, 0, 1_000_000)
}

/// Parse the frames of `soak`.
pub fn frames(s: &str) -> Result<usize, String> {
    whole(s, 1, 1_000_000_000)
}

pub fn sparsity(s: &str) -> Result<f32, String> {
    number(s, |v| v > 0.0 && v <= 1.0, "a fraction above 0 and at most 1")
}

pub fn tolerance(s: &str) -> Result<f32, String> {
    number(s, |v| v >= 0.0, "a fraction of the diagonal, 0 or more (0 keeps every delta)")
}

/// Parse a number above 0.
pub fn positive(s: &str) -> Result<f32, String> {
    number(s, |v| v > 0.0, "a number above 0")
}

pub fn seconds(s: &str) -> Result<f32, String> {
    number(s, |v| v > 0.0 && v <= 86_400.0, "a number of seconds above 0, at most a day")
}

pub fn block_size(s: &str) -> Result<u32, String> {
    match s.trim() {
        "32" => Ok(32),
        "64" => Ok(64),
        "128" => Ok(128),
        _ => Err("give 32, 64 or 128".into()),
    }
}

pub fn budget(s: &str) -> Result<BudgetSpec, String> {
    let what =
        "a length in input units, or a number with \"d\" (of the diagonal) or \"px\" (pixels, with --projection)";
    let s = s.trim();
    let value = |s: &str| number(s, |v| v >= 0.0, what);
    match (s.strip_suffix("px"), s.strip_suffix('d')) {
        (Some(s), _) => value(s).map(BudgetSpec::Pixels),
        (_, Some(s)) => value(s).map(BudgetSpec::Diagonal),
        _ => value(s).map(BudgetSpec::Length),
    }
}

pub fn projection(s: &str) -> Result<Projection, String> {
    let numbers: Vec<f32> = s.split(',').map(positive).collect::<Result<_, _>>()?;
    match numbers[..] {
        [fov_degrees, height, distance] if fov_degrees < 180.0 => Ok(Projection { fov_degrees, height, distance }),
        _ => {
            Err("give three numbers: degrees of view from bottom to top, pixels of height, distance in input units"
                .into())
        }
    }
}

pub fn fps(s: &str) -> Result<f32, String> {
    number(s, |v| (0.1..=1000.0).contains(&v), "a number of frames per second from 0.1 to 1000")
}

pub fn threads(s: &str) -> Result<usize, String> {
    whole(s, 1, 256)
}

/// Parse an entry of `--batch-sizes`. Ranges include both ends: "1..7" are the seven sizes of the chapter.
pub fn batch(s: &str) -> Result<BatchSpec, String> {
    let size =
        |s: &str| whole::<u32>(s, 1, 65_536).map_err(|e| format!("{e}, \"max\", \"all\" or a range as \"1..7\""));
    match s.trim() {
        "all" => Ok(BatchSpec::All),
        "max" => Ok(BatchSpec::Max),
        s => match s.split_once("..") {
            None => size(s).map(BatchSpec::Size),
            Some((lo, hi)) => {
                let lo = size(lo)?;
                match hi.strip_prefix('=').unwrap_or(hi).trim() {
                    "max" => Ok(BatchSpec::Range(lo, None)),
                    hi => match size(hi)? {
                        hi if hi < lo => Err(format!("the range runs backwards; write {hi}..{lo}")),
                        hi => Ok(BatchSpec::Range(lo, Some(hi))),
                    },
                }
            }
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

pub fn changed(s: &str) -> Result<ChangedSpec, String> {
    match s.trim() {
        "all" => Ok(ChangedSpec::All),
        s => whole(s, 0, MAX_TARGETS).map(ChangedSpec::Count).map_err(|e| format!("{e}, or \"all\"")),
    }
}

/// Parse an entry of `--set`. The last "=" divides: names may have one.
pub fn setting(s: &str) -> Result<WeightSetting, String> {
    let (name, weight) = s.rsplit_once('=').ok_or("write NAME=WEIGHT, as in jawOpen=0.5")?;
    if name.trim().is_empty() {
        return Err("the name before \"=\" is missing; write NAME=WEIGHT, as in jawOpen=0.5".into());
    }
    let weight = number(weight, |_| true, "a finite weight after \"=\", as in jawOpen=0.5")?;
    Ok(WeightSetting { name: name.trim().into(), weight })
}

/// What an update path can batch on a device.
#[derive(Clone, Copy, Debug)]
pub struct BatchLimit {
    /// Largest number of targets per pass; 0: the path has no batches.
    pub max: u32,
    /// Can take every target in one pass.
    pub all: bool,
}

/// The batch sizes that `specs` ask for and `limit` allows, ascending, without repeats; and those that it
/// does not allow. A path without batches runs once, as "all", whatever sizes are asked for.
pub fn expand_batches(specs: &[BatchSpec], limit: BatchLimit) -> (Vec<BatchSize>, Vec<BatchSize>) {
    if limit.max == 0 {
        return (vec![BatchSize::All], Vec::new());
    }
    let mut sizes: Vec<BatchSize> = specs
        .iter()
        .flat_map(|&spec| match spec {
            BatchSpec::Size(n) => n..=n,
            BatchSpec::Range(lo, hi) => lo..=hi.unwrap_or(limit.max),
            BatchSpec::Max => limit.max..=limit.max,
            BatchSpec::All => 0..=0,
        })
        .map(|n| if n == 0 { BatchSize::All } else { BatchSize::Targets(n) })
        .collect();
    sizes.sort_unstable();
    sizes.dedup();
    sizes.into_iter().partition(|s| match s {
        BatchSize::Targets(n) => *n <= limit.max,
        BatchSize::All => limit.all,
    })
}

/// The numbers of changed targets that `specs` ask for on a mesh with `targets`, ascending, without repeats.
/// No specs: a few sizes that the mesh has, and all.
pub fn expand_changed(specs: &[ChangedSpec], targets: usize) -> Result<Vec<usize>, String> {
    if specs.is_empty() {
        return Ok([1, 4, 8, 16, 32].into_iter().filter(|n| *n < targets).chain([targets]).collect());
    }
    let mut counts = Vec::new();
    for &spec in specs {
        counts.push(match spec {
            ChangedSpec::All => targets,
            ChangedSpec::Count(n) if n <= targets => n,
            ChangedSpec::Count(n) => {
                return Err(format!("--changed {n}: the mesh has {targets} targets; give at most that, or \"all\""));
            }
        });
    }
    counts.sort_unstable();
    counts.dedup();
    Ok(counts)
}
