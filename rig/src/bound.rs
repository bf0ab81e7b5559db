//! A rig bound to the targets of a mesh, which converts weights of controls to weights of targets.

use super::Control;
use deltamorph::internals::weights::names::unknown;
use deltamorph::{BoundClip, ClipLayer, Error, Repeat, Result, WeightClip};
use std::collections::HashSet;

/// [`BoundRig::smooth`] takes the wanted value once it is this near: an exponential approach has no end, and each
/// change of a weight costs an update.
const THERE: f32 = 1e-4;

/// A [`Rig`](super::Rig) bound to the targets of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoundRig {
    /// Names of the targets.
    targets: Vec<String>,
    controls: Vec<Drive>,
    correctives: Vec<Product>,
}

#[derive(Clone, Debug, PartialEq)]
struct Drive {
    name: String,
    limits: [f32; 2],
    smoothing: f32,
    /// Keys below 0 and above it: their distances from 0 and their targets, the nearest first.
    sides: [Vec<(f32, usize)>; 2],
    /// Targets in proportion, and their weights at the value 1.
    parts: Vec<(usize, f32)>,
    is_binary: bool,
    /// Indices of the controls that suppress it, and whether each blocks it or attenuates it.
    suppressed_by: Vec<(usize, bool)>,
}

#[derive(Clone, Debug, PartialEq)]
struct Product {
    target: usize,
    /// Indices of controls.
    factors: Vec<usize>,
}

impl BoundRig {
    pub(super) fn new(targets: &[&str]) -> Self {
        Self { targets: targets.iter().map(|&name| name.to_owned()).collect(), ..Self::default() }
    }

    pub(super) fn add_control(&mut self, control: &Control, keys: Vec<(f32, usize)>, parts: Vec<(usize, f32)>) {
        let side = |sign: f32| {
            let keys = keys.iter().map(|(at, target)| (at * sign, *target)).filter(|(at, _)| *at > 0.0);
            let mut keys: Vec<_> = keys.collect();
            keys.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            keys
        };
        let (name, sides) = (control.name.clone(), [side(-1.0), side(1.0)]);
        let &Control { limits, smoothing, is_binary, .. } = control;
        self.controls.push(Drive { name, limits, smoothing, sides, parts, is_binary, suppressed_by: vec![] });
    }

    /// Adds for each a control, the one that suppresses it, and whether that blocks it.
    pub(super) fn add_suppressed(&mut self, all: Vec<(usize, usize, bool)>) {
        all.into_iter().for_each(|(control, by, blocks)| self.controls[control].suppressed_by.push((by, blocks)));
    }

    pub(super) fn add_correctives(&mut self, correctives: impl Iterator<Item = (usize, Vec<usize>)>) {
        self.correctives.extend(correctives.map(|(target, factors)| Product { target, factors }));
    }

    /// Iterates over the targets that keys drive; a target may come several times.
    pub(super) fn driven(&self) -> impl Iterator<Item = usize> {
        self.controls.iter().flat_map(Drive::driven)
    }

    /// Returns the names of the controls, in the order of the weights that [`evaluate`](Self::evaluate) takes.
    /// [Bind](WeightClip::bind) clips to them.
    pub fn controls(&self) -> impl ExactSizeIterator<Item = &str> {
        self.controls.iter().map(|control| control.name.as_str())
    }

    /// Computes weights of the targets from weights of the controls, which are clamped to their limits. If several
    /// controls or correctives drive a target, its weight is their sum. The content of `weights` is replaced. Allocates
    /// nothing.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the number of weights is not that of controls or targets, or a weight is not finite.
    /// Nothing changes then.
    pub fn evaluate(&self, controls: &[f32], weights: &mut [f32]) -> Result<()> {
        self.check(controls)?;
        if weights.len() != self.targets.len() {
            let what = format!("{} weights for the rig's {} targets", weights.len(), self.targets.len());
            return Err(Error::invalid(what, "give one per target of the mesh that the rig is bound to"));
        }
        weights.fill(0.0);
        for (i, control) in self.controls.iter().enumerate() {
            control.add(self.value(i, controls), weights);
        }
        for Product { target, factors } in &self.correctives {
            let factor = |&i: &usize| self.value(i, controls).max(0.0);
            weights[*target] += factors.iter().map(factor).product::<f32>();
        }
        Ok(())
    }

