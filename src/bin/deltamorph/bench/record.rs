//! The JSON of `bench`. Fields may be added, never renamed.

use super::stats::Stats;
use super::suites::record::SuiteRecord;
use super::trial::{Config, Setting};
use crate::input::Input;
use deltamorph::plan::BatchSize;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// What one call of `bench` measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Report {
    /// Version of these structs.
    pub schema: u32,
    /// Version of the program.
    pub version: String,
    /// When it ran, in UTC: 2026-01-31T12:00:00Z.
    pub created: String,
    /// The command line that measures the same again.
    pub command: String,
    /// Where it ran.
    pub device: DeviceInfo,
    /// What was morphed.
    pub input: InputInfo,
    /// What memory can do: the floor under every time.
    pub bandwidth: Bandwidth,
    /// The configurations, in the order they ran.
    pub runs: Vec<RunRecord>,
    /// Update paths and batch sizes that were asked for and could not run.
    #[serde(default)]
    pub skipped: Vec<Skipped>,
    /// What `--suite` asked for, in the order it ran; empty for an ordinary run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub suites: Vec<SuiteRecord>,
    /// The meshes of the suites, by the name that runs give; empty for an ordinary run, which has one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<InputInfo>,
}

/// The device.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct DeviceInfo {
    /// The Vulkan device's name; "none" when only the cpu path ran.
    pub name: String,
    /// "discrete", "integrated", "virtual", "cpu" (a software driver) or "none".
    pub kind: String,
    /// The driver's name.
    pub driver: String,
    /// What the driver says about its version.
    pub driver_info: String,
    /// Vulkan version of the device.
    pub api_version: String,
    /// Its place in the list of `devices`.
    pub index: Option<usize>,
    /// The processor.
    pub cpu: String,
    /// Threads that the cpu path used.
    pub threads: usize,
}

impl DeviceInfo {
    /// A software driver: its times say little about any GPU.
    pub fn is_software(&self) -> bool {
        self.kind == "cpu"
    }
}

/// The mesh.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct InputInfo {
    /// Its name.
    pub name: String,
    /// Where it came from: a folder, or "built-in head".
    pub origin: String,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of targets.
    pub targets: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Length of the bounding-box diagonal, in input units.
    pub diagonal: f32,
    /// Position deltas up to this fraction of the diagonal were dropped.
    pub tolerance: f32,
    /// Mean fraction of the vertices that a target moves.
    pub moved_mean: f64,
}

/// Measured memory bandwidth, in 10⁹ bytes per second, reads and writes counted.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Bandwidth {
    /// The processor reading.
    pub cpu_read_gb_s: Option<f64>,
    /// The processor copying.
    pub cpu_copy_gb_s: Option<f64>,
    /// The device copying a buffer.
    pub device_copy_gb_s: Option<f64>,
    /// A compute pass reading a buffer.
    pub device_read_gb_s: Option<f64>,
}

/// One configuration and what it took.
#[derive(Clone, Debug, Serialize, Deserialize)]
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
    /// The mesh.
    #[serde(default)]
    pub mesh: String,
    /// Targets of the mesh.
    #[serde(default)]
    pub targets: usize,
    /// Update path.
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
    /// Number of heads.
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
    /// Delta format.
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
    /// What was timed in turns with others; empty where everything was timed in one go.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rounds: Vec<Round>,
    /// The time that reading what `bytes_floor` has to be read takes at the measured bandwidth, as a share of the time
    /// taken: 1 is the best possible, but for what stays in a cache.
    pub floor_fraction: Option<f64>,
    /// Largest position error against the float64 reference, in input units.
    pub max_error: Option<f64>,
    /// The same as a fraction of the diagonal.
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
    /// A configuration that was not measured yet.
    pub fn blank(config: &Config, setting: &Setting<'_>, input: &Input) -> Self {
        Self {
            suite: String::new(),
            cell: String::new(),
            technique: String::new(),
            mesh: input.kept.name.clone(),
            targets: input.kept.targets.len(),
            path: config.desc.path.name().into(),
            mode: config.desc.mode.name().into(),
            batch_size: config.desc.batch,
            batch_max: config.batch_max,
            workload: setting.workload.name().into(),
            changed: setting.changed.unwrap_or(0) as f64,
            coefficients: 0.0,
            active: 0.0,
            heads: setting.heads,
            shared: setting.shared,
            crowds: if config.apart { setting.updated() } else { 1 },
            alone: false,
            accumulate: config.desc.accumulate.name().into(),
            error_budget: config.desc.error_budget,
            dirty_blocks: 0.0,
            rebuilt_blocks: 0.0,
            format: config.format.name().into(),
            slots: config.desc.slots,
            passes: 0.0,
            bytes_moved: 0.0,
            bytes_floor: 0.0,
            gpu_ms: None,
            cpu_ms: None,
            draw_ms: None,
            update_and_draw_ms: None,
            rounds: vec![],
            floor_fraction: None,
            max_error: None,
            max_error_rel: None,
            normal_error_deg: None,
            raw_error_rel: None,
            verified: false,
            problem: None,
        }
    }

    /// What is wrong has no times worth telling.
    pub fn forget_times(&mut self) {
        (self.gpu_ms, self.cpu_ms, self.draw_ms, self.update_and_draw_ms) = (None, None, None, None);
        self.floor_fraction = None;
        self.rounds.clear();
    }

    /// What the plots show: time on the device, with its draws where it had any, or for paths without a device the
    /// round trip.
    pub fn time(&self) -> Option<Stats> {
        self.update_and_draw_ms.or(self.gpu_ms).or(self.cpu_ms)
    }

    /// Whether it was right and timed.
    pub fn counts(&self) -> bool {
        self.verified && self.time().is_some_and(|t| t.median > 0.0)
    }
}

