//! The base of every picture: the mesh, packed and uploaded, a camera that fits it, and instances on the chosen path.

use super::canvas::Canvas;
use super::joints::Joints;
use super::painted::Still;
use super::scenery::Scenery;
use crate::args::render::Normals;
use crate::detail::{self, Detail, Kept};
use crate::output::Failure;
use deltamorph::after::NormalsDesc;
use deltamorph::{CpuCrowd, PackedMesh, UpdateDesc, UpdatePath};
use deltamorph_render::{Camera, Light, Poses, Scene, Show, Step, StoredPose, Studio, StudioDesc};
use glam::{Mat4, Vec3};
use std::sync::Arc;

/// Pictures in flight: the processor encodes and plans while the device draws.
const IN_FLIGHT: u32 = 3;
/// Share of the glow of changed blocks that remains after each frame of a clip.
const AFTERGLOW: f32 = 0.8;
/// Share of a picture that stays free at each edge, since poses extend beyond the base pose.
const MARGIN: f32 = 0.08;

/// A studio, instances, and a view of them.
pub struct Easel<'a> {
    studio: Studio<'a>,
    heads: Heads,
    places: Vec<Mat4>,
    /// Frame of the clip that each instance shows, for its joints; `None`: at rest.
    pub frames: Vec<Option<usize>>,
    joints: Option<&'a Joints>,
    still: Option<&'a Still>,
    pub scene: Scene,
    background: [f32; 4],
    /// Number of targets that instances keep.
    detail: Detail,
    kept: Option<Kept>,
    camera: detail::Camera,
}

/// The source of the poses.
enum Heads {
    /// The studio's crowd.
    Device,
    /// A crowd on the path `cpu`, its mesh and its update description.
    Processor(Box<CpuCrowd>, Arc<PackedMesh>, UpdateDesc),
}

impl<'a> Easel<'a> {
    /// For pictures of this size, with an instance at each of `places`, on the path of the command line.
    pub fn new(scenery: &'a Scenery<'_>, size: [u32; 2], places: Vec<Mat4>) -> Result<Self, Failure> {
        let stage = scenery.stage;
        let heads = if stage.desc.path == UpdatePath::Cpu {
            let crowd = CpuCrowd::new(stage.mesh.clone(), stage.desc, places.len() as u32, stage.threads())?;
            Heads::Processor(Box::new(crowd), stage.mesh.clone(), stage.desc)
        } else {
            Heads::Device
        };
        let Scenery { args, stage, subject, .. } = scenery;
        let update = stage.desc;
        let afterglow = if args.clip.is_some() { AFTERGLOW } else { 0.0 };
        let (heads_count, cull) = (places.len() as u32, places.len() > 1);
        let desc = StudioDesc { size, heads: heads_count, in_flight: IN_FLIGHT, update, afterglow, cull };
        let joints = scenery.joints.as_ref().filter(|_| matches!(heads, Heads::Device));
        let mesh = &scenery.input.kept;
        let corners: Vec<u32> = mesh.faces.corners.iter().map(|corner| corner.position).collect();
        let surface = NormalsDesc::new(&corners).sizes(&mesh.faces.sizes).welds(&mesh.welds);
        let step = match (joints, args.normals) {
            (Some(joints), _) => Step::Skin(joints.skin()),
            (None, Normals::Recomputed) => Step::Normals(surface),
            (None, Normals::Summed) => Step::None,
        };
        let mut studio = Studio::with_step(scenery.gpu, mesh, &stage.mesh, &subject.parts, desc, &step)?;
        if let Some(still) = &subject.still {
            studio.set_still(&still.mesh, &still.parts)?;
        }
        let camera = Camera { yaw: args.camera[0], pitch: args.camera[1], ..Camera::default() };
        let all = places.iter().flat_map(|place| subject.focus.iter().map(|p| place.transform_point3(*p)));
        let mut view = camera.fit(all, size[0] as f32 / size[1] as f32, MARGIN);
        view.reach(places.iter().flat_map(|place| subject.whole.iter().map(|p| place.transform_point3(*p))));
        view.clip = Mat4::from_scale(Vec3::new(args.zoom, args.zoom, 1.0)) * view.clip;
        let [yaw, pitch, strength] = args.light;
        // `heat::prepare` sets the end of a scale.
        let show = args.checker.map_or(args.look().show(1.0), |squares| Show::Checker(squares as f32));
        let scene = Scene { view, light: Light { yaw, pitch, strength }, show };
        let kept = match args.detail {
            Detail::All => None,
            Detail::Share(_) | Detail::Pixels(_) => Some(Kept::new(&scenery.input.kept, &subject.focus)?),
        };
        let (height, angle) = (size[1] as f32 * args.zoom, camera.angle.to_radians());
        let seen = detail::Camera { eye: scene.view.eye, height, angle };
        let background = args.background.linear();
        let (frames, detail) = (vec![None; places.len()], args.detail);
        let still = subject.still.as_ref();
        Ok(Self { studio, heads, places, frames, joints, still, scene, background, detail, kept, camera: seen })
    }

