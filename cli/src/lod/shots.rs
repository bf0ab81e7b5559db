//! Pictures that poses are compared by: of the mesh, from the front, in light from the front.

use super::picture::{Pixels, mean_square, ssim};
use super::yee::yee;
use crate::args::lod::Metric;
use crate::input::{self, Input};
use crate::output::Failure;
use crate::render::scenery::Subject;
use crate::runner::Gpu;
use deltamorph::{BatchSize, BoundClip, DeltaFormat, PackedMesh, UpdateDesc, UpdateMode, UpdatePath};
use deltamorph_render::{Camera, HeadsDesc, Light, Picture, Scene, Show, Studio};
use glam::Mat4;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// Pixels of a picture: enough to see a lip move.
const SIZE: [u32; 2] = [256; 2];
/// Linear grey.
const BACKGROUND: [f32; 4] = [0.02, 0.02, 0.02, 1.0];

/// The studio, and the pictures of complete frames to compare with.
pub struct Shots<'a> {
    studio: Studio<'a>,
    scene: Scene,
    frames: Vec<(Vec<f32>, Pixels)>,
}

impl<'a> Shots<'a> {
    /// For the mesh that was read at `path`, or the built-in head; frames are spread evenly over `clips`.
    pub fn new(gpu: &'a Gpu, input: &Input, path: Option<&Path>, clips: &[BoundClip]) -> Result<Self, Failure> {
        let mesh = &input.kept;
        let subject = Subject::of_mesh(path, mesh);
        // Poses that do not depend on earlier ones. Rounding deltas moves vertices by much less than a pixel.
        let packed = Arc::new(PackedMesh::pack(mesh, &gpu.engine().pack_desc(DeltaFormat::Fast))?);
        let update = UpdateDesc { mode: UpdateMode::Rebuild, ..UpdateDesc::new(UpdatePath::Blocks, BatchSize::All) };
        let desc = HeadsDesc { frames: 3, ..HeadsDesc::new(update) };
        let camera = Camera { yaw: input.front, pitch: 0.0, ..Camera::default() };
        // Both halves of the face are lit alike.
        let light = Light { yaw: 0.0, ..Light::default() };
        let view = camera.fit(subject.focus.iter().copied(), 1.0, 0.04);
        let mut shots = Self {
            studio: Studio::new(gpu, mesh, &packed, &subject.parts, SIZE, &desc)?,
            scene: Scene { view, light, show: Show::Shaded, end: 1.0 },
            frames: vec![],
        };
        let weights = input::spread(clips);
        let pictures = shots.take(&weights)?;
        shots.frames = weights.into_iter().zip(pictures).collect();
        Ok(shots)
    }

    /// Draws each pose.
    fn take(&mut self, poses: &[Vec<f32>]) -> Result<Vec<Pixels>, Failure> {
        let mut pictures: Vec<Picture> = vec![];
        for weights in poses {
            let finished = self.studio.draw(&[weights], &[Mat4::IDENTITY], &self.scene, BACKGROUND)?;
            pictures.extend(finished);
        }
        pictures.extend(self.studio.finish()?);
        let rgb = |p: &Picture| p.rgba.chunks_exact(4).flat_map(|c| [c[0], c[1], c[2]]).collect();
        Ok(pictures.iter().map(|p| Pixels { size: p.size, rgb: rgb(p) }).collect())
    }

    /// The difference that each target makes by itself, at weight 1, from the base pose: a list for each of `metrics`,
    /// all of them metrics of pictures.
    pub fn scores(&mut self, metrics: &[Metric], targets: usize) -> Result<Vec<Vec<f64>>, Failure> {
        let mut poses = vec![vec![0.0; targets]; targets + 1];
        (0..targets).for_each(|t| poses[t][t] = 1.0);
        let mut pictures = self.take(&poses)?;
        let base = pictures.pop().ok_or_else(|| Failure::Failed("no picture was drawn; report this".into()))?;
        let of_metric = |m: &Metric| pictures.par_iter().map(|picture| difference(*m, picture, &base)).collect();
        Ok(metrics.iter().map(of_metric).collect())
    }

    /// Mean difference between frames with only the `kept` targets and complete ones, by each of `metrics`, all of them
    /// metrics of pictures. With `only`, of the frame of this number, counted on from the first one.
    pub fn loss(&mut self, metrics: &[Metric], kept: &[bool], only: Option<usize>) -> Result<Vec<f64>, Failure> {
        let all = self.frames.len();
        let frames = only.filter(|_| all > 0).map_or(0..all, |frame| frame % all..frame % all + 1);
        let count = frames.len().max(1) as f64;
        // Pictures of frames in which no other target is active are equal.
        let lacks = |frame: &usize| self.frames[*frame].0.iter().zip(kept).any(|(w, kept)| *w != 0.0 && !kept);
        let frames: Vec<usize> = frames.filter(lacks).collect();
        let without = |w: &Vec<f32>| w.iter().zip(kept).map(|(w, kept)| if *kept { *w } else { 0.0 }).collect();
        let poses: Vec<Vec<f32>> = frames.iter().map(|frame| without(&self.frames[*frame].0)).collect();
        let pictures = self.take(&poses)?;
        let wholes = frames.iter().map(|frame| &self.frames[*frame].1);
        let pairs: Vec<(&Pixels, &Pixels)> = pictures.iter().zip(wholes).collect();
        let of_pair = |(a, b): &(&Pixels, &Pixels)| metrics.iter().map(|m| difference(*m, a, b)).collect();
        let differences: Vec<Vec<f64>> = pairs.par_iter().map(of_pair).collect();
        let mean = |m: usize| differences.iter().fold(0.0, |sum, d| sum + d[m]) / count;
        Ok((0..metrics.len()).map(mean).collect())
    }
}

/// 0 for equal pictures, larger the more they differ. Symmetric in `a` and `b`.
fn difference(metric: Metric, a: &Pixels, b: &Pixels) -> f64 {
    match metric {
        Metric::ImageMse => mean_square(a, b),
        Metric::Ssim => 1.0 - ssim(a, b),
        Metric::Perceptual => yee(a, b).graded(),
        Metric::Mse | Metric::Hausdorff | Metric::All => 0.0,
    }
}
