//! The inputs of pictures: the mesh and its parts, the device and update description, the requested weights.

use super::names;
use super::painted::{self, Painted, Still};
use crate::args::render::RenderArgs;
use crate::input::{self, Input};
use crate::output::{Failure, Output};
use crate::runner::{Gpu, Stage};
use deltamorph::KeptMesh;
use deltamorph::import::is_gltf;
use deltamorph_render::{Face, Part, parts};
use glam::Vec3;
use std::collections::HashMap;
use std::path::Path;

/// Inputs of a picture.
pub struct Scenery<'a> {
    pub args: &'a RenderArgs,
    pub input: &'a Input,
    pub stage: &'a Stage,
    pub gpu: &'a Gpu,
    pub subject: Subject,
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
}

/// The parts of a mesh, and those beside it.
pub struct Subject {
    pub parts: Vec<Part>,
    /// Positions that have to be in the picture: of what targets move, and of everything.
    pub focus: Vec<Vec3>,
    pub whole: Vec<Vec3>,
    pub still: Option<Still>,
    /// Yaw of a camera that looks at the face, in degrees.
    pub front: f32,
}

impl Subject {
    /// The subject of the mesh that was read from `path`, or of the built-in head.
    pub fn new(path: Option<&Path>, input: &Input) -> Result<Self, Failure> {
        let mesh = &input.kept;
        let Some(path) = path.filter(|path| is_gltf(path) && path.is_file() && input.packed.is_none()) else {
            return Ok(Self::of_mesh(path, mesh));
        };
        let Painted { parts, still } = painted::of_file(path, mesh)?;
        let (focus, whole) = views(mesh, &parts, still.as_ref());
        Ok(Self { parts, focus, whole, still, front: input.front })
    }

    /// The subject of a mesh with the same faces as the one at `path`, by itself.
    pub fn of_mesh(path: Option<&Path>, mesh: &KeptMesh) -> Self {
        let names = names::of_faces(path, mesh);
        let said: Vec<Face<'_>> = names.iter().map(|name| Face::Named(name)).collect();
        let parts = parts(mesh, &said);
        let (focus, whole) = views(mesh, &parts, None);
        Self { parts, focus, whole, still: None, front: 0.0 }
    }
}

/// What a picture shows at least, as a share of the whole.
const LEAST: f32 = 0.12;
/// Fewer vertices than these show nothing by themselves.
const FEW: usize = 24;

/// Positions of drawn vertices and their furthest positions by single targets: if only a small part of a body moves,
/// those of that part and its surroundings; and all.
fn views(mesh: &KeptMesh, parts: &[Part], still: Option<&Still>) -> (Vec<Vec3>, Vec<Vec3>) {
    let of_parts = |mesh: &KeptMesh, parts: &[Part]| {
        let mut drawn = vec![false; mesh.vertex_count()];
        parts.iter().flat_map(|part| part.triangles.iter().flatten()).for_each(|&v| drawn[v as usize] = true);
        let all = mesh.positions.iter().zip(&drawn).filter(|(_, drawn)| **drawn).map(|(p, _)| *p);
        (all.collect::<Vec<Vec3>>(), drawn)
    };
    let (mut all, drawn) = of_parts(mesh, parts);
    all.extend(still.map(|still| of_parts(&still.mesh, &still.parts).0).unwrap_or_default());
    let mut furthest: HashMap<u32, Vec3> = HashMap::new();
    for (&v, delta) in mesh.targets.iter().flat_map(|target| target.vertices.iter().zip(&target.positions)) {
        let far = furthest.entry(v).or_insert(*delta);
        *far = if delta.length_squared() > far.length_squared() { *delta } else { *far };
    }
    furthest.retain(|v, _| drawn[*v as usize]);
    let (low, high) = bounds(furthest.keys().map(|&v| mesh.positions[v as usize]));
    let (all_low, all_high) = bounds(all.iter().copied());
    let size = (high - low).max_element();
    let most = (all_high - all_low).max_element();
    let reached = || furthest.iter().map(|(&v, delta)| mesh.positions[v as usize] + *delta);
    let whole: Vec<Vec3> = all.iter().copied().chain(reached()).collect();
    // A single vertex has no size: there is room around it.
    let room = (0.2 * size).max((LEAST * most - size) / 2.0);
    let low = low - room;
    let high = high + room;
    let inside: Vec<Vec3> = all.into_iter().filter(|p| p.cmpge(low).all() && p.cmple(high).all()).collect();
    if furthest.is_empty() || size > 0.4 * most || inside.len() < FEW {
        return (whole.clone(), whole);
    }
    // What is around it, empty as it may be, has the least size.
    let corners = if size < LEAST * most { vec![low, high] } else { vec![] };
    (inside.into_iter().chain(reached()).chain(corners).collect(), whole)
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
        let (Some(path), Some(frame)) = (&args.run.weights, args.frame) else {
            return Ok([self.input.pose(&args.set)?, rest()]);
        };
        let clip = input::clip(path, &args.run.input, self.input, &args.set)?;
        input::check_frame(path, &clip, frame)?;
        Ok([clip.frame(frame)?, if frame > 0 { clip.frame(frame - 1)? } else { rest() }])
    }

    /// Frames of the requested clip, or of the only one, with the settings applied; and their rate.
    pub fn frames(&self) -> Result<(Vec<Vec<f32>>, f32), Failure> {
        let args = self.args;
        let clip = input::one_clip(args.run.weights.as_deref(), &args.run.input, self.input, &args.set)?;
        Ok((clip.frames().collect(), clip.fps))
    }
}
