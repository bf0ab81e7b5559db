//! What pictures are made from: the mesh and its parts, where it is updated and drawn, the weights asked for.

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

/// Pixels of a picture where no size is given.
pub const SIZE: [u32; 2] = [768; 2];

/// What a picture is made from.
pub struct Scenery<'a> {
    pub args: &'a RenderArgs,
    pub input: &'a Input,
    pub stage: &'a Stage,
    pub gpu: &'a Gpu,
    pub subject: Subject,
    pub joints: Option<Joints>,
    pub out: &'a Output,
}

/// What was written.
pub struct Done {
    /// For people: what is in the picture.
    pub what: String,
    pub size: [u32; 2],
    pub frames: usize,
    /// The end of the scale, where colours stand for values.
    pub scale: Option<f32>,
    /// Targets of all, and how many of them a head keeps, the fewest and the most; `None`: all.
    pub kept: Option<(usize, [usize; 2])>,
}

/// The parts of a mesh, and the positions that a picture of it has to show.
pub struct Subject {
    pub parts: Vec<Part>,
    pub focus: Vec<Vec3>,
}

impl Subject {
    /// Of the mesh that was read from `path`, or of the built-in head.
    pub fn new(path: Option<&Path>, input: &Input) -> Self {
        Self::of_mesh(path, &input.kept)
    }

    /// Of a mesh that has the faces of that one.
    pub fn of_mesh(path: Option<&Path>, mesh: &MorphMesh) -> Self {
        let parts = parts(mesh, &names::of_faces(path, mesh));
        Self { focus: focus(mesh, &parts), parts }
    }
}

/// Positions of what is drawn, and where single targets take it furthest; of a whole body that only has a face to move,
/// of that and what is around it.
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

/// The lowest and the highest corner of the box around points; the wrong way round where there are none.
pub fn bounds(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    points.fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(p), high.max(p)))
}

impl Scenery<'_> {
    /// The weights of the frame and settings asked for, and those of the frame before (of the first, and of settings
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

    /// The frames of the clip that is asked for, or of the only one there is, with the settings on top; and their rate.
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
