//! Level of detail: the most important targets of a head are kept, as many as its size on the screen needs, and the others
//! fade out.
//!
//! [`Importance`] is the order of a mesh's targets, and how far vertices may be off where only the first of them are kept: made
//! once for a mesh. [`Level`] is how many a head keeps now, a real number that follows the camera so slowly that nothing pops.
//! [`Importance::apply`] puts it into weights, which any path takes: on incremental ones, a target that is dropped is one more
//! delta weight, and one that stays dropped costs nothing. Crowds that are animated on the GPU apply it there
//! ([`AnimatedCrowd::set_level`](crate::AnimatedCrowd::set_level)), and choose it there too, from a [`Camera`] and the
//! [`Place`] of each head ([`AnimationDesc::level`](field@crate::AnimationDesc::level)).
//!
//! ```
//! use deltamorph::lod::{Importance, Level, LevelDesc, pixels_per_unit};
//! use deltamorph::{DeltaFormat, PackDesc, PackedMesh, Tolerance};
//!
//! let head = deltamorph_head::head(&deltamorph_head::HeadDesc::default().vertices(500)).to_mesh(Tolerance::default())?;
//! let mesh = PackedMesh::pack(&head, &PackDesc::new(DeltaFormat::Fast))?;
//! let importance = Importance::of_packed(&mesh, &["eyeBlink"])?;
//! let mut level = Level::new(LevelDesc::default().pixels(1.0));
//! // Each frame, for each head:
//! let mut weights = vec![0.3; mesh.layout().targets.len()];
//! let distance = 100.0 * mesh.layout().diagonal;
//! let kept = level.step(&importance, pixels_per_unit(1080.0, 0.6, distance), Some(&weights));
//! importance.apply(kept, &mut weights)?;
//! // crowd.set_weights(head, &weights)?;
//! assert!(kept < weights.len() as f32 && weights.contains(&0.0));
//! # Ok::<(), deltamorph::Error>(())
//! ```

mod level;
mod place;
#[cfg(test)]
mod tests;

pub use level::{Level, LevelDesc};
pub use place::{Camera, Place};

use crate::asset::{MorphMesh, MorphTarget};
use crate::error::{Error, Result};
use crate::pack::PackedMesh;
use crate::weights::names::unknown;
use glam::DVec3;
use std::collections::HashSet;

/// Mean over all vertices of the squared distance that `target` moves them at weight 1, in squared input units: what
/// [`Importance`] ranks by, and `deltamorph lod` calls `mse`.
pub fn mean_square(mesh: &MorphMesh, target: &MorphTarget) -> f64 {
    let sum: f64 = target.positions.iter().map(|d| d.as_dvec3().length_squared()).sum();
    sum / mesh.vertex_count().max(1) as f64
}

/// Targets by their scores, the largest first, those that are pinned before all others; equals in their own order. A target
/// without an entry in `pinned` is not.
pub fn ranked(scores: &[f64], pinned: &[bool]) -> Vec<usize> {
    let is_pinned = |target: usize| pinned.get(target).is_some_and(|pinned| *pinned);
    let mut order: Vec<usize> = (0..scores.len()).collect();
    order.sort_by(|&a, &b| is_pinned(b).cmp(&is_pinned(a)).then(scores[b].total_cmp(&scores[a])));
    order
}

/// Whether a name is meant by one of `pins`: by itself, or by a beginning of it.
pub fn is_pinned<P: AsRef<str>>(name: &str, pins: &[P]) -> bool {
    pins.iter().any(|pin| name.starts_with(pin.as_ref()))
}

/// Pixels that an input unit takes up at `distance` (in input units, above 0), in a perspective picture of `height` pixels with
/// an angle of view of `angle` radians from bottom to top: height / (2 · tan(angle / 2) · distance). Multiply by the scale of
/// the head's place.
pub fn pixels_per_unit(height: f32, angle: f32, distance: f32) -> f32 {
    height / (2.0 * (angle / 2.0).tan() * distance)
}

/// The targets of a mesh, the most important first, and what is lost where only the first of them are kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Importance {
    /// By rank.
    order: Vec<u32>,
    /// By target.
    ranks: Vec<u32>,
    /// By target: the farthest that it moves a vertex at weight 1, in input units, rounded up.
    reaches: Vec<f32>,
    /// By number of targets kept, 0 to all.
    errors: Vec<f32>,
    /// Targets that are always kept.
    pinned: usize,
}

/// Calls back with each vertex that a target moves, and how far.
type EachDelta<'a> = dyn Fn(usize, &mut dyn FnMut(usize, DVec3)) + 'a;

/// What moves: names of targets, vertices, and the position deltas of a target.
struct Deltas<'a> {
    mesh: &'a str,
    names: Vec<&'a str>,
    vertices: usize,
    each: &'a EachDelta<'a>,
}

