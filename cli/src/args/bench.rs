//! Options of `bench`.

use super::values::{self, BatchSpec};
use super::{InputArgs, UpdateArgs};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A ready-made comparison.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum SuiteChoice {
    /// Every technique against the number of targets, for one instance and many (--shared: copies of one); crowds of 10
    /// to 10,000 instances, planned on the CPU and animated on the device
    Crowd,
    /// Every technique with all or few targets changed, and with constant targets; dense and sparse; for one instance
    /// and many
    Techniques,
    /// Forty faces of four rigs of up to 23,735 vertices and 319 targets, each at another frame of a clip
    Faces,
    /// Every technique on the clips of INPUT
    Clips,
    /// All of these
    All,
}

#[derive(Args, Debug)]
pub struct BenchArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub update: UpdateArgs,
    /// Measure every batch size, more numbers of changed targets, fixed32 poses and the clips of INPUT. Takes many
    /// minutes; without it, the main comparison takes about one
    #[arg(long)]
    pub full: bool,
    /// Targets per pass: numbers, ranges ("1..7", "1..max"), "max" (the most that the device supports), or "all" (one
    /// pass) [default: 1,2,4,8,16,max,all; --full: 1..max,all for clips and the largest --changed, otherwise 8,max,all]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = values::batch)]
    pub batch_sizes: Vec<BatchSpec>,
    /// Numbers of targets that change per frame, or "all"; they are drawn at random in each frame [default: 8,all;
    /// --full: 1,4,8,16,32,all]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = values::changed)]
    pub changed: Vec<Option<usize>>,
    /// Also measure with this weight clip (repeatable)
    #[arg(long, value_name = "CSV")]
    pub weights: Vec<PathBuf>,
    /// Numbers of instances, each with its own weights [default: 1; suite crowd: 1,100 and 10,100,1000,10000; suite
    /// techniques: 1,10,100; suite faces: 40]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = values::whole(1u32, 1_000_000))]
    pub heads: Vec<u32>,
    /// Update one instance, and draw its pose for all of them
    #[arg(long)]
    pub shared: bool,
    /// Draw passes per instance and frame, included in the time: position-only passes (depth, shadow), then one full
    /// pass. The direct paths evaluate poses in each of them [default: 0; suites, and if such a path is measured: 1]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = values::whole(1u32, 64))]
    pub draws: Vec<u32>,
    /// Maximum number of frames to time per configuration
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = values::whole(1usize, 1_000_000))]
    pub frames: usize,
    /// Frames to run before timing starts
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = values::whole(0usize, 1_000_000))]
    pub warmup: usize,
    /// Run these ready-made comparisons instead of the main one
    #[arg(
        long = "suite",
        value_name = "NAME,…",
        value_delimiter = ',',
        value_enum,
        conflicts_with_all = [
            "full", "batch_sizes", "changed", "weights", "modes", "error_budget"
        ]
    )]
    pub suites: Vec<SuiteChoice>,
    /// Suite techniques: numbers of targets with a constant weight, besides the four that change in each frame (such as
    /// the sliders of a character, or a held expression) [default: 0]
    #[arg(long, value_name = "LIST", value_delimiter = ',', requires = "suites")]
    #[arg(value_parser = values::whole(0, values::MAX_TARGETS))]
    pub constant: Vec<usize>,
    /// Maximum number of seconds to time per configuration [default: 0.4; suites: 5]
    #[arg(long, value_name = "SECONDS")]
    #[arg(value_parser = values::number("a number of seconds above 0, at most a day", |v| v > 0.0 && v <= 86_400.0))]
    pub time_limit: Option<f32>,
    /// Folder for index.html, report.json and runs.csv [default: bench-report]
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Write no report folder
    #[arg(long, conflicts_with = "report")]
    pub no_report: bool,
}

impl BenchArgs {
    /// The folder to write, if any.
    pub fn folder(&self) -> Option<&Path> {
        (!self.no_report).then(|| self.report.as_deref().unwrap_or(Path::new("bench-report")))
    }

    /// How long a configuration is timed; `default`: in seconds, without the option.
    pub fn time_limit(&self, default: f32) -> Duration {
        Duration::from_secs_f32(self.time_limit.unwrap_or(default))
    }
}
