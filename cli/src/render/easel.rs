//! The base of every picture: the mesh, packed and uploaded, a camera that fits it, and instances on the chosen path.

use super::canvas::Canvas;
use super::scenery::Scenery;
use crate::args::render::Normals;
use crate::output::Failure;
use deltamorph_render::{Camera, HeadsDesc, Light, Scene, Studio};
use glam::{Mat4, Vec3};

/// Pictures in flight: the processor encodes and plans while the device draws.
const IN_FLIGHT: usize = 3;
/// Share of the glow of changed blocks that remains after each frame of a clip.
const AFTERGLOW: f32 = 0.8;
/// Share of a picture that stays free at each edge, since poses extend beyond the base pose.
const MARGIN: f32 = 0.08;

/// A studio, instances, and a view of them.
pub struct Easel<'a> {
    studio: Studio<'a>,
    places: Vec<Mat4>,
    pub scene: Scene,
    background: [f32; 4],
}

impl<'a> Easel<'a> {
    /// For pictures of this size, with an instance at each of `places`, on the path of the command line.
    pub fn new(scenery: &'a Scenery<'_>, size: [u32; 2], places: Vec<Mat4>) -> Result<Self, Failure> {
        let Scenery { args, stage, subject, .. } = scenery;
        let mesh = &scenery.input.kept;
        let desc = HeadsDesc {
            count: places.len() as u32,
            frames: IN_FLIGHT,
            update: stage.desc,
            threads: stage.threads,
            recompute_normals: args.normals == Normals::Recomputed,
            afterglow: if args.clip.is_some() { AFTERGLOW } else { 0.0 },
            cull: places.len() > 1,
        };
        let mut studio = Studio::new(scenery.gpu, mesh, &stage.mesh, &subject.parts, size, &desc)?;
        if let Some(still) = &subject.still {
            studio.set_still(&still.mesh, &still.parts)?;
        }
        let camera = Camera { yaw: subject.front + args.camera[0], pitch: args.camera[1], ..Camera::default() };
        let all = places.iter().flat_map(|place| subject.focus.iter().map(|p| place.transform_point3(*p)));
        let mut view = camera.fit(all, size[0] as f32 / size[1] as f32, MARGIN);
        view.reach(places.iter().flat_map(|place| subject.whole.iter().map(|p| place.transform_point3(*p))));
        view.clip = Mat4::from_scale(Vec3::new(args.zoom, args.zoom, 1.0)) * view.clip;
        let [yaw, pitch, strength] = args.light;
        Ok(Self {
            studio,
            places,
            // `heat::prepare` sets the end of the scale.
            scene: Scene { view, light: Light { yaw, pitch, strength }, show: args.look(), end: 1.0 },
            background: args.background.linear(),
        })
    }

    /// Begins a picture of the instances with these weights. Returns the oldest picture if it had to wait for it.
    pub fn draw(&mut self, weights: &[&[f32]]) -> Result<Option<Canvas>, Failure> {
        let finished = self.studio.draw(weights, &self.places, &self.scene, self.background)?;
        Ok(finished.map(Canvas::from))
    }

    /// Waits for the remaining pictures.
    pub fn finish(&mut self) -> Result<Vec<Canvas>, Failure> {
        Ok(self.studio.finish()?.into_iter().map(Canvas::from).collect())
    }

    /// Draws one picture, and waits for it.
    pub fn picture(&mut self, weights: &[&[f32]]) -> Result<Canvas, Failure> {
        self.draw(weights)?;
        self.finish()?.pop().ok_or_else(|| Failure::Failed("no picture was drawn; report this".into()))
    }

    /// Number of draws in the last picture, and of draws culled because their instances are outside it.
    pub fn draws(&self) -> [usize; 2] {
        self.studio.draws()
    }
}
