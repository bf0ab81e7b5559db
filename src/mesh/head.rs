//! The built-in procedural head.
use super::MorphSource;
use crate::weights::WeightClip;

/// What the built-in head is made from. Same description, same head, on every machine.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadDesc {
    /// Number of vertices (≥ 1).
    pub vertices: usize,
    /// Number of targets (≥ 0); the 52 ARKit names come first.
    pub targets: usize,
    /// Mean fraction of the vertices that a target moves, in (0, 1]; 1 moves every vertex with every target.
    pub sparsity: f32,
    /// Seed.
    pub seed: u64,
}

impl Default for HeadDesc {
    /// 43,788 vertices and 72 targets, the size in Costigan et al. (MIG 2016).
    fn default() -> Self {
        Self { vertices: 43_788, targets: 72, sparsity: 0.12, seed: 1 }
    }
}

/// The built-in head as a source.
pub fn head(desc: &HeadDesc) -> MorphSource {
    let _ = desc;
    MorphSource::default()
}

/// A capture-like weight clip for the built-in head.
pub fn head_clip(desc: &HeadDesc, frames: usize, fps: f32) -> WeightClip {
    let _ = (desc, frames, fps);
    WeightClip::default()
}