impl Importance {
    /// Of the targets of `mesh` by their [`mean_square`], those whose names begin with one of `pins` before all others: these
    /// are always kept.
    ///
    /// # Errors
    /// A pin that no target's name begins with, with the name that was probably meant.
    pub fn of(mesh: &MorphMesh, pins: &[&str]) -> Result<Self> {
        with_deltas(mesh, |deltas| deltas.by_mean_square(pins))
    }

    /// As [`of`](Self::of), of the deltas that the kernels see: where there are only packed ones.
    ///
    /// # Errors
    /// As [`of`](Self::of).
    pub fn of_packed(mesh: &PackedMesh, pins: &[&str]) -> Result<Self> {
        with_packed(mesh, |deltas| deltas.by_mean_square(pins))
    }

    /// In an order of your own, such as one that `deltamorph lod --out` wrote: names of all targets, the most important first,
    /// of which the first `pinned` are always kept.
    ///
    /// # Errors
    /// A name that is none of the targets, with the one that was probably meant; a name twice; not all targets; more pinned
    /// than there are.
    pub fn in_order(mesh: &PackedMesh, order: &[&str], pinned: usize) -> Result<Self> {
        with_packed(mesh, |deltas| deltas.by_names(order, pinned))
    }

    /// With [errors](Self::error_of_keeping) for these weights, one for each target and frame, in place of any from -1 to 1:
    /// for heads that play what is known, of which fewer targets have to be kept. The order stays.
    ///
    /// # Errors
    /// Another mesh than was ranked, or weights of another: their numbers of targets tell.
    pub fn over(mut self, mesh: &PackedMesh, frames: impl IntoIterator<Item = Vec<f32>>) -> Result<Self> {
        let (targets, layout) = (self.order.len(), mesh.layout());
        let check = |given: usize, what: &str| match given == targets {
            true => Ok(()),
            false => {
                let what = format!("{what} of {given} targets, but {targets} are ranked");
                Err(Error::invalid(what, "rank the mesh that the weights are for"))
            }
        };
        check(layout.targets.len(), "a mesh")?;
        self.errors.fill(0.0);
        // Lengths of the deltas of each target.
        let mut lengths: Vec<Vec<(usize, f64)>> = vec![vec![]; targets];
        for (target, lengths) in lengths.iter_mut().enumerate() {
            mesh.for_each_delta(target, |vertex, [x, y, z, ..]| {
                lengths.push((vertex, DVec3::new(x, y, z).length()));
            });
        }
        let mut moved = vec![0.0f64; layout.vertex_count];
        for weights in frames {
            check(weights.len(), "weights")?;
            moved.fill(0.0);
            let mut farthest = 0.0f64;
            for (rank, &target) in self.order.iter().enumerate().rev() {
                let weight = f64::from(weights[target as usize].abs());
                for &(vertex, length) in lengths[target as usize].iter().filter(|_| weight > 0.0) {
                    moved[vertex] += weight * length;
                    farthest = farthest.max(moved[vertex]);
                }
                self.errors[rank] = self.errors[rank].max(above(farthest));
            }
        }
        Ok(self)
    }

    /// The targets, the most important first.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// For each target its place in the [`order`](Self::order), from 0.
    pub fn ranks(&self) -> &[u32] {
        &self.ranks
    }

    /// How many targets there are.
    pub fn target_count(&self) -> usize {
        self.order.len()
    }

    /// How far a vertex may be off where only the first `kept` targets are applied, in input units: the largest
    /// Σ |w_t · δ_t(v)| of any vertex v over the targets t that are dropped, for weights w from -1 to 1, or those of
    /// [`over`](Self::over). 0 where all are kept.
    pub fn error_of_keeping(&self, kept: usize) -> f32 {
        self.errors.get(kept).copied().unwrap_or(0.0)
    }

    /// The farthest that a target moves a vertex at weight 1, in input units; 0 of one that there is not.
    pub fn reach(&self, target: usize) -> f32 {
        self.reaches.get(target).copied().unwrap_or(0.0)
    }

    /// How many of the first targets are always kept.
    pub(crate) fn pinned(&self) -> usize {
        self.pinned
    }

    /// The fewest targets to keep so that no vertex is off by more than `pixels` where an input unit takes up
    /// `pixels_per_unit`: those pinned at least, all of them where a number is no number.
    pub fn level_for(&self, pixels_per_unit: f32, pixels: f32) -> usize {
        let fits = |kept: &usize| self.errors[*kept] * pixels_per_unit <= pixels;
        (self.pinned..self.order.len()).find(fits).unwrap_or(self.order.len())
    }

    /// What the weight of a target is multiplied by at `level`, how many are kept: clamp(level − rank, 0, 1). So the one at
    /// the end of the list is there in part.
    pub fn factor(&self, target: usize, level: f32) -> f32 {
        self.ranks.get(target).map_or(0.0, |rank| (level - *rank as f32).clamp(0.0, 1.0))
    }

