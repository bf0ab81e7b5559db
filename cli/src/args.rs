//! The command line, as clap sees it.

pub mod bench;
pub mod lod;
pub mod render;
pub mod values;
#[cfg(feature = "viewer")]
pub mod view;

use bench::BenchArgs;
use clap::{Args, Parser, Subcommand};
use deltamorph::{BlockDesc, DeltaFormat, PoseFormat, Tolerance, UpdateMode, UpdatePath};
use deltamorph_head::HeadDesc;
use deltamorph_headless::DeviceChoice;
use lod::LodArgs;
use render::RenderArgs;
use std::ffi::OsString;
use std::path::PathBuf;
use values::{BatchSpec, BudgetSpec};

/// Headings of options that several commands have.
const READ: &str = "Reading";
const HEAD: &str = "The built-in head";
const POSES: &str = "Updating poses";
const PACKED: &str = "Packing deltas";

/// Morph targets (blend shapes) on the GPU: applies only the weights that changed.
#[derive(Parser, Debug)]
#[command(name = "deltamorph", version, propagate_version = true, max_term_width = 100)]
pub struct Cli {
    #[command(flatten)]
    pub global: GlobalArgs,
    #[command(subcommand)]
    pub command: Command,
}

/// The words of a command line. Settings of `--set` that a shell has split at the spaces of a name are joined again.
pub fn with_whole_settings(words: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let mut all: Vec<OsString> = vec![];
    for word in words {
        let is_option = word.as_encoded_bytes().starts_with(b"-");
        match &mut all[..] {
            [.., option, name] if option == "--set" && !is_option && !name.as_encoded_bytes().contains(&b'=') => {
                name.push(" ");
                name.push(word);
            }
            _ => all.push(word),
        }
    }
    all
}

/// Options of every command.
#[derive(Args, Debug, Default)]
#[command(next_help_heading = "Options of every command")]
pub struct GlobalArgs {
    /// Vulkan device: its index in `deltamorph devices`, or part of its name
    #[arg(long, global = true, value_name = "INDEX|NAME", value_parser = values::device)]
    pub device: Option<DeviceChoice>,
    /// Write the result as JSON to FILE, or with "-" to stdout, in place of the text
    #[arg(long, global = true, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Print errors only
    #[arg(long, global = true)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// List the Vulkan devices, and the update paths that each of them supports
    Devices,
    /// Write the built-in head as a folder of OBJ files with a weight clip
    Sample(SampleArgs),
    /// Pack a mesh into a file that loads without packing again
    Pack(PackFileArgs),
    /// Print the targets, sparsity, overlap and blocks of a mesh, and the size and error of each format
    Info(InfoArgs),
    /// Measure the time per frame of the update paths, and write a report
    Bench(Box<BenchArgs>),
    /// Play a weight clip, one update per frame, and print bytes, times and errors
    Play(Box<PlayArgs>),
    /// Measure how poses drift over any number of random and captured frames
    Soak(Box<SoakArgs>),
    /// Write one pose as OBJ
    Apply(Box<ApplyArgs>),
    /// Draw a pose, a crowd or a whole clip as PNG
    Render(Box<RenderArgs>),
    /// Open a window with a slider for each target, and a choice of clips, paths and formats
    #[cfg(feature = "viewer")]
    #[command(after_help = view::HELP)]
    View(Box<view::ViewArgs>),
    /// Open a window (only if the program was built with --features viewer)
    #[cfg(not(feature = "viewer"))]
    View(NoViewArgs),
    /// Rank targets by importance, and measure the error if only the first ones are kept
    Lod(Box<LodArgs>),
}

/// All arguments of `view`.
#[cfg(not(feature = "viewer"))]
#[derive(Args, Debug)]
pub struct NoViewArgs {
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    args: Vec<std::ffi::OsString>,
}

#[derive(Args, Debug)]
pub struct SampleArgs {
    /// Folder to write; it is created if it does not exist, and must be empty
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
    #[command(flatten)]
    pub head: HeadArgs,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Frames of the weight clip
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = values::whole(1usize, 1_000_000))]
    pub frames: usize,
    /// Frames per second of the weight clip
    #[arg(long, value_name = "F", default_value_t = 30.0, value_parser = values::fps)]
    pub fps: f32,
}

