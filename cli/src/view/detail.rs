//! How many targets heads keep: so many, or after the camera.

use super::command::Detail;
use crate::output::Failure;
use deltamorph::MorphMesh;
use deltamorph::lod::{Camera, Importance, Level, LevelDesc, Place};
use glam::{Mat4, Vec3};

/// The targets of a mesh by their importance, and how many of them each head keeps.
pub struct Kept {
    importance: Importance,
    /// What levels are chosen by, and those of the heads.
    levels: (Detail, Vec<Level>),
    /// Targets of the first head in the last frame, and how many it is about to keep.
    now: (f32, f32),
    /// What a head takes up in the base pose.
    ball: Place,
}

impl Kept {
    /// Of a mesh of which `focus` is in the picture.
    pub fn new(mesh: &MorphMesh, focus: &[Vec3]) -> Result<Self, Failure> {
        let importance = Importance::of(mesh, &[])?;
        let all = importance.target_count() as f32;
        Ok(Self { importance, levels: (Detail::All, vec![]), now: (all, all), ball: Place::around(focus) })
    }

    /// Pixels that an input unit takes up at the nearest point of a head that `place` moves.
    pub fn unit(&self, camera: &Camera, place: &Mat4) -> f32 {
        camera.pixels_per_unit(&self.ball.moved(place))
    }

    /// Take away what heads do not keep of `weights`, one list for each; `units`: pixels that an input unit takes up there.
    pub fn apply(&mut self, detail: Detail, units: &[f32], weights: &mut [Vec<f32>]) -> Result<(), Failure> {
        let Self { importance, levels, .. } = self;
        let all = importance.target_count() as f32;
        let kept: Vec<(f32, f32)> = match detail {
            Detail::All => vec![(all, all); weights.len()],
            Detail::Share(share) => vec![((share * all).ceil(), (share * all).ceil()); weights.len()],
            Detail::Pixels(pixels) => {
                if levels.0 != detail || levels.1.len() != weights.len() {
                    // Half of what a level is given is for changes that an error budget defers, which has a choice of its own.
                    let level = Level::new(LevelDesc::default().pixels(2.0 * pixels));
                    *levels = (detail, vec![level; weights.len()]);
                }
                let heads = levels.1.iter_mut().zip(units).zip(weights.iter());
                let step = |((level, unit), weights): ((&mut Level, &f32), &Vec<f32>)| {
                    (level.step(importance, *unit, Some(weights)), level.goal() as f32)
                };
                heads.map(step).collect()
            }
        };
        self.now = kept.first().copied().unwrap_or((all, all));
        for (weights, (level, _)) in weights.iter_mut().zip(kept) {
            importance.apply(level, weights)?;
        }
        Ok(())
    }

    /// Targets that the first head keeps, of how many.
    pub fn of_all(&self) -> (usize, usize) {
        (self.now.0.ceil() as usize, self.importance.target_count())
    }

    /// Whether the first head is still on its way to the number of targets that it is about to keep.
    pub fn fades(&self) -> bool {
        self.now.0 != self.now.1
    }
}
