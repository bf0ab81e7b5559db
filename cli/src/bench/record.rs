//! The JSON of `bench`. Fields may be added, never renamed.

use super::compare::SuiteRecord;
use super::run::RunRecord;
use crate::input::MeshInfo;
use serde::{Deserialize, Serialize};

/// What one call of `bench` measured.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Report {
    pub schema: u32,
    pub version: String,
    /// When it ran, in UTC: 2026-01-31T12:00:00Z.
    pub created: String,
    /// The command line that measures the same again.
    pub command: String,
    pub device: DeviceInfo,
    pub input: MeshInfo,
    /// What memory can do: the floor under every time.
    pub bandwidth: Bandwidth,
    pub runs: Vec<RunRecord>,
    /// Update paths and batch sizes that were asked for and could not run.
    #[serde(default)]
    pub skipped: Vec<Skipped>,
    /// Clips that were asked for by name and that no configuration could play.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unplayed: Vec<String>,
    /// What `--suite` asked for, in the order it ran; empty for an ordinary run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub suites: Vec<SuiteRecord>,
    /// The meshes of the suites, by the name that runs give; empty for an ordinary run, which has one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<MeshInfo>,
}

impl Report {
    /// The runs of `suite`; without one, all.
    pub fn runs_of<'a>(&'a self, suite: Option<&'a SuiteRecord>) -> impl Iterator<Item = &'a RunRecord> {
        self.runs.iter().filter(move |run| suite.is_none_or(|suite| run.suite == suite.name))
    }
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct DeviceInfo {
    /// The Vulkan device's name; "none" when only the cpu path ran.
    pub name: String,
    /// "discrete", "integrated", "virtual", "cpu" (a software driver) or "none".
    pub kind: String,
    pub driver: String,
    /// What the driver says about its version.
    pub driver_info: String,
    /// Vulkan version of the device.
    pub api_version: String,
    /// Its place in the list of `devices`.
    pub index: Option<usize>,
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

/// Measured memory bandwidth, in 10⁹ bytes per second, reads and writes counted.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Bandwidth {
    pub cpu_read_gb_s: Option<f64>,
    pub cpu_copy_gb_s: Option<f64>,
    pub device_copy_gb_s: Option<f64>,
    /// A compute pass reading a buffer.
    pub device_read_gb_s: Option<f64>,
}

/// What was asked for and could not run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Skipped {
    /// The update path, with what else was special about it.
    pub what: String,
    pub reason: String,
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

    #[test]
    fn what_was_written_reads_back() {
        let text = serde_json::to_string(&synthetic::report()).expect("serialised");
        let again: Report = serde_json::from_str(&text).expect("read");
        assert_eq!(serde_json::to_string(&again).expect("serialised"), text, "a field was lost");
        assert!(serde_json::from_str::<Report>(&text.replace("\"all\"", "\"most\"")).is_err());
        assert!(serde_json::from_str::<Report>(&text.replace("\"batch_size\":1,", "\"batch_size\":0,")).is_err());
    }
}