    /// Multiply weights, one for each target, by their [`factor`](Self::factor)s. Where all targets are kept, they stay as they
    /// are bit for bit.
    ///
    /// # Errors
    /// Another number of weights than there are targets.
    pub fn apply(&self, level: f32, weights: &mut [f32]) -> Result<()> {
        if weights.len() != self.ranks.len() {
            let what = format!("{} weights given, but {} targets are ranked", weights.len(), self.ranks.len());
            return Err(Error::invalid(what, "rank the mesh that the weights are for"));
        }
        // Not 0 · weight: that may be -0, or no number.
        let scaled = |weight: f32, factor: f32| if factor > 0.0 { weight * factor } else { 0.0 };
        let ranked = weights.iter_mut().zip(&self.ranks);
        ranked.for_each(|(weight, rank)| *weight = scaled(*weight, (level - *rank as f32).clamp(0.0, 1.0)));
        Ok(())
    }
}

fn with_deltas<R>(mesh: &MorphMesh, of: impl FnOnce(&Deltas<'_>) -> R) -> R {
    let each = |target: usize, f: &mut dyn FnMut(usize, DVec3)| {
        let MorphTarget { vertices, positions, .. } = &mesh.targets[target];
        vertices.iter().zip(positions).for_each(|(&vertex, delta)| f(vertex as usize, delta.as_dvec3()));
    };
    let names = mesh.targets.iter().map(|target| &*target.name).collect();
    of(&Deltas { mesh: &mesh.name, names, vertices: mesh.vertex_count(), each: &each })
}

fn with_packed<R>(mesh: &PackedMesh, of: impl FnOnce(&Deltas<'_>) -> R) -> R {
    let each = |target: usize, f: &mut dyn FnMut(usize, DVec3)| {
        mesh.for_each_delta(target, |vertex, [x, y, z, ..]| f(vertex, DVec3::new(x, y, z)));
    };
    let layout = mesh.layout();
    let names = layout.targets.iter().map(|target| &*target.name).collect();
    of(&Deltas { mesh: &layout.name, names, vertices: layout.vertex_count, each: &each })
}

impl Deltas<'_> {
    fn by_mean_square(&self, pins: &[&str]) -> Result<Importance> {
        if let Some(pin) = pins.iter().find(|pin| !self.names.iter().any(|name| name.starts_with(**pin))) {
            let what = format!("no target of mesh '{}' has a name that begins with '{pin}'", self.mesh);
            return Err(unknown(what, pin, "target of the mesh", &self.names));
        }
        let score = |target: usize| {
            let mut sum = 0.0;
            (self.each)(target, &mut |_, delta| sum += delta.length_squared());
            // As `mean_square`: what all have in common changes no order.
            sum
        };
        let scores: Vec<f64> = (0..self.names.len()).map(score).collect();
        let pinned: Vec<bool> = self.names.iter().map(|name| is_pinned(name, pins)).collect();
        let count = pinned.iter().filter(|pinned| **pinned).count();
        Ok(self.ranked(&ranked(&scores, &pinned), count))
    }

    fn by_names(&self, order: &[&str], pinned: usize) -> Result<Importance> {
        let mut seen = HashSet::new();
        let place = |name: &&str| {
            let what = || format!("an order of importance names '{name}', which is no target of mesh '{}'", self.mesh);
            let target = self.names.iter().position(|target| target == name);
            let target = target.ok_or_else(|| unknown(what(), name, "target of the mesh", &self.names))?;
            if seen.insert(target) {
                return Ok(target);
            }
            Err(Error::invalid(format!("an order of importance names '{name}' twice"), "name each target once"))
        };
        let order: Vec<usize> = order.iter().map(place).collect::<Result<_>>()?;
        if order.len() != self.names.len() || pinned > order.len() {
            let (given, all) = (order.len(), self.names.len());
            let what =
                format!("an order of importance of {given} targets, {pinned} of them pinned, for mesh '{}'", self.mesh);
            return Err(Error::invalid(what, format!("name all of its {all} targets, and pin no more")));
        }
        Ok(self.ranked(&order, pinned))
    }

    fn ranked(&self, order: &[usize], pinned: usize) -> Importance {
        let (mut ranks, mut reaches) = (vec![0; order.len()], vec![0.0; order.len()]);
        let (mut moved, mut farthest) = (vec![0.0f64; self.vertices], 0.0f64);
        let mut errors = vec![0.0; order.len() + 1];
        for (rank, &target) in order.iter().enumerate().rev() {
            let mut reach = 0.0f64;
            (self.each)(target, &mut |vertex, delta| {
                let length = delta.length();
                moved[vertex] += length;
                (farthest, reach) = (farthest.max(moved[vertex]), reach.max(length));
            });
            ranks[target] = rank as u32;
            reaches[target] = above(reach);
            errors[rank] = above(farthest);
        }
        Importance { order: order.iter().map(|&target| target as u32).collect(), ranks, reaches, errors, pinned }
    }
}

/// Not below `value`; 0 stays 0.
fn above(value: f64) -> f32 {
    let near = value as f32;
    if f64::from(near) < value { near.next_up() } else { near }
}
