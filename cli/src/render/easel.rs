//! The base of every picture: the mesh, packed and uploaded, a camera that fits it, and instances on the chosen path.

use super::subject::Subject;
use crate::args::render::{Normals, RenderArgs};
use crate::input::Input;
use crate::output::Result;
use crate::runner::{Gpu, Stage};
use deltamorph_render::{HeadsDesc, Light, Picture, Scene, Studio};
use glam::{Mat4, Vec3};

/// Share of the glow of changed blocks that remains after each frame of a clip.
const AFTERGLOW: f32 = 0.8;
/// Share of a picture that stays free at each edge, since poses extend beyond the base pose.
const MARGIN: f32 = 0.08;

/// A studio, instances, and a view of them.
pub struct Easel<'a> {
    pub studio: Studio<'a>,
    places: Vec<Mat4>,
    scene: Scene,
    background: [f32; 4],
}

impl<'a> Easel<'a> {
    /// For pictures of this size, with an instance at each of `places`, on the path of the command line. Colours that
    /// stand for lengths end at `end`.
    pub fn new(
        gpu: &'a Gpu,
        args: &RenderArgs,
        (input, stage, subject): (&Input, &Stage, &Subject),
        size: [u32; 2],
        places: Vec<Mat4>,
        end: f32,
    ) -> Result<Self> {
        let mesh = &input.kept;
        let desc = HeadsDesc {
            count: places.len() as u32,
            update: stage.desc,
            threads: stage.threads,
            recompute_normals: args.normals == Normals::Recomputed,
            still: subject.still.as_ref().map(|still| (&still.mesh, &still.parts[..])),
            afterglow: if args.clip.is_some() { AFTERGLOW } else { 0.0 },
            cull: places.len() > 1,
        };
        let mut view = subject.view(args.camera, &places, size[0] as f32 / size[1] as f32, MARGIN);
        view.clip = Mat4::from_scale(Vec3::new(args.zoom, args.zoom, 1.0)) * view.clip;
        Ok(Self {
            studio: Studio::new(gpu, mesh, &stage.mesh, &subject.parts, size, &desc)?,
            places,
            scene: Scene { view, light: Light::default(), show: args.look(), end },
            background: args.background.linear(),
        })
    }

    /// Draws the instances with these weights.
    pub fn draw(&mut self, weights: &[&[f32]]) -> Result<Picture> {
        Ok(self.studio.draw(weights, &self.places, &self.scene, self.background)?)
    }
}
