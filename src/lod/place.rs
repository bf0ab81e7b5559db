//! The camera, and the places of instances: how large instances are in the picture.

use super::pixels_per_unit;
use crate::error::{Error, Result};
use glam::{Mat4, Vec3};

/// A camera in perspective.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position, in world units.
    pub eye: Vec3,
    /// Height of the picture, in pixels, above 0.
    pub height: f32,
    /// Angle of view from bottom to top, in radians, above 0 and below π.
    pub angle: f32,
}

impl Camera {
    /// Returns the pixels that an input unit takes up at the point of an instance nearest to the camera:
    /// [`pixels_per_unit`] at its distance, times [`Place::scale`]. The distance is at least a thousandth of the
    /// radius, also inside the ball.
    pub fn pixels_per_unit(&self, place: &Place) -> f32 {
        let distance = (self.eye.distance(place.centre) - place.radius).max(place.radius * 1e-3);
        pixels_per_unit(self.height, self.angle, distance) * place.scale
    }

    /// # Errors
    /// A height or an angle out of range; an eye position that is not finite.
    pub(crate) fn check(&self) -> Result<()> {
        let Self { eye, height, angle } = *self;
        let angles = 0.0..std::f32::consts::PI;
        if eye.is_finite() && height > 0.0 && height.is_finite() && angles.contains(&angle) && angle > 0.0 {
            return Ok(());
        }
        let what = format!("a camera at {eye} with a picture {height} pixels high and an angle of {angle} radians");
        Err(Error::invalid(what, "use numbers, a height above 0, and an angle above 0 and below 3.14"))
    }
}

/// The place of an instance: a ball around all of its poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Middle of the ball, in world units.
    pub centre: Vec3,
    /// Radius of the ball, in world units, 0 or more.
    pub radius: f32,
    /// World units that an input unit of the mesh takes up, above 0.
    pub scale: f32,
}

impl Place {
    /// Returns a ball around points of the mesh, such as those of the base pose, where input units are world units. Its
    /// middle is the mean of the points.
    pub fn around(points: &[Vec3]) -> Self {
        let centre = points.iter().sum::<Vec3>() / points.len().max(1) as f32;
        let radius = points.iter().map(|point| point.distance(centre)).fold(0.0, f32::max);
        Self { centre, radius, scale: 1.0 }
    }

    /// Returns the same ball moved by a matrix that rotates, translates and scales. If the scale differs between axes,
    /// the largest counts.
    pub fn moved(&self, by: &Mat4) -> Self {
        let axes = [by.x_axis, by.y_axis, by.z_axis];
        let scale = axes.into_iter().map(|axis| axis.truncate().length()).fold(0.0, f32::max);
        Self { centre: by.transform_point3(self.centre), radius: self.radius * scale, scale: self.scale * scale }
    }

    /// # Errors
    /// A middle that is not finite, a radius below 0 or not finite, a scale that is not a finite number above 0.
    pub(crate) fn check(&self) -> Result<()> {
        let Self { centre, radius, scale } = *self;
        let is_number = centre.is_finite() && radius.is_finite() && scale.is_finite();
        if is_number && radius >= 0.0 && scale > 0.0 {
            return Ok(());
        }
        let what = format!("an instance at {centre} with a radius of {radius} and a scale of {scale}");
        Err(Error::invalid(what, "use numbers, a radius of 0 or more, and a scale above 0"))
    }

    /// The words that `glsl/level.comp` reads.
    pub(crate) fn bits(&self) -> [u32; 5] {
        let Vec3 { x, y, z } = self.centre;
        [x, y, z, self.radius, self.scale].map(f32::to_bits)
    }
}
