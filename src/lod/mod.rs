//! Level of detail: an instance keeps its most important targets, as many as its size on the screen needs; the others
//! fade out.
//!
//! [`Importance`] ranks the targets of a mesh, and knows how far vertices may be off if only the first of them are
//! kept; it is made once for a mesh. [`Level`] is the number of targets that an instance keeps now: a real number that
//! follows the camera so slowly that nothing pops. [`Importance::apply`] applies it to weights, which any path takes:
//! with incremental updates, a target that is dropped is one more delta weight, and one that stays dropped costs
//! nothing. Crowds that are animated on the GPU apply it there
//! ([`Crowd::set_level`](crate::Crowd::set_level)).
//!
//! ```
//! use deltamorph::lod::{Importance, Level, pixels_per_unit};
//! use deltamorph::{DeltaFormat, PackDesc};
//!
//! let desc = deltamorph_head::HeadDesc { vertices: 500, ..Default::default() };
//! let mesh = deltamorph_head::head(&desc).pack(&PackDesc::new(DeltaFormat::Fast))?;
//! let importance = Importance::of_packed(&mesh, &["eyeBlink"])?;
//! let mut level = Level::new(1.0);
//! // Each frame, for each instance:
//! let mut weights = vec![0.3; mesh.layout().targets.len()];
//! let distance = 100.0 * mesh.layout().diagonal;
//! let kept = level.step(&importance, pixels_per_unit(1080.0, 0.6, distance), Some(&weights));
//! importance.apply(kept, &mut weights)?;
//! // crowd.set_weights(instance, &weights)?;
//! assert!(kept < weights.len() as f32 && weights.contains(&0.0));
//! # Ok::<(), deltamorph::Error>(())
//! ```

mod level;
#[cfg(test)]
mod tests;

pub use level::Level;

use crate::asset::{KeptMesh, KeptTarget};
use crate::error::{Result, ensure};
use crate::math::up;
use crate::pack::PackedMesh;
use crate::weights::names::unknown;
use glam::DVec3;
use std::collections::HashSet;

/// Returns the mean over all vertices of the squared distance that `target` moves them at weight 1, in squared input
/// units. [`Importance`] ranks by it; `deltamorph lod` calls it `mse`.
#[doc(hidden)]
pub fn mean_square(mesh: &KeptMesh, target: &KeptTarget) -> f64 {
    let sum: f64 = target.positions.iter().map(|d| d.as_dvec3().length_squared()).sum();
    sum / mesh.vertex_count().max(1) as f64
}

/// Returns targets by descending score, pinned ones before all others; equal ones in their own order. A target beyond
/// the end of `pinned` is not pinned.
#[doc(hidden)]
pub fn ranked(scores: &[f64], pinned: &[bool]) -> Vec<usize> {
    let is_pinned = |target: usize| pinned.get(target).is_some_and(|pinned| *pinned);
    let mut order: Vec<usize> = (0..scores.len()).collect();
    order.sort_by(|&a, &b| is_pinned(b).cmp(&is_pinned(a)).then(scores[b].total_cmp(&scores[a])));
    order
}

/// Whether `name` begins with one of `pins`.
#[doc(hidden)]
pub fn is_pinned<P: AsRef<str>>(name: &str, pins: &[P]) -> bool {
    pins.iter().any(|pin| name.starts_with(pin.as_ref()))
}

/// Returns the pixels that an input unit takes up at `distance` (in input units, above 0), in a perspective picture
/// `height` pixels high with a vertical angle of view of `angle` radians: height / (2 · tan(angle / 2) · distance).
/// Multiply by the world units that an input unit of the instance takes up.
pub fn pixels_per_unit(height: f32, angle: f32, distance: f32) -> f32 {
    height / (2.0 * (angle / 2.0).tan() * distance)
}

/// The targets of a mesh in order of importance, and the error of keeping only the first of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Importance {
    /// Targets by rank.
    order: Vec<u32>,
    /// Ranks by target.
    ranks: Vec<u32>,
    /// The farthest that each target moves a vertex at weight 1, in input units, rounded up.
    reaches: Vec<f32>,
    /// How far a vertex may be off, in input units, by number of targets kept, from none to all: the largest sum of
    /// |w_t · δ_t(v)| of any vertex v over the targets t that are dropped, for weights w from -1 to 1.
    errors: Vec<f32>,
    /// Number of targets that are always kept.
    pinned: usize,
}

/// The mesh to rank.
struct Deltas<'a> {
    mesh: &'a str,
    /// Names of targets.
    names: Vec<&'a str>,
    /// Number of vertices.
    vertices: usize,
    /// For each target, the vertices that it moves and the squared distances.
    moved: Vec<Vec<(usize, f64)>>,
}

impl Importance {
    /// Ranks the targets of a packed mesh by the mean square of the packed deltas. Targets whose names begin with one
    /// of `pins` come first, and are always kept.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) for a pin that no target's name begins with; the message suggests the
    /// nearest name.
    pub fn of_packed(mesh: &PackedMesh, pins: &[&str]) -> Result<Self> {
        Deltas::of(mesh).by_mean_square(pins)
    }

