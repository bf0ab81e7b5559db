//! Weight clips from CSV.
use super::WeightClip;
use crate::error::{Error, Result};
use std::path::Path;

/// Read a weights CSV: header of target names, one row per frame.
pub fn read(path: &Path, fps: f32) -> Result<WeightClip> {
    let _ = (path, fps);
    Err(Error::invalid("not written yet", ""))
}

/// Write a weights CSV.
pub fn write(path: &Path, clip: &WeightClip) -> Result<()> {
    let _ = (path, clip);
    Err(Error::invalid("not written yet", ""))
}
