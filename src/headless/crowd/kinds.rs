//! The kinds of crowds that a step can be taken of.

use crate::engine::{AnimatedCrowd, AnyCrowd, Crowd};
use crate::error::{Error, Result};

/// What a step needs of a crowd.
pub trait Kind: AnyCrowd {
    /// Request weights.
    fn set(&mut self, instance: u32, weights: &[f32]) -> Result<()>;

    /// The crowd, if its weights are set.
    fn weighted(&self) -> Option<&Crowd>;
}

impl Kind for Crowd {
    fn set(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
        self.set_weights(instance, weights)
    }

    fn weighted(&self) -> Option<&Crowd> {
        Some(self)
    }
}

impl Kind for AnimatedCrowd {
    fn set(&mut self, instance: u32, _weights: &[f32]) -> Result<()> {
        let what = format!("weights of instance {instance}, which is animated on the GPU");
        Err(Error::invalid(what, "play a clip, or make the crowd with create_crowd"))
    }

    fn weighted(&self) -> Option<&Crowd> {
        None
    }
}
