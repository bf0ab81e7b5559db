//! Weights of absolute poses: `--normalise`.

use clap::ValueEnum;
use serde::Serialize;

/// The two readings of A. Gerdelan's "Animating Blend Shapes" for weights that sum to more than 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Reading {
    /// The text of Gerdelan's "Animating Blend Shapes": weights that sum to more than 1 are divided by the sum, and
    /// negative ones count as 0
    Text,
    /// Gerdelan's shader: the base pose gets 1 minus the sum, even if negative, as plain deltas do
    Shader,
}
