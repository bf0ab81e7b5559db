//! Pictures that poses are compared by: of the mesh and of its mirror image, from the front, in the same light. The
//! face is thus lit from either side, and two targets that mirror each other give the same two pictures, sample by
//! sample, even though the four samples of a pixel and those of shadows are not symmetric.

use super::picture::{Pixels, mean_square, perceptual, ssim};
use super::twins::{align_faces, middle, mirrored};
use super::yee::yee;
use crate::args::lod::Metric;
use crate::input::Input;
use crate::output::Failure;
use crate::render::scenery::Subject;
use crate::runner::Gpu;
use deltamorph::{BatchSize, BoundClip, DeltaFormat, MorphMesh, PackedMesh, UpdateDesc, UpdateMode, UpdatePath};
use deltamorph_render::{Camera, Light, Part, Picture, Poses, Scene, Show, Studio, StudioDesc};
use glam::{Mat4, Vec3};
use rayon::prelude::*;
use std::path::Path;

/// Pixels of a picture: enough to see a lip move.
pub const SIZE: [u32; 2] = [256; 2];
/// Linear grey.
const BACKGROUND: [f32; 4] = [0.02, 0.02, 0.02, 1.0];
/// Frames of clips that are drawn.
pub const FRAMES: usize = 8;

/// Pictures of a pose: of the mesh, and of its mirror image.
type Look = [Pixels; 2];

/// A studio with exact deltas, whose poses do not depend on earlier ones.
pub fn studio<'a>(gpu: &'a Gpu, mesh: &MorphMesh, parts: &[Part], size: [u32; 2]) -> Result<Studio<'a>, Failure> {
    let packed = PackedMesh::pack(mesh, &gpu.engine().pack_desc(DeltaFormat::BlockFloat32))?;
    let update = UpdateDesc::new(UpdatePath::Blocks, BatchSize::All).mode(UpdateMode::Rebuild);
    Ok(Studio::new(
        gpu,
        mesh,
        &packed,
        parts,
        StudioDesc { size, heads: 1, in_flight: 3, update, afterglow: 0.0, cull: false },
    )?)
}

/// The studios, and the pictures of complete frames to compare with.
pub struct Shots<'a> {
    studios: [Studio<'a>; 2],
    scene: Scene,
    frames: Vec<(Vec<f32>, Look)>,
}

impl<'a> Shots<'a> {
    /// For the mesh that was read at `path`, or the built-in head; frames are spread evenly over `clips`.
    pub fn new(gpu: &'a Gpu, input: &Input, path: Option<&Path>, clips: &[BoundClip]) -> Result<Self, Failure> {
        let middle = middle(&input.kept);
        let mut straight = MorphMesh::clone(&input.kept);
        align_faces(&mut straight, middle);
        let (subject, mirror) = (Subject::of_mesh(path, &straight), mirrored(&straight, middle));
        let parts: Vec<Part> = subject.parts.iter().map(|part| mirrored_part(part, middle)).collect();
        let studios = [studio(gpu, &straight, &subject.parts, SIZE)?, studio(gpu, &mirror, &parts, SIZE)?];
        let camera = Camera { yaw: 0.0, pitch: 0.0, ..Camera::default() };
        let seen = subject.focus.iter().flat_map(|p| [*p, Vec3::new(2.0 * middle - p.x, p.y, p.z)]);
        let scene = Scene { view: camera.fit(seen, 1.0, 0.04), light: Light::default(), show: Show::Shaded };
        let mut shots = Self { studios, scene, frames: vec![] };
        let all: Vec<Vec<f32>> =
            clips.iter().flat_map(BoundClip::frames).filter(|f| f.iter().any(|w| *w != 0.0)).collect();
        let count = FRAMES.min(all.len());
        let weights: Vec<Vec<f32>> = (0..count).map(|i| all[(2 * i + 1) * all.len() / (2 * count)].clone()).collect();
        shots.frames = weights.iter().cloned().zip(shots.take(&weights)?).collect();
        Ok(shots)
    }

