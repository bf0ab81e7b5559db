//! The options of `lod`.

use super::{InputArgs, values};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

#[derive(Args, Clone, Debug)]
pub struct LodArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Measure of what a target changes by itself, at weight 1, in the base pose. "all" also prints how far the
    /// metrics agree
    #[arg(long, value_name = "METRIC", default_value = "mse")]
    pub metric: Metric,
    /// Keep these targets before all others: a name, or the beginning of several (repeatable)
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub pin: Vec<String>,
    /// Weight clip to measure errors on: a CSV file, a glTF file's animation as FILE or FILE#NAME, or INPUT's by its
    /// name [default: all in INPUT/weights or INPUT]
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    /// Random orders that the order is compared with; in pictures, 32 at most
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = values::whole(1usize, 10_000))]
    pub random: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Metric {
    /// Mean of the squared distances that vertices move
    Mse,
    /// Hausdorff distance from the base pose
    Hausdorff,
    /// Mean of the squared differences of a picture's colours
    ImageMse,
    /// 1 less the structural similarity of pictures (SSIM)
    Ssim,
    /// Share of a picture's pixels that visibly differ (Yee)
    Perceptual,
    /// Each of these
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
