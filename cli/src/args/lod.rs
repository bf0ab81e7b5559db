//! The options of `lod`.

use super::{InputArgs, values};
use clap::Args;
use std::path::PathBuf;

#[derive(Args, Clone, Debug)]
pub struct LodArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// What a target counts for: what it changes by itself, at weight 1, in the base pose. "all" also says how far
    /// metrics agree
    #[arg(long, value_name = "METRIC", default_value = "mse")]
    #[arg(value_parser = values::named(&Choice::ALL, Choice::name, Choice::summary))]
    pub metric: Choice,
    /// Keep these targets before all others: a name, or the beginning of several (repeatable)
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub pin: Vec<String>,
    /// Take the order and the pins from a file that --out has written
    #[arg(long, value_name = "JSON", conflicts_with_all = ["metric", "pin"])]
    pub from: Option<PathBuf>,
    /// Write the order, with its pins, to be kept beside the asset
    #[arg(long, value_name = "JSON")]
    pub out: Option<PathBuf>,
    /// Weight clip to measure errors on: a CSV file, a glTF file's animation as FILE or FILE#NAME, or INPUT's by its
    /// name
    /// [default: all in INPUT/weights or INPUT]
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    /// Draw frames with all targets, and with the first 75%, 50% and 25% of them: those that lose most by half of the
    /// targets; with --metric all one frame, by each metric
    #[arg(long, value_name = "OUT.png")]
    pub sheet: Option<PathBuf>,
    /// Frame to draw in their place, counted from 0, through all clips
    #[arg(long, value_name = "N", requires = "sheet")]
    pub frame: Option<usize>,
    /// Plot the error against the share of targets kept, beside that of random orders
    #[arg(long, value_name = "OUT.svg")]
    pub plot: Option<PathBuf>,
    /// Random orders that the order is compared with
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = values::whole(1usize, 10_000))]
    pub random: usize,
}

/// A metric, or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    One(Metric),
    All,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metric {
    Mse,
    Hausdorff,
    ImageMse,
    Ssim,
    Perceptual,
    Yee,
}

impl Metric {
    pub const ALL: [Self; 6] = [Self::Mse, Self::Hausdorff, Self::ImageMse, Self::Ssim, Self::Perceptual, Self::Yee];

    pub fn name(self) -> &'static str {
        match self {
            Self::Mse => "mse",
            Self::Hausdorff => "hausdorff",
            Self::ImageMse => "image-mse",
            Self::Ssim => "ssim",
            Self::Perceptual => "perceptual",
            Self::Yee => "yee",
        }
    }

    /// Whether it compares pictures instead of vertices.
    pub fn is_of_pictures(self) -> bool {
        match self {
            Self::Mse | Self::Hausdorff => false,
            Self::ImageMse | Self::Ssim | Self::Perceptual | Self::Yee => true,
        }
    }
}

impl Choice {
    const ALL: [Self; 7] = [
        Self::One(Metric::Mse),
        Self::One(Metric::Hausdorff),
        Self::One(Metric::ImageMse),
        Self::One(Metric::Ssim),
        Self::One(Metric::Perceptual),
        Self::One(Metric::Yee),
        Self::All,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::One(metric) => metric.name(),
            Self::All => "all",
        }
    }

    fn summary(self) -> &'static str {
        match self {
            Self::One(Metric::Mse) => "mean of the squared distances that vertices move",
            Self::One(Metric::Hausdorff) => "Hausdorff distance from the base pose",
            Self::One(Metric::ImageMse) => "mean of the squared differences of a picture's colours",
            Self::One(Metric::Ssim) => "1 less the structural similarity of pictures (SSIM)",
            Self::One(Metric::Perceptual) => "difference of pictures that people see (FLIP)",
            Self::One(Metric::Yee) => "share of a picture's pixels that visibly differ (Yee)",
            Self::All => "each of these",
        }
    }

    pub fn metrics(self) -> Vec<Metric> {
        match self {
            Self::One(metric) => vec![metric],
            Self::All => Metric::ALL.to_vec(),
        }
    }
}
