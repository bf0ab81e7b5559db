//! How many targets a head keeps: after the camera, but so slowly that nothing pops.

use super::Importance;
use crate::setters::setters;

/// The share of the pixels that targets left out may take; changes that an error budget defers take the rest.
const SHARE: f32 = 0.5;
/// Fewer targets are kept once so much of the pixels is enough, more once all of them are exceeded: a camera that trembles
/// changes nothing.
const MARGIN: f32 = 0.8;

/// How levels of detail are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct LevelDesc {
    /// How far a vertex may be from where all weights would put it, in pixels (≥ 0), once the level has settled: half of it by
    /// targets that are left out ([`Level::step`]), half by changes that are deferred ([`error_budget`](Self::error_budget)).
    /// 1 by default.
    pub pixels: f32,
    /// How far any vertex may move from one frame to the next because the level changes, in pixels (above 0). 0.008 by
    /// default: what that changes in pictures is in docs/results/fly.md.
    pub fade: f32,
}

setters!(LevelDesc { pixels: f32, fade: f32 });

impl Default for LevelDesc {
    fn default() -> Self {
        Self { pixels: 1.0, fade: 0.008 }
    }
}

impl LevelDesc {
    /// Pixels that a vertex may be off because targets are left out: more are kept once a vertex is off by more than the
    /// first, fewer once it is off by no more than the second with fewer.
    pub(crate) fn bounds(&self) -> [f32; 2] {
        [self.pixels * SHARE, self.pixels * SHARE * MARGIN]
    }

    /// The error budget of updates that belongs to these pixels, in input units, for
    /// [`UpdateDesc::error_budget`](field@crate::UpdateDesc::error_budget), where an input unit takes up `pixels_per_unit`. 0, which
    /// defers nothing, where that is no number above 0.
    pub fn error_budget(&self, pixels_per_unit: f32) -> f32 {
        let budget = (1.0 - SHARE) * self.pixels / pixels_per_unit;
        if budget.is_finite() { budget.max(0.0) } else { 0.0 }
    }
}

/// How many targets a head keeps now, and how many it is about to.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    desc: LevelDesc,
    /// `None`: nothing has been shown yet, and nothing can pop.
    level: Option<f64>,
    goal: usize,
}

impl Level {
    /// Of a head that has not been shown yet.
    pub fn new(desc: LevelDesc) -> Self {
        Self { desc, level: None, goal: 0 }
    }

    /// How many targets are kept in the frame of the last [`step`](Self::step): `None` before the first.
    pub fn level(&self) -> Option<f32> {
        self.level.map(|level| level as f32)
    }

    /// How many targets it is about to keep.
    pub fn goal(&self) -> usize {
        self.goal
    }

    /// The next frame has no predecessor (the head was hidden, or the camera has cut): the level is at its goal at once.
    pub fn cut(&mut self) {
        self.level = None;
    }

    /// The next frame, in which an input unit takes up `pixels_per_unit` ([`pixels_per_unit`](super::pixels_per_unit)): how
    /// many targets are kept, for [`Importance::apply`]. It goes as far towards its goal as may be without any vertex moving
    /// further than [`LevelDesc::fade`]: with `weights`, the whole ones of this frame, by what they make of the targets that
    /// come or go (those without a weight cost nothing); without, as if all weights were 1.
    ///
    /// While `pixels_per_unit` stays within a fifth of what it was, the level stays where it is, bit for bit, once it
    /// has settled. Where it is no number, or infinite, all targets are kept at once.
    pub fn step(&mut self, importance: &Importance, pixels_per_unit: f32, weights: Option<&[f32]>) -> f32 {
        let [most, enough] = self.desc.bounds();
        let all = importance.target_count();
        let wanted = importance.level_for(pixels_per_unit, enough);
        let exceeded = importance.level_for(pixels_per_unit, most) > self.goal;
        if self.level.is_none() || exceeded || wanted < self.goal {
            self.goal = wanted.min(all);
        }
        let level = match self.level {
            Some(level) if pixels_per_unit.is_finite() => self.towards(importance, pixels_per_unit, weights, level),
            Some(_) | None => self.goal as f64,
        };
        self.level = Some(level);
        level as f32
    }

    /// From `level` as far towards the goal as the fade allows: in double precision, in which even a thousandth of a pixel of a
    /// target that moves thousands is a step.
    fn towards(&self, importance: &Importance, pixels_per_unit: f32, weights: Option<&[f32]>, level: f64) -> f64 {
        let (goal, mut at) = (self.goal as f64, level.min(importance.target_count() as f64));
        let mut room = f64::from(self.desc.fade);
        while at != goal {
            // The target that fades, and where it is there as a whole or not at all.
            let (rank, end) =
                if goal > at { (at.floor(), at.floor() + 1.0) } else { (at.ceil() - 1.0, at.ceil() - 1.0) };
            let target = importance.order()[rank as usize] as usize;
            let weight = weights.map_or(1.0, |weights| weights.get(target).map_or(0.0, |weight| weight.abs()));
            let whole = f64::from(weight) * f64::from(importance.reach(target)) * f64::from(pixels_per_unit);
            let cost = whole * (end - at).abs();
            if cost > room {
                return at + (end - at) * (room / cost).max(0.0);
            }
            (at, room) = (end, room - cost);
        }
        at
    }
}
