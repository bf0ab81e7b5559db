//! Options of `bench`.

use super::values::{self, BatchSpec};
use super::{InputArgs, UpdateArgs, distinct_or};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A ready-made comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SuiteChoice {
    /// Every technique against the number of targets, for one head and many (--shared: copies of one); crowds of 10 to
    /// 10,000 heads, planned by the processor and animated on the device
    Crowd,
    /// Every technique with all, few and constant targets, dense and sparse, for one head and many
    Techniques,
    /// Forty faces of four rigs of up to 23,735 vertices and 319 targets, each at its own frame of a clip
    Faces,
    /// Every technique on captured clips: those of INPUT, or of the data sets under DELTAMORPH_DATA
    Clips,
    /// All of these
    All,
}

#[derive(Args, Clone, Debug)]
pub struct BenchArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub update: UpdateArgs,
    /// Sweep every batch size, more changed targets, fixed32 poses and the clips of INPUT (takes many minutes); without
    /// it the main comparison runs, which takes about one
    #[arg(long)]
    pub full: bool,
    /// Targets per pass: numbers, ranges ("1..7", "1..max"), "max" (what the device allows), "all" (one pass)
    /// [default: 1,2,4,8,16,max,all; with --full 1..max,all for clips and the largest --changed, 8,max,all for others]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = values::batch)]
    pub batch_sizes: Vec<BatchSpec>,
    /// Targets changed per frame, drawn afresh for every frame: numbers and "all" [default: 8,all; with
    /// --full 1,4,8,16,32,all]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = values::changed)]
    pub changed: Vec<Option<usize>>,
    /// Replay this weight clip as a workload, next to the random one (repeatable)
    #[arg(long, value_name = "CSV")]
    pub weights: Vec<PathBuf>,
    /// Numbers of heads, each with its own weights [default: 1; suites crowd: 1,100 and 10,100,1000,10000, techniques:
    /// 1,10,100, faces: 40]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = values::whole(1u32, 1_000_000))]
    pub heads: Vec<u32>,
    /// One animation for all heads: one is updated, and its pose drawn for each
    #[arg(long)]
    pub shared: bool,
    /// Draws of every head in a frame, which its time includes: the last one reads whole vertices, those before it
    /// positions alone, as passes for depth and shadows do; paths that evaluate in draws do so in each [default: none;
    /// suites, and if one of the paths evaluates in draws: 1]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = values::whole(1u32, 64))]
    pub draws: Vec<u32>,
    /// Frames to time per configuration, at most
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = values::whole(1usize, 1_000_000))]
    pub frames: usize,
    /// Frames to run before timing starts
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = values::whole(0usize, 1_000_000))]
    pub warmup: usize,
    /// Run ready-made comparisons instead
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
    /// Suite techniques: numbers of targets with a weight that never changes, beside the four that change in each frame
    /// (sliders of a character, poses that are held) [default: 0]
    #[arg(long, value_name = "LIST", value_delimiter = ',', requires = "suites")]
    #[arg(value_parser = values::whole(0, values::MAX_TARGETS))]
    pub constant: Vec<usize>,
    /// Seconds to time each configuration for, where --frames take longer [default: 0.4; suites: 5]
    #[arg(long, value_name = "SECONDS")]
    #[arg(value_parser = values::number("a number of seconds above 0, at most a day", |v| v > 0.0 && v <= 86_400.0))]
    pub time_limit: Option<f32>,
    /// Folder for report.json, runs.csv and index.html [default: bench-report]
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Write no report folder
    #[arg(long, conflicts_with = "report")]
    pub no_report: bool,
}

impl BenchArgs {
    /// The crowd sizes given, each once, or else `default`.
    pub fn heads_or(&self, default: &[u32]) -> Vec<u32> {
        distinct_or(&self.heads, default)
    }

    /// The numbers of draws given, each once, or else `default`.
    pub fn draws_or(&self, default: u32) -> Vec<u32> {
        distinct_or(&self.draws, &[default])
    }

    /// The folder to write, if any.
    pub fn folder(&self) -> Option<&Path> {
        (!self.no_report).then(|| self.report.as_deref().unwrap_or(Path::new("bench-report")))
    }

    /// How long a configuration is timed, unless told otherwise `default` seconds.
    pub fn time_limit(&self, default: f32) -> Duration {
        Duration::from_secs_f32(self.time_limit.unwrap_or(default))
    }
}
