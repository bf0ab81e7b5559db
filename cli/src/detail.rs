//! How many targets heads keep: so many, or after the camera.

use crate::output::Failure;
use deltamorph::MorphMesh;
use deltamorph::lod::{Camera, Importance, Level, LevelDesc, Place};
use glam::{Mat4, Vec3};

/// How many targets heads keep, in the order of their importance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Detail {
    #[default]
    All,
    /// This share of them.
    Share(f32),
    /// As many as it takes for no vertex to be further off than so many pixels, wherever the camera is.
    Pixels(f32),
}

impl Detail {
    /// Those to choose from.
    #[cfg(feature = "viewer")]
    pub const ALL: [Self; 6] =
        [Self::All, Self::Share(0.75), Self::Share(0.5), Self::Share(0.25), Self::Pixels(0.5), Self::Pixels(2.0)];

    pub fn parse(text: &str) -> Result<Self, String> {
        let number = |text: &str, most: f32| text.parse().ok().filter(|v| (0.0..=most).contains(v));
        let share = || text.strip_suffix('%').and_then(|text| number(text, 100.0)).map(|v| Self::Share(v / 100.0));
        let pixels = || text.strip_suffix("px").and_then(|text| number(text, 1e3)).map(Self::Pixels);
        let all = (text == "all").then_some(Self::All);
        all.or_else(share).or_else(pixels).ok_or_else(|| "give all, a share as 50%, or pixels as 0.5px".into())
    }
}

impl std::fmt::Display for Detail {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::All => f.write_str("all targets"),
            Self::Share(share) => write!(f, "{}% of the targets", share * 100.0),
            Self::Pixels(pixels) => write!(f, "{pixels} pixels off at most"),
        }
    }
}

/// The targets of a mesh by their importance, and how many of them each head keeps.
pub struct Kept {
    importance: Importance,
    /// What levels are chosen by, and those of the heads.
    levels: (Detail, Vec<Level>),
    /// Targets of each head in the last frame, and how many it is about to keep.
    now: Vec<(f32, f32)>,
    /// What a head takes up in the base pose.
    ball: Place,
}

impl Kept {
    /// Of a mesh of which `focus` is in the picture.
    pub fn new(mesh: &MorphMesh, focus: &[Vec3]) -> Result<Self, Failure> {
        let importance = Importance::of(mesh, &[])?;
        Ok(Self { importance, levels: (Detail::All, vec![]), now: vec![], ball: Place::around(focus) })
    }

    /// Pixels that an input unit takes up at the nearest point of a head that `place` moves.
    pub fn unit(&self, camera: &Camera, place: &Mat4) -> f32 {
        camera.pixels_per_unit(&self.ball.moved(place))
    }

    /// Take away what heads do not keep of `weights`, one list for each; `units`: pixels that an input unit takes up
    /// there.
    pub fn apply(&mut self, detail: Detail, units: &[f32], weights: &mut [Vec<f32>]) -> Result<(), Failure> {
        let Self { importance, levels, .. } = self;
        let all = importance.target_count() as f32;
        let kept: Vec<(f32, f32)> = match detail {
            Detail::All => vec![(all, all); weights.len()],
            Detail::Share(share) => vec![((share * all).ceil(), (share * all).ceil()); weights.len()],
            Detail::Pixels(pixels) => {
                if levels.0 != detail || levels.1.len() != weights.len() {
                    // Half of what a level is given is for changes that an error budget defers, which has a choice of
                    // its own.
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
        for (weights, (level, _)) in weights.iter_mut().zip(&kept) {
            importance.apply(*level, weights)?;
        }
        self.now = kept;
        Ok(())
    }

    /// Targets of all, and how many of them a head keeps: the fewest, and the most.
    pub fn of_all(&self) -> (usize, [usize; 2]) {
        let all = self.importance.target_count();
        let kept = self.now.iter().map(|(now, _)| now.ceil() as usize);
        (all, [kept.clone().min().unwrap_or(all), kept.max().unwrap_or(all)])
    }

    /// Whether some head is still on its way to the number of targets that it is about to keep.
    #[cfg(feature = "viewer")]
    pub fn fades(&self) -> bool {
        self.now.iter().any(|(now, goal)| now != goal)
    }
}
