//! The built-in procedural head.
//!
//! A stylised head of about 24 cm from crown to chin, with a stump of neck, in centimetres: Y up, face towards
//! +Z, the head's own left at +X. Everything is made with additions, multiplications, divisions and square roots,
//! which IEEE 754 rounds the same everywhere; `sin` and friends of the platform's library are not used, so that
//! the same description gives the same bits on every machine.

mod clip;
mod shape;
mod targets;

use crate::asset::MorphSource;
use crate::setters::setters;
pub use clip::head_clip;

/// What the built-in head is made from. Same description, same head, on every machine.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
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

setters!(HeadDesc { vertices: usize, targets: usize, sparsity: f32, seed: u64 });

impl Default for HeadDesc {
    /// 43,788 vertices and 72 targets, the size in Costigan et al. (MIG 2016).
    fn default() -> Self {
        Self { vertices: 43_788, targets: 72, sparsity: 0.12, seed: 1 }
    }
}

/// The built-in head as a source: exactly `desc.vertices` vertices and `desc.targets` targets.
///
/// Triangles, with texture coordinates split along a seam at the back, and without normals:
/// [`to_mesh`](MorphSource::to_mesh) computes them. Fewer than three vertices have no face. The shape of the base
/// pose does not depend on the seed. Targets are local, with smooth edges; how large their supports are varies
/// between targets around a mean of `sparsity`. The target `tongueOut` is empty, as in many captured heads (there
/// is no tongue), unless `sparsity` is 1. Values of `desc` outside their range are clamped into it (a `sparsity`
/// that is not a number counts as the default's).
pub fn head(desc: &HeadDesc) -> MorphSource {
    // Vertex numbers and face corners (about six per vertex) are 32-bit.
    let base = shape::base(desc.vertices.clamp(1, 1 << 28));
    let sparsity = if desc.sparsity.is_nan() { HeadDesc::default().sparsity } else { desc.sparsity };
    let desc = desc.clone().sparsity(sparsity.clamp(f32::MIN_POSITIVE, 1.0));
    MorphSource { name: "head".to_owned(), targets: targets::targets(&desc, &base.positions), ..base }
}

/// 3x² − 2x³ between `low` and `high`, 0 below and 1 above (the other way round where `low > high`).
fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
