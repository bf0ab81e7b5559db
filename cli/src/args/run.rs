//! Options of the commands that update one head: `play`, `soak` and `apply`.

use super::values::{self, BatchSpec, format_on};
use super::{InputArgs, UpdateArgs};
use clap::Args;
use deltamorph::{Accumulate, DeltaFormat, UpdateMode, UpdatePath};
use std::path::PathBuf;

/// What these commands have in common.
#[derive(Args, Clone, Debug)]
pub struct RunArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub update: UpdateArgs,
    /// Targets per pass: a number, "max" or "all" [default: the largest that the path allows]
    #[arg(long, value_name = "N", value_parser = values::one_batch)]
    pub batch_size: Option<BatchSpec>,
}

#[derive(Args, Clone, Debug)]
pub struct PlayArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Weight clip to play [default: the one in INPUT/weights, where there is just one]
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    /// Compare every Nth pose with the float64 reference, and the last one
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = values::whole(1usize, 1_000_000))]
    pub every: usize,
    /// Animate and plan on the device: it samples the clip, finds what changed and makes its own work list. Takes the
    /// path blocks and exact sums, and says nothing of what it planned
    #[arg(long)]
    pub animated: bool,
    /// Add noise up to ±AMOUNT to every weight in every frame, as a tracker does that is never quite still
    #[arg(long, value_name = "AMOUNT", value_parser = values::positive)]
    pub noise: Option<f32>,
}

#[derive(Args, Clone, Debug)]
pub struct SoakArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Number of frames
    #[arg(long, value_name = "N", value_parser = values::whole(1usize, 1_000_000_000))]
    pub frames: usize,
    /// Weight clip to take captured frames from [default: all in INPUT/weights]
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    /// Compare every Nth pose with the float64 reference, and the last one [default: a 64th of the frames]
    #[arg(long, value_name = "N", value_parser = values::whole(1usize, 1_000_000_000))]
    pub every: Option<usize>,
}

impl SoakArgs {
    /// Frames from one comparison to the next.
    pub fn every(&self) -> usize {
        self.every.unwrap_or(self.frames / 64).max(1)
    }
}

#[derive(Args, Clone, Debug)]
pub struct ApplyArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Weight clip to take the weights from
    #[arg(long, value_name = "CSV", requires = "frame")]
    pub weights: Option<PathBuf>,
    /// Frame of the weight clip, counted from 0
    #[arg(long, value_name = "N", requires = "weights")]
    pub frame: Option<usize>,
    /// Step incrementally from this frame of the weight clip to --frame
    #[arg(long, value_name = "M", requires = "weights")]
    pub from_frame: Option<usize>,
    /// Weights by name, on top of the clip's (repeatable)
    #[arg(long, value_name = "NAME=WEIGHT,…", value_delimiter = ',', value_parser = values::setting)]
    pub set: Vec<(String, f32)>,
    /// OBJ file to write
    #[arg(short, long, value_name = "OUT.obj")]
    pub output: PathBuf,
}

/// The one path, mode, kind of sums and format of a command that takes one of each; `None` where none is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Single {
    pub path: Option<UpdatePath>,
    pub mode: Option<UpdateMode>,
    pub sums: Option<Accumulate>,
    pub format: Option<DeltaFormat>,
}

impl Single {
    /// For the command called `command`, which refuses several of a kind.
    pub fn new(command: &str, update: &UpdateArgs) -> Result<Self, String> {
        fn one<T: Copy>(command: &str, option: &str, given: &[T]) -> Result<Option<T>, String> {
            match given.len() {
                0 | 1 => Ok(given.first().copied()),
                _ => Err(format!("{option}: {command} takes one; name one of them")),
            }
        }
        Ok(Self {
            path: one(command, "--path", &update.paths)?,
            mode: one(command, "--mode", &update.modes)?,
            sums: one(command, "--accumulate", &update.accumulate)?,
            format: one(command, "--format", &update.formats)?,
        })
    }

    /// The format on `path`: the one given, or that of the packed file that is read, or the default of the path.
    pub fn format_on(&self, path: UpdatePath, held: Option<DeltaFormat>) -> Result<DeltaFormat, String> {
        let fits = |format| format_on(path, format);
        let defaults = held.into_iter().chain([DeltaFormat::Fast, DeltaFormat::Float32, DeltaFormat::Small]);
        self.format.map_or_else(|| defaults.into_iter().find_map(fits), fits).ok_or_else(|| {
            let names: Vec<&str> = path.formats().iter().map(|format| format.name()).collect();
            format!("--format: the path '{}' takes {}", path.name(), names.join(" or "))
        })
    }
}