    /// Draws each pose.
    fn take(&mut self, poses: &[Vec<f32>]) -> Result<Vec<Look>, Failure> {
        let mut taken: [Vec<Pixels>; 2] = [vec![], vec![]];
        let rgb = |p: &Picture| p.rgba.chunks_exact(4).flat_map(|c| [c[0], c[1], c[2]]).collect();
        for (studio, taken) in self.studios.iter_mut().zip(&mut taken) {
            let mut pictures: Vec<Picture> = vec![];
            for weights in poses {
                let drawn = studio.draw(Poses::Weights(&[weights]), &[Mat4::IDENTITY], &self.scene, BACKGROUND)?;
                pictures.extend(drawn);
            }
            pictures.extend(studio.finish()?);
            taken.extend(pictures.iter().map(|p| Pixels { size: p.size, rgb: rgb(p) }));
        }
        let [straight, mirrored] = taken;
        Ok(straight.into_iter().zip(mirrored).map(|(a, b)| [a, b]).collect())
    }

    /// The difference that each target makes by itself, at weight 1, from the base pose: a list for each of `metrics`,
    /// all of them metrics of pictures.
    pub fn scores(&mut self, metrics: &[Metric], targets: usize) -> Result<Vec<Vec<f64>>, Failure> {
        let mut poses = vec![vec![0.0; targets]; targets + 1];
        (0..targets).for_each(|t| poses[t][t] = 1.0);
        let mut looks = self.take(&poses)?;
        let base = looks.pop().ok_or_else(|| Failure::Failed("no picture was drawn; report this".into()))?;
        let of_metric = |m: &Metric| looks.par_iter().map(|look| difference(*m, look, &base)).collect();
        Ok(metrics.iter().map(of_metric).collect())
    }

    /// Mean difference between frames with only the `kept` targets and complete ones, by each of `metrics`, all of them
    /// metrics of pictures.
    pub fn loss(&mut self, metrics: &[Metric], kept: &[bool]) -> Result<Vec<f64>, Failure> {
        let without = |w: &Vec<f32>| w.iter().zip(kept).map(|(w, kept)| if *kept { *w } else { 0.0 }).collect();
        let poses: Vec<Vec<f32>> = self.frames.iter().map(|(weights, _)| without(weights)).collect();
        let looks = self.take(&poses)?;
        let pairs: Vec<(&Look, &Look)> = looks.iter().zip(self.frames.iter().map(|(_, whole)| whole)).collect();
        let of_pair = |(a, b): &(&Look, &Look)| metrics.iter().map(|m| difference(*m, a, b)).collect();
        let differences: Vec<Vec<f64>> = pairs.par_iter().map(of_pair).collect();
        let mean = |m: usize| differences.iter().map(|d| d[m]).sum::<f64>() / differences.len().max(1) as f64;
        Ok((0..metrics.len()).map(mean).collect())
    }
}

/// 0 for equal pictures, larger the more they differ; the mean of both pictures. Symmetric in `a` and `b`.
fn difference(metric: Metric, a: &Look, b: &Look) -> f64 {
    let of = |a: &Pixels, b: &Pixels| match metric {
        Metric::ImageMse => mean_square(a, b),
        Metric::Ssim => 1.0 - ssim(a, b),
        Metric::Perceptual => perceptual(a, b),
        Metric::Yee => yee(a, b).graded(),
        _ => 0.0,
    };
    (of(&a[0], &b[0]) + of(&a[1], &b[1])) / 2.0
}

/// A part of the mirror image, with its front faces kept.
fn mirrored_part(part: &Part, middle: f32) -> Part {
    let mut part = part.clone();
    part.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    part.ball.iter_mut().for_each(|ball| ball.x = 2.0 * middle - ball.x);
    part
}
