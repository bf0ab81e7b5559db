//! The built-in procedural head.
//!
//! A stylised head of about 24 cm from crown to chin, with a stump of neck, in centimetres: Y up, face towards
//! +Z, the head's own left at +X. The skin is one closed surface that folds inwards at eyes and mouth; eyeballs, upper
//! teeth, lower teeth and tongue are closed surfaces of their own behind it.
//!
//! A vertex is first a position in a net (`mesh`, `rows`), then a point in space (`shape`, `parts`). Targets of the
//! lids compute that point with other lids; others move points (`motion`).
//!
//! All numbers are computed by additions, multiplications, divisions and square roots, which IEEE 754 rounds the same
//! everywhere. The platform's `sin` and similar functions are not used, so the same description gives the same bits on
//! every machine.

#![forbid(unsafe_code)]

mod clip;
mod mesh;
mod motion;
mod parts;
mod random;
mod rows;
mod shape;
mod spot;
mod targets;

pub use clip::head_clip;
use deltamorph::Mesh;
use deltamorph::glam::Vec3;
use deltamorph::mesh::Faces;
pub use random::Rng;
use spot::{Part, Spot};

/// Description of the built-in head. The same description gives the same head on every machine.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadDesc {
    /// Number of vertices (≥ 5).
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

/// Makes the built-in head: exactly `desc.vertices` vertices and `desc.targets` targets.
///
/// Triangles, with texture coordinates split along a seam at the back, and without normals: [`pack`](Mesh::pack)
/// computes them. Fewer than 250 vertices make only the outline of a head, and below 1,000 or so some of teeth and
/// tongue are missing. The shape of the base pose does not depend on the seed; it is symmetric, and so are targets for
/// the left and the right side, up to the ends of their supports. The targets follow ARKit's documentation of their
/// names. At weight 1, no target alone pushes a part through another, given enough vertices to resolve it (10,000 or
/// so); this holds below 1 as well.
///
/// The tile of a part's texture coordinates, the whole part of `u`, identifies it: 0 is skin, 1 eyeballs (`v` goes from
/// the middle of the pupil, 0, over its edge at 0.08 and that of the iris at 0.21, to the back, 1), 2 teeth, 3 tongue
/// and the inside of the mouth. Vertices are in the order skin, left eye, right eye, upper teeth, lower teeth, tongue.
///
/// Targets are local, with smooth edges; the sizes of their supports vary around a mean of `sparsity`. Values of `desc`
/// outside their range are clamped into it (a `sparsity` that is not a number counts as the default's).
pub fn head(desc: &HeadDesc) -> Mesh {
    // Vertex numbers and face corners (about six per vertex) are 32-bit.
    let vertices = desc.vertices.clamp(5, 1 << 28);
    let sparsity = if desc.sparsity.is_nan() { HeadDesc::default().sparsity } else { desc.sparsity };
    let desc = HeadDesc { sparsity: sparsity.clamp(f32::MIN_POSITIVE, 1.0), ..desc.clone() };
    let mesh::Net { spots, texcoords, corners } = mesh::Net::new(vertices);
    let positions: Vec<Vec3> = spots.iter().map(|s| place(s, shape::Lids::REST)).collect();
    let targets = targets::targets(&desc, &spots, &positions);
    let faces = Faces { sizes: vec![3; corners.len() / 3], corners };
    Mesh { name: "head".to_owned(), positions, texcoords, faces, targets, ..Mesh::default() }
}

/// The middle of the left eyeball, and its radius.
const EYE: Vec3 = Vec3::new(3.15, 1.0, 6.55);
const EYE_RADIUS: f32 = 1.6;
/// The height of the line between the lips, and the distance of its ends from the middle.
const MOUTH_HEIGHT: f32 = -5.4;
const HALF_MOUTH: f32 = 2.55;
/// The height of the middle of the tongue.
const TONGUE_HEIGHT: f32 = -6.1;

/// Returns the position of a vertex.
fn place(spot: &Spot, lids: shape::Lids) -> Vec3 {
    let p = match (spot.part, spot.behind) {
        (Part::Skin, None) => shape::skin(spot.a, spot.t, spot.lower, lids),
        (Part::Skin, Some((slit, depth))) => shape::behind(slit, spot, depth, lids),
        (part, _) => parts::point(part, spot.a, spot.t),
    };
    if spot.mirrored { Vec3::new(-p.x, p.y, p.z) } else { p }
}

/// Sine of an angle in [−π, π], as a polynomial: see the crate's documentation.
fn sin(x: f64) -> f64 {
    use std::f64::consts::{FRAC_PI_2, PI};
    let x = if x.abs() > FRAC_PI_2 { PI.copysign(x) - x } else { x };
    let q = x * x;
    let series = [1.0 / 6227020800.0, -1.0 / 39916800.0, 1.0 / 362880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0];
    x * series.into_iter().fold(0.0, |sum, c| sum * q + c)
}

fn cos(x: f64) -> f64 {
    sin(std::f64::consts::FRAC_PI_2 - x.abs())
}

fn mix(a: f32, b: f32, x: f32) -> f32 {
    a + (b - a) * x
}

/// Returns 3x² − 2x³ between `low` and `high`, 0 below and 1 above (the reverse if `low > high`).
fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
