//! Joints of a glTF file, which move its mesh in each frame of a clip of the same file.

use super::painted::Still;
use super::scenery::bounds;
use crate::args::InputArgs;
use crate::args::render::{Normals, RenderArgs};
use crate::input::Input;
use crate::output::Failure;
use deltamorph::MorphMesh;
use deltamorph::after::SkinDesc;
use deltamorph::import::gltf::{self, Animation, Skeleton};
use deltamorph::import::{animation_of, is_gltf};
use glam::{DMat4, DVec3, Vec3};
use std::path::{Path, PathBuf};

/// Most points to determine the extent of frames from.
const POINTS: usize = 100_000;

pub struct Joints {
    file: PathBuf,
    skeleton: Skeleton,
    /// The animation that the weights belong to, and the times of its frames.
    playing: Option<(usize, Vec<f64>)>,
    /// The joints of the still parts.
    of_still: Option<Skeleton>,
    /// Frames per second of clips, if stated.
    fps: Option<f32>,
    /// Origin of the mesh's positions.
    origin: DVec3,
}

/// The file whose joints move the mesh; `None` for pictures of targets alone.
pub fn file(args: &RenderArgs) -> Option<&PathBuf> {
    let is_of_targets = args.look().is_of_targets() || args.normals == Normals::Recomputed;
    args.run.input.input.as_ref().filter(|path| is_gltf(path) && !is_of_targets)
}

impl Joints {
    /// The joints of INPUT, if it is a file that has any, at rest.
    pub fn of(args: &InputArgs, input: &Input) -> Result<Option<Self>, Failure> {
        let Some(file) = args.input.as_ref().filter(|path| is_gltf(path)) else { return Ok(None) };
        let scene = gltf::read(file)?.into_scene(true)?;
        let Some(skeleton) = scene.mesh.skeleton else { return Ok(None) };
        let of_still = scene.still.and_then(|still| still.skeleton);
        let file = file.clone();
        let origin = input.kept.origin.as_dvec3();
        Ok(Some(Self { file, skeleton, of_still, playing: None, fps: args.fps, origin }))
    }

    /// Animations that move joints alone, as FILE#NAME.
    #[cfg(feature = "viewer")]
    pub fn alone(&self) -> impl Iterator<Item = PathBuf> {
        let alone = self.skeleton.animations.iter().filter(|animation| animation.moves_joints_alone());
        alone.map(|animation| PathBuf::from(format!("{}#{}", self.file.display(), animation.name)))
    }

    /// Takes the animation that `clip` is, FILE#NAME; joints rest while it is another file's.
    pub fn play(&mut self, clip: &Path) -> Result<(), Failure> {
        let named = animation_of(clip).filter(|(file, _)| *file == self.file);
        let is_named = |animation: &Animation| named.as_ref().is_some_and(|(_, name)| animation.name == *name);
        let playing = self.skeleton.animations.iter().position(is_named);
        let times = |number: usize| -> Result<_, Failure> {
            Ok((number, self.skeleton.animations[number].frame_times(self.fps)?.collect()))
        };
        self.playing = playing.map(times).transpose()?;
        Ok(())
    }

    pub fn skin(&self) -> SkinDesc<'_> {
        let influences = &self.skeleton.influences;
        let count = self.skeleton.joint_count() as u32;
        SkinDesc::new(influences.per_vertex as u32, count, &influences.joints, &influences.weights)
    }

    /// Matrices at a frame of the clip, or between two; without a frame, at rest.
    fn matrices(&self, skeleton: &Skeleton, frame: Option<f64>) -> Vec<DMat4> {
        let time = |(number, times): &(usize, Vec<f64>)| {
            let frame = frame?;
            let last = times.len().checked_sub(1)?;
            let before = (frame as usize).min(last);
            let after = (frame as usize + 1).min(last);
            Some((&self.skeleton.animations[*number], times[before] + (times[after] - times[before]) * frame.fract()))
        };
        let matrices = skeleton.joint_matrices(self.playing.as_ref().and_then(time));
        let [to, from] = [self.origin, -self.origin].map(DMat4::from_translation);
        matrices.into_iter().map(|matrix| from * matrix * to).collect()
    }

    /// The first three rows of each matrix.
    pub fn at(&self, frame: Option<f64>) -> Vec<f32> {
        let rows = |matrix: DMat4| matrix.transpose().to_cols_array().map(|number| number as f32);
        self.matrices(&self.skeleton, frame).into_iter().flat_map(|matrix| rows(matrix).into_iter().take(12)).collect()
    }

    /// Vertices of still parts at a frame.
    pub fn still_at(&self, still: &Still, frame: Option<f64>) -> Option<Vec<f32>> {
        let skeleton = self.of_still.as_ref()?;
        Some(still.skinned(skeleton, &self.matrices(skeleton, frame)))
    }

    /// Positions of still parts in this frame or in all.
    pub fn reach_of_still(&self, still: &Still, frame: Option<f64>, all: bool) -> Vec<Vec3> {
        let frames = self.frames(frame, all);
        let step = (still.mesh.vertex_count() * frames.len()).div_ceil(POINTS).max(1);
        let at = |frame: &Option<f64>| self.still_at(still, *frame).unwrap_or_default();
        let vertices = frames.iter().step_by(step).map(at);
        vertices.flat_map(|all| all.chunks_exact(6).map(Vec3::from_slice).collect::<Vec<_>>()).collect()
    }

    /// This frame, or all of the clip.
    fn frames(&self, frame: Option<f64>, all: bool) -> Vec<Option<f64>> {
        match &self.playing {
            Some((_, times)) if all => (0..times.len()).map(|frame| Some(frame as f64)).collect(),
            _ => vec![frame],
        }
    }

    /// Positions of points within `focus` after skinning, in this frame or in all: of base positions, and of vertices
    /// moved by single targets.
    pub fn reach(&self, mesh: &MorphMesh, focus: &[Vec3], frame: Option<f64>, all: bool) -> Vec<Vec3> {
        let (low, high) = bounds(focus.iter().copied());
        let moved = mesh.targets.iter().flat_map(|target| target.vertices.iter().zip(&target.positions));
        let moved = moved.map(|(v, delta)| (*v as usize, mesh.positions[*v as usize] + *delta));
        let points = mesh.positions.iter().copied().enumerate().chain(moved);
        let points: Vec<_> = points.filter(|(_, p)| p.cmpge(low).all() && p.cmple(high).all()).collect();
        let frames = self.frames(frame, all);
        let step = (points.len() * frames.len()).div_ceil(POINTS).max(1);
        let influences = &self.skeleton.influences;
        let at = |frame: &Option<f64>| {
            let matrices = self.matrices(&self.skeleton, *frame);
            let skinned =
                |(v, p): &(usize, Vec3)| influences.blend(*v, &matrices).transform_point3(p.as_dvec3()).as_vec3();
            points.iter().step_by(step).map(skinned).collect::<Vec<_>>()
        };
        frames.iter().flat_map(at).collect()
    }
}
