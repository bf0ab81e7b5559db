//! Where heads are, and the camera that sees them: how large they are in the picture.

use super::pixels_per_unit;
use crate::error::{Error, Result};
use glam::{Mat4, Vec3};

/// A camera in perspective.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it is, in world units.
    pub eye: Vec3,
    /// Height of the picture, in pixels, above 0.
    pub height: f32,
    /// Angle of view from bottom to top, in radians, above 0 and below π.
    pub angle: f32,
}

impl Camera {
    /// Pixels that an input unit takes up at the point of a head that is nearest to the camera: [`pixels_per_unit`] at its
    /// distance, times [`Place::scale`]. Within the ball, where no distance is the smallest, that of a thousandth of the
    /// radius.
    pub fn pixels_per_unit(&self, place: &Place) -> f32 {
        let distance = (self.eye.distance(place.centre) - place.radius).max(place.radius * 1e-3);
        pixels_per_unit(self.height, self.angle, distance) * place.scale
    }

    /// # Errors
    /// A height or an angle that there is not; an eye that is nowhere.
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

/// Where a head is: a ball around all of its poses.
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
    /// A ball around points of the mesh, such as those of the base pose, where input units are world units: its middle is the
    /// mean of the points.
    pub fn around(points: &[Vec3]) -> Self {
        let centre = points.iter().sum::<Vec3>() / points.len().max(1) as f32;
        let radius = points.iter().map(|point| point.distance(centre)).fold(0.0, f32::max);
        Self { centre, radius, scale: 1.0 }
    }

    /// The same head moved by a matrix that turns, shifts and scales. Where it scales axes differently, the largest counts.
    pub fn moved(&self, by: &Mat4) -> Self {
        let axes = [by.x_axis, by.y_axis, by.z_axis];
        let scale = axes.into_iter().map(|axis| axis.truncate().length()).fold(0.0, f32::max);
        Self { centre: by.transform_point3(self.centre), radius: self.radius * scale, scale: self.scale * scale }
    }

    /// # Errors
    /// A middle that is nowhere, a radius below 0, a scale that is not above 0.
    pub(crate) fn check(&self) -> Result<()> {
        let Self { centre, radius, scale } = *self;
        let is_number = centre.is_finite() && radius.is_finite() && scale.is_finite();
        if is_number && radius >= 0.0 && scale > 0.0 {
            return Ok(());
        }
        let what = format!("a head at {centre} with a radius of {radius} and a scale of {scale}");
        Err(Error::invalid(what, "use numbers, a radius of 0 or more, and a scale above 0"))
    }

    /// As `glsl/level.comp` reads it.
    pub(crate) fn bits(&self) -> [u32; 5] {
        let Vec3 { x, y, z } = self.centre;
        [x, y, z, self.radius, self.scale].map(f32::to_bits)
    }
}