    /// Takes the order from the caller, such as the ranking of `deltamorph lod --json`: names of all targets, the most
    /// important first; the first `pinned` are always kept.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) for a name that is not a target, with the nearest name suggested; a
    /// name given twice; targets left out; or more pinned targets than there are.
    pub fn in_order(mesh: &PackedMesh, order: &[&str], pinned: usize) -> Result<Self> {
        let deltas = Deltas::of(mesh);
        let mut seen = HashSet::new();
        let place = |name: &&str| {
            let what =
                || format!("an order of importance names '{name}', which is no target of mesh '{}'", deltas.mesh);
            let target = deltas.names.iter().position(|target| target == name);
            let target = target.ok_or_else(|| unknown(what(), name, &deltas.names))?;
            let what = format!("an order of importance names '{name}' twice");
            ensure!(seen.insert(target), what, "name each target once");
            Ok(target)
        };
        let order: Vec<usize> = order.iter().map(place).collect::<Result<_>>()?;
        let given = order.len();
        let all = deltas.names.len();
        let mesh = deltas.mesh;
        let what = format!("an order of importance of {given} targets, {pinned} of them pinned, for mesh '{mesh}'");
        let fits = given == all && pinned <= all;
        ensure!(fits, what, format!("name all of its {all} targets, and pin no more"));
        Ok(deltas.ranked(&order, pinned))
    }

    /// Returns the targets, the most important first.
    #[doc(hidden)]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Returns the rank of each target: its position in the [`order`](Self::order), from 0.
    #[doc(hidden)]
    pub fn ranks(&self) -> &[u32] {
        &self.ranks
    }

    /// Returns the farthest that a target moves a vertex at weight 1, in input units; 0 for a target out of range.
    #[doc(hidden)]
    pub fn reach(&self, target: usize) -> f32 {
        self.reaches.get(target).copied().unwrap_or(0.0)
    }

    /// Returns the fewest targets to keep so that no vertex is off by more than `pixels`, if an input unit takes up
    /// `pixels_per_unit`: at least the pinned ones; all of them if an argument is NaN.
    pub(crate) fn level_for(&self, pixels_per_unit: f32, pixels: f32) -> usize {
        let fits = |kept: &usize| self.errors[*kept] * pixels_per_unit <= pixels;
        (self.pinned..self.order.len()).find(fits).unwrap_or(self.order.len())
    }

    /// Returns the factor on the weight of a target if `level` targets are kept: clamp(level − rank, 0, 1). With a
    /// fractional level, the last one is kept in part.
    #[doc(hidden)]
    pub fn factor(&self, target: usize, level: f32) -> f32 {
        self.ranks.get(target).map_or(0.0, |rank| (level - *rank as f32).clamp(0.0, 1.0))
    }

    /// Multiplies weights, one for each target, by their [`factor`](Self::factor)s. If all targets are kept, the
    /// weights stay bit for bit.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) if the number of weights is not that of targets.
    pub fn apply(&self, level: f32, weights: &mut [f32]) -> Result<()> {
        let what = || format!("{} weights given, but {} targets are ranked", weights.len(), self.ranks.len());
        let remedy = "rank the mesh that the weights are for";
        ensure!(weights.len() == self.ranks.len(), what(), remedy);
        for (target, weight) in weights.iter_mut().enumerate() {
            let factor = self.factor(target, level);
            // Not 0 · weight, which may be -0 or NaN.
            *weight = if factor > 0.0 { *weight * factor } else { 0.0 };
        }
        Ok(())
    }
}

impl<'a> Deltas<'a> {
    fn of(mesh: &'a PackedMesh) -> Self {
        let layout = mesh.layout();
        let names: Vec<&str> = layout.targets.iter().map(|target| &*target.name).collect();
        let mut moved = vec![vec![]; names.len()];
        for (target, moved) in moved.iter_mut().enumerate() {
            mesh.for_each_delta(target, |vertex, [x, y, z, ..]| {
                moved.push((vertex, DVec3::new(x, y, z).length_squared()));
            });
        }
        Self { mesh: &layout.name, names, vertices: layout.vertex_count, moved }
    }

    fn by_mean_square(&self, pins: &[&str]) -> Result<Importance> {
        if let Some(pin) = pins.iter().find(|pin| !self.names.iter().any(|name| name.starts_with(**pin))) {
            let what = format!("no target of mesh '{}' has a name that begins with '{pin}'", self.mesh);
            return Err(unknown(what, pin, &self.names));
        }
        // Not divided by the number of vertices, as in `mean_square`: a common factor does not change the order.
        let score = |moved: &Vec<(usize, f64)>| moved.iter().fold(0.0, |sum, (_, square)| sum + square);
        let scores: Vec<f64> = self.moved.iter().map(score).collect();
        let pinned: Vec<bool> = self.names.iter().map(|name| is_pinned(name, pins)).collect();
        let count = pinned.iter().filter(|pinned| **pinned).count();
        Ok(self.ranked(&ranked(&scores, &pinned), count))
    }

    fn ranked(&self, order: &[usize], pinned: usize) -> Importance {
        let mut ranks = vec![0; order.len()];
        let mut reaches = vec![0.0; order.len()];
        let mut moved = vec![0.0f64; self.vertices];
        let mut farthest = 0.0f64;
        let mut errors = vec![0.0; order.len() + 1];
        for (rank, &target) in order.iter().enumerate().rev() {
            let mut reach = 0.0f64;
            for (vertex, square) in &self.moved[target] {
                let length = square.sqrt();
                moved[*vertex] += length;
                farthest = farthest.max(moved[*vertex]);
                reach = reach.max(length);
            }
            ranks[target] = rank as u32;
            reaches[target] = up(reach);
            errors[rank] = up(farthest);
        }
        Importance { order: order.iter().map(|&target| target as u32).collect(), ranks, reaches, errors, pinned }
    }
}
