//! Weights: clips, applied weights, delta weights.

pub mod delta;

#[cfg(feature = "csv")]
pub mod csv;

use crate::error::{Error, Result};

/// A weight clip: one row of weights per frame, columns by target name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WeightClip {
    /// Name for messages and reports (the file's stem).
    pub name: String,
    /// Column names.
    pub names: Vec<String>,
    /// Frames per second.
    pub fps: f32,
    /// `names.len()` weights per frame, frame after frame.
    pub values: Vec<f32>,
}

impl WeightClip {
    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        self.values.len().checked_div(self.names.len()).unwrap_or(0)
    }

    /// One weight per target for each frame, in the order of `targets`; targets without a column get 0.
    ///
    /// # Errors
    /// A column that names no target.
    pub fn bind(&self, targets: &[&str]) -> Result<Vec<Vec<f32>>> {
        let _ = targets;
        Err(Error::invalid("not written yet", ""))
    }
}
