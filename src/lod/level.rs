//! The number of targets that an instance keeps: it follows the camera, but so slowly that nothing pops.

use super::Importance;

/// The share of the pixel error for targets left out; changes deferred by an error budget have the rest.
const SHARE: f32 = 0.5;
/// Hysteresis: more targets are kept once the whole share is exceeded, fewer once this part of it is enough. A camera
/// that trembles changes nothing.
const MARGIN: f32 = 0.8;

/// The number of targets that an instance keeps now, and the number it is moving to.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// Distance of a vertex from its position with all weights applied, in pixels (≥ 0), once the level has settled.
    /// Half of it is for targets that are left out ([`step`](Self::step)), half for changes that are deferred
    /// ([`error_budget`](Self::error_budget)).
    pub pixels: f32,
    /// Largest distance that a vertex may move from one frame to the next because the level changes, in pixels (above
    /// 0). 0.008 by default.
    pub fade: f32,
    /// `None`: nothing has been shown yet, so a jump is not visible.
    level: Option<f64>,
    pub(super) goal: usize,
}

impl Level {
    /// Makes the level of an instance that has not been shown yet, for an error of `pixels`.
    pub fn new(pixels: f32) -> Self {
        Self { pixels, fade: 0.008, level: None, goal: 0 }
    }

    /// Returns the error budget for this pixel error, in input units, where an input unit takes up `pixels_per_unit`:
    /// the value for [`UpdateDesc::error_budget`](crate::UpdateDesc::error_budget). 0, which defers nothing, if
    /// the result is not a finite number above 0.
    pub fn error_budget(&self, pixels_per_unit: f32) -> f32 {
        let budget = (1.0 - SHARE) * self.pixels / pixels_per_unit;
        if budget.is_finite() { budget.max(0.0) } else { 0.0 }
    }

    /// Returns the number of targets kept in the frame of the last [`step`](Self::step); `None` before the first.
    pub fn level(&self) -> Option<f32> {
        self.level.map(|level| level as f32)
    }

    /// Tells that the next frame has no predecessor (the instance was hidden, or the camera jumped): the level takes
    /// its goal at once.
    pub fn reset(&mut self) {
        self.level = None;
    }

    /// Steps to the next frame, in which an input unit takes up `pixels_per_unit`
    /// ([`pixels_per_unit`](super::pixels_per_unit)). Returns the number of targets to keep, for [`Importance::apply`].
    /// The level moves towards its goal as far as it can without any vertex moving further than [`fade`](Self::fade).
    /// `weights` are this frame's weights before they are scaled: the movement is that of the targets that fade at
    /// these weights (those without a weight cost nothing). Without them, all weights count as 1.
    ///
    /// A settled level stays as it is, bit for bit, while `pixels_per_unit` stays within a fifth of its value. If it is
    /// NaN or infinite, all targets are kept at once.
    pub fn step(&mut self, importance: &Importance, pixels_per_unit: f32, weights: Option<&[f32]>) -> f32 {
        // More targets are kept once a vertex is off by more than the one, fewer once that brings none off by more than
        // the other.
        let most = self.pixels * SHARE;
        let enough = most * MARGIN;
        let wanted = importance.level_for(pixels_per_unit, enough);
        let exceeded = importance.level_for(pixels_per_unit, most) > self.goal;
        if self.level.is_none() || exceeded || wanted < self.goal {
            self.goal = wanted;
        }
        let level = match self.level {
            Some(level) if pixels_per_unit.is_finite() => self.towards(importance, pixels_per_unit, weights, level),
            Some(_) | None => self.goal as f64,
        };
        self.level = Some(level);
        level as f32
    }

    /// Moves from `level` towards the goal as far as the fade allows. In double precision, in which even a thousandth
    /// of a pixel is a step for a target that moves thousands.
    fn towards(&self, importance: &Importance, pixels_per_unit: f32, weights: Option<&[f32]>, level: f64) -> f64 {
        let goal = self.goal as f64;
        let mut at = level.min(importance.order().len() as f64);
        let mut room = f64::from(self.fade);
        while at != goal {
            // The target that fades, and the level at which it is fully in or out.
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
