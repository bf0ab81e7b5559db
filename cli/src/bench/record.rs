//! The JSON of `bench`. Fields may be added, never renamed.

use super::stats::Stats;
use crate::input::MeshInfo;
use deltamorph::BatchSize;
use serde::{Serialize, Serializer};

/// Rounds that the frames of a configuration are divided into.
pub const ROUNDS: usize = 10;
/// Rounds disagree where a slow one takes more than this many times as long as a fast one.
pub const UNEVEN: f64 = 1.5;

/// The results of one call of `bench`.
#[derive(Clone, Default, Serialize)]
pub struct Report {
    pub schema: u32,
    pub version: String,
    /// When it ran, in seconds since 1970.
    pub created: u64,
    /// The command line that measures the same again.
    pub command: String,
    pub device: DeviceInfo,
    pub input: MeshInfo,
    /// Bandwidths of memory, which give a lower bound for every time.
    pub bandwidth: Bandwidth,
    pub runs: Vec<RunRecord>,
    /// Update paths and batch sizes that were requested and could not run.
    pub skipped: Vec<Skipped>,
    /// Update paths named by `--paths`, and clips named by `--weights`, of which no configuration could run; `skipped`
    /// has the reasons.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unmeasured: Vec<String>,
    /// The suites requested by `--suite`, in the order that they ran; empty for an ordinary run.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub suites: Vec<SuiteRecord>,
    /// The meshes, by the names in runs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<MeshInfo>,
    /// Sentences that summarise the runs.
    pub findings: Vec<String>,
}

#[derive(Clone, Default, Serialize)]
pub struct DeviceInfo {
    /// The Vulkan device's name; "none" when only the cpu path ran.
    pub name: String,
    /// "discrete", "integrated", "virtual", "cpu" (a software driver) or "none".
    pub kind: String,
    pub driver: String,
    /// The driver's version, as reported by the driver.
    pub driver_info: String,
    /// Vulkan version of the device.
    pub api_version: String,
    pub cpu: String,
    /// Threads that the cpu path used.
    pub threads: usize,
}

/// Measured memory bandwidth, in 10⁹ bytes per second, reads and writes counted.
#[derive(Clone, Copy, Default, Serialize)]
pub struct Bandwidth {
    pub cpu_read_gb_s: Option<f64>,
    pub cpu_copy_gb_s: Option<f64>,
    pub device_copy_gb_s: Option<f64>,
    /// A compute pass reading a buffer.
    pub device_read_gb_s: Option<f64>,
}

/// A requested configuration that could not run.
#[derive(Clone, PartialEq, Serialize)]
pub struct Skipped {
    /// The update path, with its options.
    pub what: String,
    pub reason: String,
}

impl Skipped {
    /// Whether it belongs to the update path called `path`.
    pub fn is_of(&self, path: &str) -> bool {
        self.what.split([' ', ':', ',']).next() == Some(path)
    }
}

/// A ready-made comparison.
#[derive(Clone, Default, Serialize)]
pub struct SuiteRecord {
    /// "crowd", "techniques", "faces" or "clips".
    pub name: &'static str,
    /// What it compares, as a heading.
    pub title: &'static str,
}