    /// The value of a control that its targets follow: within its limits, 0 or 1 if it is binary, less what suppresses it.
    fn value(&self, control: usize, controls: &[f32]) -> f32 {
        let own = |i: usize| {
            let value = self.controls[i].limited(controls[i]);
            if self.controls[i].is_binary { f32::from(value > 0.5) } else { value }
        };
        let Drive { suppressed_by, is_binary, .. } = &self.controls[control];
        let mut left = 1.0f32;
        for &(by, blocks) in suppressed_by {
            let value = own(by).max(0.0);
            left = if blocks && value > 0.0 { 0.0 } else { left - value };
        }
        let left = if *is_binary && left < 1.0 { 0.0 } else { left.max(0.0) };
        own(control) * left
    }

    /// Moves `current`, weights of the controls, towards `wanted`, which is clamped to the limits first. Each control
    /// covers the share 1 − exp(−seconds / [smoothing](super::Control::smoothing)) of the way, so the result does not
    /// depend on the number of frames in a time. A control within 1e-4 of its wanted weight takes it, and changes no
    /// more. Allocates nothing.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the number of weights is not that of controls, a number is not finite, or `seconds` is
    /// below 0. Nothing changes then.
    pub fn smooth(&self, current: &mut [f32], wanted: &[f32], seconds: f32) -> Result<()> {
        self.check(current)?;
        self.check(wanted)?;
        if !(seconds.is_finite() && seconds >= 0.0) {
            let what = format!("{seconds} seconds since the last frame");
            return Err(Error::invalid(what, "use a finite number, 0 or more"));
        }
        for ((control, current), wanted) in self.controls.iter().zip(current).zip(wanted) {
            let wanted = control.limited(*wanted);
            // No time, no change, even without smoothing.
            let part = if seconds == 0.0 { 0.0 } else { 1.0 - (-seconds / control.smoothing).exp() };
            let next = *current + (wanted - *current) * part;
            *current = if (wanted - next).abs() <= THERE && part > 0.0 { wanted } else { next };
        }
        Ok(())
    }

    /// Returns the clip of target weights that a clip of control weights drives, smoothed from its first frame on. It
    /// has `fps` frames a second; give at least those of `clip`. Between frames target weights are interpolated
    /// linearly, which is inexact where a control passes a key: more frames reduce the error.
    ///
    /// The clip has a column for each target that the columns of `clip` drive, alone or with others.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a column that names no control, anything else that [`WeightClip::bind`] refuses, `fps`
    /// that is not a finite number above 0, or a result of more than 2²⁴ weights.
    pub fn bake(&self, clip: &WeightClip, fps: f32) -> Result<WeightClip> {
        for rate in [clip.fps, fps] {
            if !(rate.is_finite() && rate > 0.0) {
                let what = format!("clip '{}': {rate} frames a second", clip.name);
                return Err(Error::invalid(what, "use a finite number above 0"));
            }
        }
        let controls: Vec<&str> = self.controls().collect();
        let known: HashSet<&str> = self.controls().collect();
        if let Some(name) = clip.names.iter().find(|name| !known.contains(name.as_str())) {
            let what = format!("clip '{}': column '{name}' names no control of the rig", clip.name);
            return Err(unknown(what, name, "control of the rig", &controls));
        }
        let bound = clip.bind(&controls)?;
        let columns = self.columns(&clip.names);
        let frames = frames(&bound, fps);
        // At least one column, since a clip without columns takes time, too.
        if frames * columns.len().max(1) as f64 > f64::from(1 << 24) {
            let what = format!("clip '{}': more than 2^24 weights at {fps} frames a second", clip.name);
            return Err(Error::invalid(what, "bake it with fewer frames a second, or split it"));
        }
        let names = columns.iter().map(|&target| self.targets[target].clone()).collect();
        let mut baked = WeightClip { name: clip.name.clone(), names, fps, values: vec![] };
        let (mut wanted, mut current) = (vec![0.0; controls.len()], vec![]);
        let mut weights = vec![0.0; self.targets.len()];
        for frame in 0..frames as usize {
            let at = ClipLayer::new(&bound, frame as f64 / f64::from(fps)).repeat(Repeat::Once);
            ClipLayer::mix(&[at], &mut wanted)?;
            if current.is_empty() {
                current.clone_from(&wanted);
            }
            self.smooth(&mut current, &wanted, 1.0 / fps)?;
            self.evaluate(&current, &mut weights)?;
            baked.values.extend(columns.iter().map(|&target| weights[target]));
        }
        Ok(baked)
    }

