//! A run in the JSON. Fields may be added, never renamed.

use super::stats::Stats;
use deltamorph::BatchSize;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// One configuration and what it took.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct RunRecord {
    /// The suite that it belongs to; empty in an ordinary run.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub suite: String,
    /// What it competes in there.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub cell: String,
    /// Its name there.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub technique: String,
    #[serde(default)]
    pub mesh: String,
    #[serde(default)]
    pub targets: usize,
    pub path: String,
    /// "incremental" or "rebuild".
    pub mode: String,
    /// Targets per pass: a number, or "all".
    #[serde(serialize_with = "write_batch", deserialize_with = "read_batch")]
    pub batch_size: BatchSize,
    /// The largest batch that this path and format allow on this device.
    pub batch_max: Option<u32>,
    /// "random", or the clip that was replayed.
    pub workload: String,
    /// Targets whose weight changed, per frame and head: counted (a mean, for clips).
    #[serde(serialize_with = "whole")]
    pub changed: f64,
    /// Coefficients applied per frame and head: with two slots, the union of two frames' changes.
    #[serde(serialize_with = "whole")]
    pub coefficients: f64,
    /// Targets with a weight other than 0, per frame and head.
    #[serde(serialize_with = "whole")]
    pub active: f64,
    pub heads: u32,
    /// One animation, drawn many times.
    pub shared: bool,
    /// Crowds that the heads are divided into; all are updated in one submission.
    #[serde(default = "one")]
    pub crowds: u32,
    /// It was measured after the others, for lack of room beside them: its ratios are of medians, not of rounds.
    #[serde(default)]
    pub alone: bool,
    /// "float" or "exact".
    pub accumulate: String,
    /// Changes too small to move a vertex this far waited; in input units, 0 where none did.
    #[serde(default)]
    pub error_budget: f32,
    /// Blocks written per frame and head (block formats).
    #[serde(default, serialize_with = "whole")]
    pub dirty_blocks: f64,
    /// Of these, the ones that started from the base pose.
    #[serde(default, serialize_with = "whole")]
    pub rebuilt_blocks: f64,
    pub format: String,
    /// Pose buffers per head.
    pub slots: u32,
    /// Passes per frame and head: `coefficients` over `batch_size`, rounded up in each frame.
    #[serde(serialize_with = "whole")]
    pub passes: f64,
    /// Bytes that the kernels load and store per frame, of all heads.
    #[serde(serialize_with = "whole")]
    pub bytes_moved: f64,
    /// Bytes that any method has to move: each delta of a changed target once, the pose in and out once.
    /// Of all heads.
    #[serde(serialize_with = "whole")]
    pub bytes_floor: f64,
    /// Time of the update on the device; `None` for paths without one, or when it was not timed.
    pub gpu_ms: Option<Stats>,
    /// Round trip from weights to fence.
    pub cpu_ms: Option<Stats>,
    /// One draw that reads the pose and rasterizes nothing.
    pub draw_ms: Option<f64>,
    /// Time of the update and of one draw for each head, on the device; `None` where frames had no draws.
    #[serde(default)]
    pub update_and_draw_ms: Option<Stats>,
    /// From poses in main memory to the device, with the wait for it; the path `cpu`, where it is drawn. No other time
    /// includes it.
    #[serde(default)]
    pub upload_ms: Option<Stats>,
    /// What was timed interleaved with others; empty where everything was timed in one go.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rounds: Vec<Round>,
    /// The time that moving `bytes_floor` takes at the best bandwidth measured, of reading or copying, as a share of
    /// the time taken: 1 is the best possible, but for what stays in a cache. `None` for paths that evaluate in draws.
    pub floor_fraction: Option<f64>,
    /// Largest position error against the float64 reference, in input units.
    pub max_error: Option<f64>,
    pub max_error_rel: Option<f64>,
    /// Largest angle between normals, in degrees.
    pub normal_error_deg: Option<f64>,
    /// Largest position error against the raw files, dropped deltas included, as a fraction of the diagonal.
    pub raw_error_rel: Option<f64>,
    /// The result stayed within the path's bound, before and after timing.
    pub verified: bool,
    /// What was wrong, when it did not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

impl RunRecord {
    /// What the plots show: time on the device, with its draws where it had any, or for paths without a device the
    /// round trip.
    pub fn time(&self) -> Option<Stats> {
        self.update_and_draw_ms.or(self.gpu_ms).or(self.cpu_ms)
    }

    /// The time that a run is judged by, in ms.
    pub fn median(&self) -> f64 {
        self.time().map_or(f64::INFINITY, |t| t.median)
    }

    /// It was right, and timed.
    pub fn counts(&self) -> bool {
        self.verified && self.time().is_some_and(|t| t.median > 0.0)
    }

    /// Its technique and the format that it ran with: "blocks fast".
    pub fn label(&self) -> String {
        format!("{} {}", self.technique, self.format)
    }
}

pub fn fastest<'a>(runs: impl IntoIterator<Item = &'a RunRecord>) -> Option<&'a RunRecord> {
    runs.into_iter().min_by(|a, b| a.median().total_cmp(&b.median()))
}

/// "batch 7", or "one pass".
pub fn batch_words(batch: BatchSize) -> String {
    match batch {
        BatchSize::Targets(n) => format!("batch {n}"),
        BatchSize::All => "one pass".into(),
    }
}

/// "1 head", "100 heads, each its own", "100 copies, one animation".
pub fn heads_words(heads: u32, shared: bool) -> String {
    match (heads, shared) {
        (1, false) => "1 head".into(),
        (n, false) => format!("{n} heads, each its own"),
        (1, true) => "1 copy".into(),
        (n, true) => format!("{n} copies, one animation"),
    }
}

/// `name`, with a number after it where that is `taken`.
pub fn unused(name: &str, gap: &str, taken: impl Fn(&str) -> bool) -> String {
    let numbered = (2u32..).map(|n| format!("{name}{gap}{n}"));
    std::iter::once(name.into()).chain(numbered).find(|name| !taken(name)).unwrap_or_default()
}

fn one() -> u32 {
    1
}

/// Medians of a few frames that were timed interleaved with those of other configurations, in ms.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Round {
    /// What [`RunRecord::time`] is about.
    pub ms: f64,
    /// The update alone.
    pub update_ms: f64,
}

/// Counts are whole numbers in JSON, means have decimals.
fn whole<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
    let exact = value.fract() == 0.0 && (0.0..9e15).contains(value);
    if exact { to.serialize_u64(*value as u64) } else { to.serialize_f64(*value) }
}

fn write_batch<S: Serializer>(batch: &BatchSize, to: S) -> Result<S::Ok, S::Error> {
    match batch {
        BatchSize::Targets(n) => to.serialize_u32(*n),
        BatchSize::All => to.serialize_str("all"),
    }
}

fn read_batch<'de, D: Deserializer<'de>>(from: D) -> Result<BatchSize, D::Error> {
    let value = serde_json::Value::deserialize(from)?;
    let number = value.as_u64().and_then(|n| u32::try_from(n).ok()).filter(|n| *n > 0);
    match (number, value.as_str()) {
        (Some(n), _) => Ok(BatchSize::Targets(n)),
        (_, Some("all")) => Ok(BatchSize::All),
        _ => Err(serde::de::Error::custom("batch_size: expected a number above 0 or \"all\"")),
    }
}