    /// Begins a picture of the instances with these weights. Returns the oldest picture if it had to wait for it.
    pub fn draw(&mut self, weights: &[&[f32]]) -> Result<Option<Canvas>, Failure> {
        let Self { studio, heads, places, frames, joints, still, scene, background, detail, kept, camera } = self;
        let mut with: Vec<Vec<f32>>;
        let (mut refs, mut weights) = (vec![], weights);
        if let Some(kept) = kept {
            with = weights.iter().map(|weights| weights.to_vec()).collect();
            let units: Vec<f32> = places.iter().map(|place| kept.unit(camera, place)).collect();
            kept.apply(*detail, &units, &mut with)?;
            refs.extend(with.iter().map(Vec::as_slice));
            weights = &refs;
        }
        if let Some(joints) = joints {
            for (head, frame) in frames.iter().enumerate() {
                let frame = frame.map(|frame| frame as f64);
                studio.set_joints(head, &joints.at(frame))?;
                if let Some(vertices) = still.and_then(|still| joints.still_at(still, frame)) {
                    studio.set_still_vertices(head, &vertices)?;
                }
            }
        }
        let finished = match heads {
            Heads::Device => studio.draw(Poses::Weights(weights), places, scene, *background)?,
            Heads::Processor(crowd, mesh, desc) => {
                for (head, weights) in (0..).zip(weights) {
                    crowd.set_weights(head, weights)?;
                }
                crowd.update();
                let changed: Vec<_> = (0..weights.len() as u32).map(|head| crowd.changed(head)).collect();
                let stored = (0..).zip(&changed);
                let stored = stored.map(|(head, changed)| StoredPose::new(crowd, head, (mesh, desc), changed));
                let stored: Vec<_> = stored.collect::<deltamorph::Result<_>>()?;
                studio.draw(Poses::Stored(&stored), places, scene, *background)?
            }
        };
        Ok(finished.map(Canvas::from))
    }

    /// Waits for the remaining pictures.
    pub fn finish(&mut self) -> Result<Vec<Canvas>, Failure> {
        Ok(self.studio.finish()?.into_iter().map(Canvas::from).collect())
    }

    /// Draws one picture, and waits for it.
    pub fn picture(&mut self, weights: &[&[f32]]) -> Result<Canvas, Failure> {
        self.draw(weights)?;
        self.last()
    }

    fn last(&mut self) -> Result<Canvas, Failure> {
        self.finish()?.pop().ok_or_else(|| Failure::Failed("no picture was drawn; report this".into()))
    }

    /// Number of draws in the last picture, and of draws culled because their instances are outside it.
    pub fn draws(&self) -> [usize; 2] {
        self.studio.draws()
    }

    /// The number of all targets, and the fewest and most that an instance kept in the last picture; `None`: all.
    pub fn kept(&self) -> Option<(usize, [usize; 2])> {
        self.kept.as_ref().map(Kept::of_all)
    }
}