fn one() -> u32 {
    1
}

/// Medians of a few frames that were timed in turns with those of other configurations, in ms.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Round {
    /// What [`RunRecord::time`] is about.
    pub ms: f64,
    /// The update alone.
    pub update_ms: f64,
}

/// What was asked for and could not run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Skipped {
    /// The update path, with what else was special about it.
    pub what: String,
    /// Why not.
    pub reason: String,
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
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "batch_size: expected a number or \"all\"")]
    enum Either {
        Number(u32),
        Word(String),
    }
    match Either::deserialize(from)? {
        Either::Number(n) if n > 0 => Ok(BatchSize::Targets(n)),
        Either::Word(w) if w == "all" => Ok(BatchSize::All),
        _ => Err(serde::de::Error::custom("batch_size: expected a number above 0 or \"all\"")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::synthetic;

    #[test]
    fn the_json_keeps_its_contract() {
        let json = serde_json::to_value(synthetic::report()).expect("serialised");
        assert_eq!(json["schema"], 1);
        for field in ["cpu_read_gb_s", "cpu_copy_gb_s", "device_copy_gb_s", "device_read_gb_s"] {
            assert!(json["bandwidth"].get(field).is_some(), "{field}");
        }
        for field in ["vertices", "targets", "triangles", "diagonal"] {
            assert!(json["input"].get(field).is_some(), "{field}");
        }
        let run = &json["runs"][0];
        for field in
            "path mode batch_size changed coefficients active heads shared accumulate format passes bytes_moved \
                      bytes_floor gpu_ms cpu_ms draw_ms max_error verified workload max_error_rel normal_error_deg \
                      raw_error_rel floor_fraction slots batch_max"
                .split_whitespace()
        {
            assert!(run.get(field).is_some(), "{field}");
        }
        for field in ["median", "mean", "stderr", "min", "max", "n"] {
            assert!(run["gpu_ms"][field].is_number(), "{field}");
        }
        assert_eq!((&run["batch_size"], &run["changed"]), (&1.into(), &72.into()));
        let runs = json["runs"].as_array().expect("a list");
        assert!(runs.iter().any(|r| r["batch_size"] == "all" && r["gpu_ms"].is_null()));
    }

    fn same(a: &serde_json::Value, b: &serde_json::Value) -> bool {
        use serde_json::Value::{Array, Number, Object};
        match (a, b) {
            (Array(a), Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
            (Object(a), Object(b)) => {
                a.len() == b.len() && a.iter().all(|(key, a)| b.get(key).is_some_and(|b| same(a, b)))
            }
            (Number(a), Number(b)) => match (a.as_f64(), b.as_f64()) {
                (Some(a), Some(b)) => (a - b).abs() <= 1e-14 * a.abs(),
                _ => false,
            },
            _ => a == b,
        }
    }

    #[test]
    fn what_was_written_reads_back() {
        let text = serde_json::to_string(&synthetic::report()).expect("serialised");
        let again: Report = serde_json::from_str(&text).expect("read");
        let (json, read) = (serde_json::to_value(synthetic::report()), serde_json::to_value(again));
        let (json, read) = (json.expect("serialised"), read.expect("serialised"));
        // serde_json reads floats to within a unit in the last place, unless told to take longer.
        assert!(same(&json, &read), "a field was lost");
        assert!(serde_json::from_str::<Report>(&text.replace("\"all\"", "\"most\"")).is_err());
    }
}