#[derive(Args, Debug)]
pub struct PackFileArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Delta format: fast or small [default: small]
    #[arg(long, value_name = "FORMAT")]
    #[arg(value_parser = values::named(&DeltaFormat::ALL, DeltaFormat::name, DeltaFormat::summary))]
    pub format: Option<DeltaFormat>,
    #[command(flatten)]
    pub pack: PackArgs,
    /// File to write
    #[arg(short, long, value_name = "OUT.dmorph")]
    pub output: PathBuf,
}

#[derive(Args, Debug)]
pub struct InfoArgs {
    #[command(flatten)]
    pub input: InputArgs,
}

/// What commands that update one head have in common.
#[derive(Args, Clone, Debug)]
pub struct RunArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Weight clip: a CSV file, an animation of a glTF file as FILE or FILE#NAME, or the name of a clip of INPUT
    /// [default: the clip of INPUT, if it has exactly one; soak: all clips of INPUT; view: the first; apply and render
    /// without --clip or --crowd: none]
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    #[command(flatten)]
    pub update: UpdateArgs,
    /// Targets per pass: a number, "max" (the most that the path supports) or "all"
    #[arg(help_heading = POSES, long, value_name = "N", value_parser = values::one_batch, default_value = "max")]
    pub batch_size: BatchSpec,
}

#[derive(Args, Debug)]
pub struct PlayArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Compare every Nth pose, and the last one, with the source evaluated in float64
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = values::whole(1usize, 1_000_000))]
    pub every: usize,
    /// Animate on the device: it samples the clip, finds the changed targets and plans the update. Needs the path
    /// blocks and fixed-point poses; statistics of the plan are not available
    #[arg(long)]
    pub animated: bool,
    /// Add random noise of up to ±AMOUNT to every weight in every frame, as from a face tracker
    #[arg(long, value_name = "AMOUNT", value_parser = values::positive)]
    pub noise: Option<f32>,
}

#[derive(Args, Debug)]
pub struct SoakArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Number of frames
    #[arg(long, value_name = "N", value_parser = values::whole(1usize, 1_000_000_000))]
    pub frames: usize,
    /// Compare every Nth pose, and the last one, with the float64 reference [default: frames / 64]
    #[arg(long, value_name = "N", value_parser = values::whole(1usize, 1_000_000_000))]
    pub every: Option<usize>,
}

impl SoakArgs {
    /// Frames between comparisons.
    pub fn every(&self) -> usize {
        self.every.unwrap_or(self.frames / 64).max(1)
    }
}

#[derive(Args, Debug)]
pub struct ApplyArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Frame of the weight clip, counted from 0
    #[arg(long, value_name = "N", requires = "weights")]
    pub frame: Option<usize>,
    /// Start at this frame of the weight clip, and update incrementally up to --frame
    #[arg(long, value_name = "M", requires = "weights")]
    pub from_frame: Option<usize>,
    /// Weights by name; they replace those of the clip (repeatable)
    #[arg(long, value_name = "NAME=WEIGHT,…", value_parser = values::settings)]
    pub set: Vec<Vec<(String, f32)>>,
    /// OBJ file to write
    #[arg(short, long, value_name = "OUT.obj")]
    pub output: PathBuf,
}

