//! Weights of absolute poses: `--normalise`.

use clap::ValueEnum;
use serde::Serialize;

/// How A. Gerdelan's "Animating Blend Shapes" is read, where weights sum to more than 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Reading {
    /// As Gerdelan writes ("Animating Blend Shapes"): each weight is divided by the sum, so that the base pose has no
    /// part. Negative ones count as 0
    Text,
    /// As Gerdelan's shader has it: the base pose takes 1 less the sum, negative too, which is what deltas do as they are
    Shader,
}
