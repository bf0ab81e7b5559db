//! The inputs of pictures: the mesh and its parts, the device and update description, the requested weights.

use super::joints::Joints;
use super::names;
use crate::args::render::RenderArgs;
use crate::input::{self, Input};
use crate::output::{Failure, Output};
use crate::runner::{Gpu, Stage};
use deltamorph::{BoundClip, MorphMesh};
use deltamorph_render::{Part, parts};
use glam::Vec3;
use std::collections::HashMap;
use std::path::Path;

/// Default size of a picture, in pixels.
pub const SIZE: [u32; 2] = [768; 2];

/// Inputs of a picture.
pub struct Scenery<'a> {
    pub args: &'a RenderArgs,
    pub input: &'a Input,
    pub stage: &'a Stage,
    pub gpu: &'a Gpu,
    pub subject: Subject,
    pub joints: Option<Joints>,
    pub out: &'a Output,
}

/// Describes the files written.
pub struct Done {
    /// Describes the picture in words.
    pub what: String,
    pub size: [u32; 2],
    pub frames: usize,
    /// The end of the scale, if colours stand for values.
    pub scale: Option<f32>,
    /// The number of all targets, and the fewest and most that an instance keeps; `None`: all.
    pub kept: Option<(usize, [usize; 2])>,
}

/// The parts of a mesh, and the positions that have to be in the picture.
pub struct Subject {
    pub parts: Vec<Part>,
    pub focus: Vec<Vec3>,
}

impl Subject {
    /// The subject of the mesh that was read from `path`, or of the built-in head.
    pub fn new(path: Option<&Path>, input: &Input) -> Self {
        Self::of_mesh(path, &input.kept)
    }

    /// The subject of a mesh with the same faces as the one at `path`.
    pub fn of_mesh(path: Option<&Path>, mesh: &MorphMesh) -> Self {
        let parts = parts(mesh, &names::of_faces(path, mesh));
        Self { focus: focus(mesh, &parts), parts }
    }
}

/// Positions of drawn vertices, and their furthest positions by single targets; if only a small part of a body moves,
/// only that part and its surroundings.
fn focus(mesh: &MorphMesh, parts: &[Part]) -> Vec<Vec3> {
    let mut drawn = vec![false; mesh.vertex_count()];
    parts.iter().flat_map(|part| part.triangles.iter().flatten()).for_each(|&v| drawn[v as usize] = true);
    let all: Vec<Vec3> = mesh.positions.iter().zip(&drawn).filter(|(_, drawn)| **drawn).map(|(p, _)| *p).collect();
    let mut furthest: HashMap<u32, Vec3> = HashMap::new();
    for (&v, delta) in mesh.targets.iter().flat_map(|target| target.vertices.iter().zip(&target.positions)) {
        let far = furthest.entry(v).or_insert(*delta);
        *far = if delta.length_squared() > far.length_squared() { *delta } else { *far };
    }
    furthest.retain(|v, _| drawn[*v as usize]);
    let (low, high) = bounds(furthest.keys().map(|&v| mesh.positions[v as usize]));
    let ((all_low, all_high), size) = (bounds(all.iter().copied()), (high - low).max_element());
    let whole = low.x > high.x || size > 0.4 * (all_high - all_low).max_element();
    let (low, high) = if whole { (all_low, all_high) } else { (low - 0.2 * size, high + 0.2 * size) };
    let inside = all.into_iter().filter(|p| p.cmpge(low).all() && p.cmple(high).all());
    inside.chain(furthest.iter().map(|(&v, delta)| mesh.positions[v as usize] + *delta)).collect()
}

/// Lowest and highest corner of the bounding box of points; `MAX` and `MIN` without points.
pub fn bounds(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    points.fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(p), high.max(p)))
}

impl Scenery<'_> {
    /// Weights of the requested frame and settings, and those of the frame before (for the first frame or settings
    /// alone, the base pose).
    pub fn weights(&self) -> Result<[Vec<f32>; 2], Failure> {
        let args = self.args;
        let rest = || vec![0.0; self.input.kept.targets.len()];
        let (Some(path), Some(frame)) = (&args.weights, args.frame) else {
            return Ok([self.input.pose(&args.set)?, rest()]);
        };
        let clip = self.layered(input::clip(path, &args.run.input, self.input, &args.set)?)?;
        let count = clip.frame_count();
        if frame >= count {
            let text = format!("has {count} frames, counted from 0; there is no frame {frame}");
            return Err(Failure::Usage(format!("{}: {text}", path.display())));
        }
        Ok([clip.frame(frame)?, if frame > 0 { clip.frame(frame - 1)? } else { rest() }])
    }

    /// Frames of the requested clip, or of the only one, with the settings applied; and their rate.
    pub fn frames(&self) -> Result<(Vec<Vec<f32>>, f32), Failure> {
        let args = self.args;
        let clip = self.layered(input::one_clip(args.weights.as_deref(), &args.run.input, self.input, &args.set)?)?;
        Ok((clip.frames().collect(), clip.fps))
    }

    fn layered(&self, clip: BoundClip) -> Result<BoundClip, Failure> {
        input::layered(clip, &self.args.layers.layers, &self.args.run.input, self.input)
    }

    pub fn diagonal(&self) -> f32 {
        self.input.kept.diagonal
    }
}