/// The mesh, and which of its deltas are kept.
#[derive(Args, Clone, Debug, Default)]
pub struct InputArgs {
    /// A folder with neutral.obj, targets/*.obj and optionally weights/*.csv, a glTF file (*.glb, *.gltf, *.vrm), or a
    /// packed file (*.dmorph) [default: the built-in head]
    #[arg(value_name = "INPUT", conflicts_with_all = ["vertices", "targets", "sparsity"])]
    pub input: Option<PathBuf>,
    #[command(flatten)]
    pub head: HeadArgs,
    /// Drop position deltas up to this length, as a fraction of the diagonal. In all options and results, the diagonal
    /// is that of the bounding box of what targets move (of the smallest such part, if several are far apart); `info`
    /// prints it
    #[arg(help_heading = READ, long, value_name = "FRACTION", default_value_t = 1e-6)]
    #[arg(value_parser = values::number("a fraction of the diagonal, 0 or more (0 keeps every delta)", |v| v >= 0.0))]
    pub tolerance: f32,
    /// Frames per second of weight clips [default: from the file name ("…_24fps.csv") or the keys of the animation,
    /// otherwise 30]
    #[arg(help_heading = READ, long, value_name = "F", value_parser = values::fps)]
    pub fps: Option<f32>,
    /// Treat targets as absolute poses (A. Gerdelan, "Animating Blend Shapes"): negative weights count as 0, weights
    /// whose sum exceeds 1 are divided by the sum, and the base pose gets the rest
    #[arg(help_heading = READ, long)]
    pub normalise: bool,
    /// Seed of all random numbers
    #[arg(help_heading = READ, long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

impl InputArgs {
    /// The tolerance for dropping deltas. A tolerance of 0 keeps every delta, including those of normals.
    pub fn tolerance(&self) -> Tolerance {
        if self.tolerance == 0.0 {
            Tolerance::ZERO
        } else {
            Tolerance { position: self.tolerance, ..Default::default() }
        }
    }
}

/// Size of the built-in head.
#[derive(Args, Clone, Debug, Default)]
pub struct HeadArgs {
    /// Number of vertices [default: 43788]
    #[arg(help_heading = HEAD, long, value_name = "N", value_parser = values::whole(5usize, 10_000_000))]
    pub vertices: Option<usize>,
    /// Number of morph targets [default: 72]
    #[arg(help_heading = HEAD, long, value_name = "N", value_parser = values::whole(0, values::MAX_TARGETS))]
    pub targets: Option<usize>,
    /// Mean fraction of the vertices that a target moves, above 0, at most 1 [default: 0.12]
    #[arg(help_heading = HEAD, long, value_name = "FRACTION")]
    #[arg(value_parser = values::number("a fraction above 0 and at most 1", |v| v > 0.0 && v <= 1.0))]
    pub sparsity: Option<f32>,
}

impl HeadArgs {
    /// The description of the built-in head.
    pub fn desc(&self, seed: u64) -> HeadDesc {
        let d = HeadDesc::default();
        HeadDesc {
            vertices: self.vertices.unwrap_or(d.vertices),
            targets: self.targets.unwrap_or(d.targets),
            sparsity: self.sparsity.unwrap_or(d.sparsity),
            seed,
        }
    }
}

/// Options of the commands that update poses.
#[derive(Args, Clone, Debug)]
pub struct UpdateArgs {
    /// Update paths, separated by commas [default: blocks, or cpu without a device; bench: feedback, compute, blocks
    /// and cpu]
    #[arg(help_heading = POSES, long = "paths", visible_alias = "path", value_name = "PATH,…", value_delimiter = ',')]
    #[arg(value_parser = values::named(&deltamorph_baselines::PATHS, UpdatePath::name, UpdatePath::summary))]
    pub paths: Vec<UpdatePath>,
    /// Update the current pose, or rebuild each pose from the base pose [default: incremental; scatter and the direct
    /// paths always rebuild]
    #[arg(help_heading = POSES, long = "mode", visible_alias = "modes", value_name = "MODE,…", value_delimiter = ',')]
    #[arg(value_parser = values::mode())]
    pub modes: Vec<UpdateMode>,
    /// Pose buffers per instance; 2 keeps the previous pose, for motion vectors
    #[arg(help_heading = POSES, long, value_name = "N", default_value_t = 2, value_parser = values::whole(1u32, 64))]
    pub slots: u32,
    /// Delta formats, separated by commas [default: fast, or the format of the .dmorph file; bench: all formats that
    /// the path supports]
    #[arg(help_heading = POSES, long = "formats", visible_alias = "format", value_name = "FORMAT,…")]
    #[arg(value_delimiter = ',', value_parser = values::named(&DeltaFormat::ALL, DeltaFormat::name, DeltaFormat::summary))]
    pub formats: Vec<DeltaFormat>,
    /// Pose formats, separated by commas [default: float32; bench --full: float32 and fixed32]
    #[arg(help_heading = POSES, long = "poses", visible_alias = "pose", value_name = "FORMAT,…")]
    #[arg(value_delimiter = ',', value_parser = values::named(&PoseFormat::ALL, PoseFormat::name, PoseFormat::summary))]
    pub poses: Vec<PoseFormat>,
    /// Maximum accumulated rounding error of float32 poses, as a fraction of the diagonal. A block that would exceed
    /// it is rebuilt from the base pose (which alone may exceed it if hundreds of targets are active)
    #[arg(help_heading = POSES, long, value_name = "FRACTION", default_value_t = 1e-5, value_parser = values::positive)]
    pub drift: f32,
    /// Defer changes until they add up to this distance (block formats): a length in input units, or a fraction of the
    /// diagonal, such as "1e-4d"
    #[arg(help_heading = POSES, long, value_name = "LENGTH", value_parser = values::budget)]
    pub error_budget: Option<BudgetSpec>,
    #[command(flatten)]
    pub pack: PackArgs,
    /// Threads of the cpu path [default: one per core]
    #[arg(help_heading = POSES, long, value_name = "N", value_parser = values::whole(1usize, 256))]
    pub threads: Option<usize>,
}

/// Options of packing into blocks.
#[derive(Args, Clone, Debug)]
pub struct PackArgs {
    /// Vertices of a block: 32, 64 or 128 [default: 32 for small, else 64]
    #[arg(help_heading = PACKED, long, value_name = "N", value_parser = values::block_size)]
    pub block_size: Option<u32>,
    /// Largest error of a packed position delta, as a fraction of the diagonal
    #[arg(help_heading = PACKED, long, value_name = "FRACTION", default_value_t = 1e-5, value_parser = values::positive)]
    pub position_error: f32,
    /// Largest error of a packed normal at weight 1, in degrees
    #[arg(help_heading = PACKED, long, value_name = "DEGREES", default_value_t = 0.5, value_parser = values::positive)]
    pub normal_error: f32,
    /// Largest absolute weight that fixed-point poses must support; smaller values give more precision [default: the
    /// maximum of the clip, at least 1; fixed32: 4 or the value of the .dmorph file, unless its precision is too low]
    #[arg(help_heading = PACKED, long, value_name = "WEIGHT", value_parser = values::positive)]
    pub weight_max: Option<f32>,
}

impl PackArgs {
    /// The library's description of packing.
    pub fn desc(&self) -> BlockDesc {
        let default = BlockDesc::default();
        BlockDesc {
            size: self.block_size,
            position_error: self.position_error,
            normal_error_degrees: self.normal_error,
            weight_max: self.weight_max.unwrap_or(default.weight_max),
            ..default
        }
    }
}

/// The values given, or `default`: each once, at its first position.
pub fn distinct_or<T: Copy + PartialEq>(given: &[T], default: &[T]) -> Vec<T> {
    let list = if given.is_empty() { default } else { given };
    list.iter().enumerate().filter(|(i, one)| !list[..*i].contains(one)).map(|(_, one)| *one).collect()
}

impl UpdateArgs {
    /// Checks the options of `command`, which takes one path, mode, pose format and delta format: refuses several.
    pub fn check_single(&self, command: &str) -> Result<(), String> {
        let given = [
            ("--path", self.paths.len()),
            ("--mode", self.modes.len()),
            ("--pose", self.poses.len()),
            ("--format", self.formats.len()),
        ];
        let several = given.iter().find(|(_, count)| *count > 1);
        several.map_or(Ok(()), |(option, _)| Err(format!("{option}: {command} accepts only one; name one of them")))
    }

    /// The error budget as a length.
    pub fn budget(&self, diagonal: f32) -> f32 {
        match self.error_budget {
            Some(BudgetSpec::Length(length)) => length,
            Some(BudgetSpec::Diagonal(fraction)) => fraction * diagonal,
            None => 0.0,
        }
    }
}

#[cfg(test)]
#[path = "args/tests.rs"]
mod tests;