/// One configuration and its measurements.
#[derive(Clone, Default, Serialize)]
pub struct RunRecord {
    /// Its suite; empty in an ordinary run.
    #[serde(skip_serializing_if = "str::is_empty")]
    pub suite: &'static str,
    /// The work that it has in common with the configurations measured in turns with it.
    pub cell: String,
    /// Its path, with what is not the default of the path: mode, pose format, animated on the device.
    pub technique: String,
    pub mesh: String,
    pub targets: usize,
    pub path: &'static str,
    /// "incremental" or "rebuild".
    pub mode: &'static str,
    /// Targets per pass: a number, or "all".
    #[serde(serialize_with = "write_batch")]
    pub batch_size: BatchSize,
    /// The largest batch that this path and format allow on this device.
    pub batch_max: Option<u32>,
    /// "random", "few", or the clip that was replayed.
    pub workload: String,
    /// Targets with a changed weight, per frame and instance: counted (for clips, a mean).
    #[serde(serialize_with = "whole")]
    pub changed: f64,
    /// Coefficients applied per frame and instance: with two slots, the union of two frames' changes.
    #[serde(serialize_with = "whole")]
    pub coefficients: f64,
    /// Targets with a weight other than 0, per frame and instance.
    #[serde(serialize_with = "whole")]
    pub active: f64,
    pub heads: u32,
    /// One animation, drawn many times.
    pub shared: bool,
    /// Draws of each instance in a frame: the last one reads whole vertices, those before it positions alone. 0: frames
    /// had none.
    pub draws: u32,
    /// Whether it was measured after the others, for lack of memory: its ratios are of medians, not of rounds.
    pub alone: bool,
    /// "float" or "exact".
    pub accumulate: &'static str,
    /// Pose format.
    pub pose: &'static str,
    /// Changes too small to move a vertex this far were deferred; in input units, 0 if none were.
    pub error_budget: f32,
    pub format: &'static str,
    /// Pose buffers per instance.
    pub slots: u32,
    /// Passes per frame and instance: `coefficients` over `batch_size`, rounded up in each frame.
    #[serde(serialize_with = "whole")]
    pub passes: f64,
    /// Bytes that the kernels load and store per frame, for all instances.
    #[serde(serialize_with = "whole")]
    pub bytes_moved: f64,
    /// Bytes that any method has to move, for all instances: each delta of a changed target, and the pose in and out,
    /// once.
    #[serde(serialize_with = "whole")]
    pub bytes_floor: f64,
    /// Time of the update on the device; `None` for paths without a device, or if it was not timed.
    pub gpu_ms: Option<Stats>,
    /// Round trip from weights to fence.
    pub cpu_ms: Option<Stats>,
    /// The draws of a frame, which read the poses and rasterize nothing; of frames without draws, one of each instance.
    pub draw_ms: Option<f64>,
    /// Time of the update and the draws, on the device; `None` if frames had no draws.
    pub update_and_draw_ms: Option<Stats>,
    /// Time to upload poses from main memory to the device, waited for: the path `cpu`, if it is drawn. Not part of any
    /// other time.
    pub upload_ms: Option<Stats>,
    /// Medians of the timed frames in rounds, which alternated with those of the other configurations of its group: of
    /// the time that [`time`](Self::time) returns.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rounds: Vec<f64>,
    /// Time of a slow round over that of a fast one; see [`Self::uneven`].
    pub rounds_ratio: Option<f64>,
    /// The time to move the fewest possible bytes at the best measured bandwidth: the median of frames. `None` for
    /// paths that evaluate in draws, and if most frames change nothing.
    pub floor_ms: Option<f64>,
    /// That as a share of the median time of the update (`gpu_ms`, else `cpu_ms`): 1 is the best possible, except for
    /// data in caches.
    pub floor_fraction: Option<f64>,
    /// Largest position error against the float64 reference, in input units.
    pub max_error: Option<f64>,
    pub max_error_rel: Option<f64>,
    /// Largest angle between normals, in degrees.
    pub normal_error_deg: Option<f64>,
    /// Whether the result stayed within the path's bound, before and after timing.
    pub verified: bool,
    /// The errors found if `verified` is false.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

impl RunRecord {
    /// Time of a slow round over that of a fast one, if there are five or more: without the slowest and the fastest,
    /// since one of them does not move the median.
    pub fn spread(&self) -> Option<f64> {
        let mut times = self.rounds.clone();
        times.sort_unstable_by(f64::total_cmp);
        let [_, fast, .., slow, _] = times[..] else { return None };
        (times.len() > 4 && fast > 0.0).then_some(slow / fast)
    }

    /// Whether its rounds disagree, so that its time says little.
    pub fn uneven(&self) -> bool {
        self.rounds_ratio.is_some_and(|ratio| ratio > UNEVEN)
    }

    /// The time in plots: on the device, with draws if it had any; without a device the round trip.
    pub fn time(&self) -> Option<Stats> {
        self.update_and_draw_ms.or(self.gpu_ms).or(self.cpu_ms)
    }

    /// The time that a run is judged by, in ms.
    pub fn median(&self) -> f64 {
        self.time().map_or(f64::INFINITY, |t| t.median)
    }

    /// Whether the run was right, and timed.
    pub fn counts(&self) -> bool {
        self.verified && self.time().is_some_and(|t| t.median > 0.0)
    }

    /// Its technique and delta format: "blocks fixed16 fast".
    pub fn label(&self) -> String {
        format!("{} {}", self.technique, self.format)
    }
}

pub fn fastest<'a>(runs: impl IntoIterator<Item = &'a RunRecord>) -> Option<&'a RunRecord> {
    runs.into_iter().min_by(|a, b| a.median().total_cmp(&b.median()))
}

/// "1 head", "100 heads", "100 copies".
pub fn heads_words(heads: u32, shared: bool) -> String {
    let word = match (heads, shared) {
        (1, false) => "head",
        (_, false) => "heads",
        (1, true) => "copy",
        (_, true) => "copies",
    };
    format!("{heads} {word}")
}

/// What a cell's name says of its draws: nothing of one.
pub fn draws_words(draws: u32) -> String {
    if draws > 1 { format!(", {draws} draws") } else { String::new() }
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
