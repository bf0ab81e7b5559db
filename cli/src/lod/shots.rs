//! Pictures to compare poses by: from the front, and each twice, lit from one side and from the other, so that what happens
//! on the left counts as much as on the right.

use super::picture::{Pixels, mean_square, perceptual, ssim};
use crate::args::lod::Metric;
use crate::input::Input;
use crate::output::Failure;
use crate::render::scenery::Subject;
use crate::runner::Gpu;
use deltamorph::{BatchSize, BoundClip, PackedMesh, UpdateDesc, UpdateMode, UpdatePath};
use deltamorph_render::{Camera, Light, Picture, Poses, Scene, Show, Studio, StudioDesc};
use glam::Mat4;
use std::path::Path;

/// Pixels of a picture: enough to see a lip move.
const SIZE: [u32; 2] = [128; 2];
/// Linear grey behind the head.
const BACKGROUND: [f32; 4] = [0.02, 0.02, 0.02, 1.0];
/// Frames of clips that are drawn.
const FRAMES: usize = 4;

/// Where pictures are taken, and those of whole frames that others are compared with.
pub struct Shots<'a> {
    studio: Studio<'a>,
    scenes: [Scene; 2],
    frames: Vec<(Vec<f32>, Pixels)>,
}

impl<'a> Shots<'a> {
    /// Of the mesh that was read at `path`, or else the built-in head; frames are spread evenly over `clips`.
    pub fn new(
        gpu: &'a Gpu,
        input: &Input,
        packed: &PackedMesh,
        path: Option<&Path>,
        clips: &[BoundClip],
    ) -> Result<Self, Failure> {
        let subject = Subject::new(path, input);
        // Poses that do not depend on those before them: twins are to have equal scores.
        let update = UpdateDesc::new(UpdatePath::Blocks, BatchSize::All).mode(UpdateMode::Rebuild);
        let desc = StudioDesc { size: SIZE, heads: 1, in_flight: 3, update, afterglow: 0.0 };
        let studio = Studio::new(gpu, &input.kept, packed, &subject.parts, desc)?;
        let camera = Camera { yaw: 0.0, pitch: 0.0, ..Camera::default() };
        let view = camera.fit(subject.focus.iter().copied(), 1.0, 0.04);
        let usual = Light::default();
        let scenes =
            [usual.yaw, -usual.yaw].map(|yaw| Scene { view, light: Light { yaw, ..usual }, show: Show::Shaded });
        let mut shots = Self { studio, scenes, frames: vec![] };
        let all: Vec<Vec<f32>> =
            clips.iter().flat_map(BoundClip::frames).filter(|f| f.iter().any(|w| *w != 0.0)).collect();
        let spread =
            (0..FRAMES.min(all.len())).map(|i| all[(2 * i + 1) * all.len() / (2 * FRAMES.min(all.len()))].clone());
        let weights: Vec<Vec<f32>> = spread.collect();
        shots.frames = weights.iter().cloned().zip(shots.take(&weights)?).collect();
        Ok(shots)
    }

    /// A picture of each pose.
    fn take(&mut self, poses: &[Vec<f32>]) -> Result<Vec<Pixels>, Failure> {
        let mut pictures: Vec<Picture> = vec![];
        for weights in poses {
            for scene in &self.scenes {
                pictures.extend(self.studio.draw(Poses::Weights(&[weights]), &[Mat4::IDENTITY], scene, BACKGROUND)?);
            }
        }
        pictures.extend(self.studio.finish()?);
        // One below the other.
        let rgb = |p: &Picture| p.rgba.chunks_exact(4).flat_map(|c| [c[0], c[1], c[2]]).collect::<Vec<u8>>();
        let pair = |pair: &[Picture]| Pixels { size: [SIZE[0], 2 * SIZE[1]], rgb: pair.iter().flat_map(rgb).collect() };
        Ok(pictures.chunks_exact(2).map(pair).collect())
    }

    /// What each target changes by itself, at weight 1, in the base pose: by `metrics` of pictures.
    pub fn scores(&mut self, metrics: &[Metric], targets: usize) -> Result<Vec<Vec<f64>>, Failure> {
        let mut poses = vec![vec![0.0; targets]; targets + 1];
        (0..targets).for_each(|t| poses[t][t] = 1.0);
        let mut pictures = self.take(&poses)?;
        let base = pictures.pop().ok_or_else(|| Failure::Failed("no picture was drawn; report this".into()))?;
        Ok(metrics.iter().map(|m| pictures.iter().map(|p| difference(*m, p, &base)).collect()).collect())
    }

    /// Mean difference of frames with only the `kept` targets from whole ones, by `metrics` of pictures.
    pub fn loss(&mut self, metrics: &[Metric], kept: &[bool]) -> Result<Vec<f64>, Failure> {
        let without = |w: &Vec<f32>| w.iter().zip(kept).map(|(w, kept)| if *kept { *w } else { 0.0 }).collect();
        let poses: Vec<Vec<f32>> = self.frames.iter().map(|(weights, _)| without(weights)).collect();
        let pictures = self.take(&poses)?;
        let count = pictures.len().max(1) as f64;
        let of =
            |m: &Metric| pictures.iter().zip(&self.frames).map(|(p, (_, whole))| difference(*m, p, whole)).sum::<f64>();
        Ok(metrics.iter().map(|m| of(m) / count).collect())
    }
}

/// 0 of equal pictures; the larger, the more they differ.
fn difference(metric: Metric, a: &Pixels, b: &Pixels) -> f64 {
    match metric {
        Metric::ImageMse => mean_square(a, b),
        Metric::Ssim => 1.0 - ssim(a, b),
        Metric::Perceptual => perceptual(a, b),
        Metric::Mse | Metric::Hausdorff => 0.0,
    }
}
