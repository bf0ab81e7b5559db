//! Levels of detail: a fixed number of targets per instance, or one that depends on the camera.

use crate::output::Failure;
use deltamorph::MorphMesh;
use deltamorph::lod::{Importance, Level, LevelDesc, pixels_per_unit};
use glam::{Mat4, Vec3};

/// Number of targets that instances keep, in order of importance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Detail {
    #[default]
    All,
    /// This share of all targets.
    Share(f32),
    /// As many as are needed for position errors up to this many pixels, at any camera distance.
    Pixels(f32),
}

impl Detail {
    pub fn parse(text: &str) -> Result<Self, String> {
        let number = |text: &str, most: f32| text.parse().ok().filter(|v| (0.0..=most).contains(v));
        let share = || text.strip_suffix('%').and_then(|text| number(text, 100.0)).map(|v| Self::Share(v / 100.0));
        let pixels = || text.strip_suffix("px").and_then(|text| number(text, 1e3)).map(Self::Pixels);
        let all = (text == "all").then_some(Self::All);
        all.or_else(share).or_else(pixels).ok_or_else(|| "give all, a share as 50%, or pixels as 0.5px".into())
    }
}

/// A camera in perspective.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// Position, in world units.
    pub eye: Vec3,
    /// Height of the picture, in pixels.
    pub height: f32,
    /// Angle of view from bottom to top, in radians.
    pub angle: f32,
}

/// A ball around the base pose, where input units are world units.
#[derive(Clone, Copy, Debug)]
pub struct Ball {
    centre: Vec3,
    radius: f32,
}

impl Ball {
    /// The ball around points, whose middle is their mean.
    pub fn around(points: &[Vec3]) -> Self {
        let centre = points.iter().sum::<Vec3>() / points.len().max(1) as f32;
        let radius = points.iter().map(|point| point.distance(centre)).fold(0.0, f32::max);
        Self { centre, radius }
    }

    /// Pixels per input unit at the nearest point of the ball, moved by a matrix that rotates, translates and scales.
    /// The distance is at least a thousandth of the radius, also inside the ball.
    pub fn pixels_per_unit(&self, camera: &Camera, place: &Mat4) -> f32 {
        let axes = [place.x_axis, place.y_axis, place.z_axis];
        let scale = axes.into_iter().map(|axis| axis.truncate().length()).fold(0.0, f32::max);
        let radius = self.radius * scale;
        let distance = camera.eye.distance(place.transform_point3(self.centre)) - radius;
        pixels_per_unit(camera.height, camera.angle, distance.max(radius * 1e-3)) * scale
    }
}

/// The targets of a mesh by importance, and the number that each instance keeps.
pub struct Kept {
    importance: Importance,
    /// The choice that the levels were made for, and a level for each instance.
    levels: (Detail, Vec<Level>),
    /// Targets of each instance in the last frame.
    now: Vec<f32>,
    /// Bounding sphere of an instance in the base pose.
    ball: Ball,
}

impl Kept {
    /// For a mesh of which `focus` is in the picture.
    pub fn new(mesh: &MorphMesh, focus: &[Vec3]) -> Result<Self, Failure> {
        let importance = Importance::of(mesh, &[])?;
        Ok(Self { importance, levels: (Detail::All, vec![]), now: vec![], ball: Ball::around(focus) })
    }

    /// Pixels per input unit at the nearest point of an instance placed by `place`.
    pub fn unit(&self, camera: &Camera, place: &Mat4) -> f32 {
        self.ball.pixels_per_unit(camera, place)
    }

    /// Removes left-out targets from `weights`, one list per instance; `units`: its pixels per input unit.
    pub fn apply(&mut self, detail: Detail, units: &[f32], weights: &mut [Vec<f32>]) -> Result<(), Failure> {
        let Self { importance, levels, .. } = self;
        let all = importance.target_count() as f32;
        let kept: Vec<f32> = match detail {
            Detail::All => vec![all; weights.len()],
            Detail::Share(share) => vec![(share * all).ceil(); weights.len()],
            Detail::Pixels(pixels) => {
                if levels.0 != detail || levels.1.len() != weights.len() {
                    // A level assigns half of its pixels to error budgets, which are a separate option here.
                    let level = Level::new(LevelDesc::default().pixels(2.0 * pixels));
                    *levels = (detail, vec![level; weights.len()]);
                }
                let heads = levels.1.iter_mut().zip(units).zip(weights.iter());
                let step = |((level, unit), weights): ((&mut Level, &f32), &Vec<f32>)| {
                    level.step(importance, *unit, Some(weights))
                };
                heads.map(step).collect()
            }
        };
        for (weights, level) in weights.iter_mut().zip(&kept) {
            importance.apply(*level, weights)?;
        }
        self.now = kept;
        Ok(())
    }

    /// The number of all targets, and the fewest and most that an instance keeps.
    pub fn of_all(&self) -> (usize, [usize; 2]) {
        let all = self.importance.target_count();
        let kept = self.now.iter().map(|now| now.ceil() as usize);
        (all, [kept.clone().min().unwrap_or(all), kept.max().unwrap_or(all)])
    }
}