    /// Returns the targets that controls of these names drive, alone or with others, in the mesh's order.
    fn columns(&self, names: &[String]) -> Vec<usize> {
        let names: HashSet<&String> = names.iter().collect();
        let named = |control: &Drive| names.contains(&control.name);
        let mut driven: HashSet<usize> = self.controls.iter().filter(|c| named(c)).flat_map(Drive::driven).collect();
        let products =
            self.correctives.iter().filter(|product| product.factors.iter().any(|&i| named(&self.controls[i])));
        driven.extend(products.map(|product| product.target));
        (0..self.targets.len()).filter(|target| driven.contains(target)).collect()
    }

    fn check(&self, controls: &[f32]) -> Result<()> {
        if controls.len() != self.controls.len() {
            let what = format!("{} weights for the rig's {} controls", controls.len(), self.controls.len());
            return Err(Error::invalid(what, "give one per control, in the order of BoundRig::controls"));
        }
        match controls.iter().position(|value| !value.is_finite()) {
            Some(i) => {
                let what = format!("control '{}' of the rig: the weight is {}", self.controls[i].name, controls[i]);
                Err(Error::invalid(what, "replace it with a finite number"))
            }
            None => Ok(()),
        }
    }
}

impl Drive {
    fn driven(&self) -> impl Iterator<Item = usize> {
        self.sides.iter().flatten().map(|(_, target)| *target).chain(self.parts.iter().map(|(target, _)| *target))
    }

    fn limited(&self, value: f32) -> f32 {
        value.clamp(self.limits[0], self.limits[1])
    }

    fn add(&self, value: f32, weights: &mut [f32]) {
        self.parts.iter().for_each(|(target, weight)| weights[*target] += value * weight);
        let [below, above] = &self.sides;
        let (side, other) = if value < 0.0 { (below, above) } else { (above, below) };
        let distance = value.abs();
        // The nearest key at or beyond the value.
        match side.iter().position(|(at, _)| distance <= *at) {
            Some(0) => weights[side[0].1] += distance / side[0].0,
            Some(next) => {
                let [(nearer, from), (farther, to)] = [side[next - 1], side[next]];
                let t = (distance - nearer) / (farther - nearer);
                weights[from] += 1.0 - t;
                weights[to] += t;
            }
            None => match (side.last(), other.first()) {
                (Some((at, target)), _) => weights[*target] += distance / at,
                (None, Some((at, target))) => weights[*target] -= distance / at,
                (None, None) => {}
            },
        }
    }
}

/// Returns the number of frames of a clip at another rate: one for each frame that begins before the last one of the
/// clip, and one at or after it.
fn frames(clip: &BoundClip, fps: f32) -> f64 {
    let Some(intervals) = clip.frame_count().checked_sub(1) else { return 0.0 };
    // Rounding must not add a frame if the rates are equal.
    (intervals as f64 * f64::from(fps) / f64::from(clip.fps) - 1e-6).ceil().max(0.0) + 1.0
}
