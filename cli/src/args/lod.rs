//! The options of `lod`.

use super::{InputArgs, values};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

#[derive(Args, Debug)]
pub struct LodArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Metric of the difference between the base pose and a target at weight 1
    #[arg(long, value_name = "METRIC", default_value = "mse")]
    pub metric: Metric,
    /// Rank these targets first: full names, or beginnings of names (repeatable)
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub pin: Vec<String>,
    /// Weight clip to measure errors with: a CSV file, an animation of a glTF file as FILE or FILE#NAME, or the name of
    /// a clip of INPUT [default: all clips of INPUT]
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    /// Number of random orders to compare the ranking with; image metrics use at most 32
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = values::whole(1usize, 10_000))]
    pub random: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum Metric {
    /// Mean squared distance that vertices move
    Mse,
    /// Hausdorff distance from the base pose
    Hausdorff,
    /// Mean squared difference of colours in an image
    ImageMse,
    /// 1 - structural similarity of images (SSIM)
    Ssim,
    /// Fraction of the pixels of an image that differ visibly (Yee)
    Perceptual,
    /// All of these
    All,
}

impl Metric {
    /// This one, or each of those that it stands for.
    pub fn each(self) -> Vec<Self> {
        let all = self == Self::All;
        Self::value_variants().iter().copied().filter(|one| if all { *one != self } else { *one == self }).collect()
    }

    /// Whether it compares pictures instead of vertices.
    pub fn is_of_pictures(self) -> bool {
        !matches!(self, Self::Mse | Self::Hausdorff)
    }
}
