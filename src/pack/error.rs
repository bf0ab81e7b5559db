//! Errors of poses and deltas, by kind of stream.

use super::POSE_FLOATS;
use crate::asset::streams::{Measure, Semantic, StreamPlace};
use glam::DVec3;

/// Largest errors of a pose, or over all targets at weight 1. 0 for missing streams; NaN if the pose contains NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseError {
    /// Largest distance of a vertex from its exact position, in input units.
    pub position: f64,
    /// Largest angle between normals, after normalisation, in degrees.
    pub normal_degrees: f64,
    /// Largest angle between tangents, after normalisation, in degrees.
    pub tangent_degrees: f64,
    /// Largest difference of any component of other streams (texture coordinates, colours, masks).
    pub absolute: f64,
}

impl PoseError {
    /// Exceeds every bound.
    pub(crate) const NAN: Self =
        Self { position: f64::NAN, normal_degrees: f64::NAN, tangent_degrees: f64::NAN, absolute: f64::NAN };

    /// The larger error of each kind; NaN if either is NaN.
    #[doc(hidden)]
    pub fn max(self, other: Self) -> Self {
        // f64::max would drop a NaN.
        let worse = |a: f64, b: f64| if a.is_nan() || a > b { a } else { b };
        Self {
            position: worse(self.position, other.position),
            normal_degrees: worse(self.normal_degrees, other.normal_degrees),
            tangent_degrees: worse(self.tangent_degrees, other.tangent_degrees),
            absolute: worse(self.absolute, other.absolute),
        }
    }

    /// Whether distances are within `position`, and angles of normals and tangents within `degrees`.
    pub fn within(&self, position: f64, degrees: f64) -> bool {
        self.position <= position && self.normal_degrees <= degrees && self.tangent_degrees <= degrees
    }

    /// The error that applies to a stream of this semantic.
    #[doc(hidden)]
    pub fn of(&self, semantic: Semantic) -> f64 {
        let mut errors = *self;
        *errors.of_mut(semantic)
    }

    /// Takes in the error of a stream.
    pub(crate) fn add(&mut self, semantic: Semantic, error: f64) {
        let worst = self.of_mut(semantic);
        if error.is_nan() || error > *worst {
            *worst = error;
        }
    }

    /// Takes in the errors of one vertex of a group; `angle` returns degrees.
    pub(crate) fn add_vertex(
        &mut self,
        streams: &[StreamPlace],
        got: &[f64; POSE_FLOATS],
        want: &[f64; POSE_FLOATS],
        angle: impl Fn(DVec3, DVec3) -> f64,
    ) {
        for place in streams {
            let numbers = place.morphing_components();
            let vector = |of: &[f64; POSE_FLOATS]| DVec3::from_slice(&of[numbers.clone()]);
            match place.semantic.measure() {
                Measure::Length => self.add(place.semantic, vector(got).distance(vector(want))),
                Measure::Angle => self.add(place.semantic, angle(vector(got), vector(want))),
                Measure::Absolute => numbers.for_each(|c| self.add(place.semantic, (got[c] - want[c]).abs())),
            }
        }
    }

    fn of_mut(&mut self, semantic: Semantic) -> &mut f64 {
        match semantic.measure() {
            Measure::Length => &mut self.position,
            Measure::Angle if matches!(semantic, Semantic::Normal) => &mut self.normal_degrees,
            Measure::Angle => &mut self.tangent_degrees,
            Measure::Absolute => &mut self.absolute,
        }
    }
}
