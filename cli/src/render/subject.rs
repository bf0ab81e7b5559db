//! What is drawn: the parts of a mesh, and where a camera finds them.

use super::names;
use super::painted::{self, Painted, Still};
use crate::input::Input;
use crate::output::Result;
use deltamorph::KeptMesh;
use deltamorph::import::is_gltf;
use deltamorph_render::{Camera, Face, Part, View, parts};
use glam::{Mat4, Vec3};
use std::collections::HashMap;

/// The parts of a mesh, and those beside it.
pub struct Subject {
    pub parts: Vec<Part>,
    /// Positions that have to be in the picture: of what targets move, and of everything.
    pub focus: Vec<Vec3>,
    pub whole: Vec<Vec3>,
    pub still: Option<Still>,
    /// Yaw of a camera that looks at the face, in degrees.
    front: f32,
}

impl Subject {
    pub fn new(input: &Input) -> Result<Self> {
        let path = input.args.input.as_ref().filter(|path| is_gltf(path) && path.is_file() && input.packed.is_none());
        let Some(path) = path else { return Ok(Self::of_mesh(input)) };
        let Painted { parts, still } = painted::of_file(path, &input.kept)?;
        let (focus, whole) = views(&input.kept, &parts, still.as_ref());
        Ok(Self { parts, focus, whole, still, front: input.front })
    }

    /// The mesh by itself.
    pub fn of_mesh(input: &Input) -> Self {
        let mesh = &input.kept;
        let names = names::of_faces(input.args.input.as_deref(), mesh);
        let said: Vec<Face<'_>> = names.iter().map(|name| Face::Named(name)).collect();
        let parts = parts(mesh, &said);
        let (focus, whole) = views(mesh, &parts, None);
        Self { parts, focus, whole, still: None, front: input.front }
    }

    /// The view from a direction (degrees around and up) in which instances at `places` fill a picture of this ratio of
    /// width to height, except for a `margin` at each edge.
    pub fn view(&self, [yaw, pitch]: [f32; 2], places: &[Mat4], aspect: f32, margin: f32) -> View {
        let at_places = |points: &'_ [Vec3]| -> Vec<Vec3> {
            places.iter().flat_map(|place| points.iter().map(|p| place.transform_point3(*p))).collect()
        };
        let camera = Camera { yaw: self.front + yaw, pitch, ..Camera::default() };
        let mut view = camera.fit(at_places(&self.focus).into_iter(), aspect, margin);
        view.reach(at_places(&self.whole).into_iter());
        view
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
