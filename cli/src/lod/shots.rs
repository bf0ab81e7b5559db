//! Pictures that poses are compared by: of the mesh, from the front, in light from the front.

use super::picture::{mean_square, ssim};
use super::yee::yee;
use crate::args::lod::Metric;
use crate::input::{self, Input};
use crate::output::{Failure, Result};
use crate::render::subject::Subject;
use crate::runner::Gpu;
use deltamorph::{BatchSize, BoundClip, DeltaFormat, PackedMesh, UpdateDesc, UpdateMode, UpdatePath};
use deltamorph_render::{HeadsDesc, Light, Picture, Scene, Show, Studio};
use glam::Mat4;
use rayon::prelude::*;
use std::sync::Arc;

/// Pixels of a picture: enough to see a lip move.
const SIZE: [u32; 2] = [256; 2];
/// Linear grey.
const BACKGROUND: [f32; 4] = [0.02, 0.02, 0.02, 1.0];

/// The studio, and the pictures of complete frames to compare with.
pub struct Shots<'a> {
    studio: Studio<'a>,
    scene: Scene,
    frames: Vec<(Vec<f32>, Picture)>,
}

impl<'a> Shots<'a> {
    /// Frames are spread evenly over `clips`.
    pub fn new(gpu: &'a Gpu, input: &Input, clips: &[BoundClip]) -> Result<Self> {
        let mesh = &input.kept;
        let subject = Subject::of_mesh(input);
        // Poses that do not depend on earlier ones. Rounding deltas moves vertices by much less than a pixel.
        let packed = Arc::new(PackedMesh::pack(mesh, &gpu.engine().pack_desc(DeltaFormat::Fast))?);
        let update = UpdateDesc { mode: UpdateMode::Rebuild, ..UpdateDesc::new(UpdatePath::Blocks, BatchSize::All) };
        // Both halves of the face are lit alike.
        let light = Light { yaw: 0.0, ..Light::default() };
        let view = subject.view([0.0; 2], &[Mat4::IDENTITY], 1.0, 0.04);
        let mut shots = Self {
            studio: Studio::new(gpu, mesh, &packed, &subject.parts, SIZE, &HeadsDesc::new(update))?,
            scene: Scene { view, light, show: Show::Shaded, end: 1.0 },
            frames: vec![],
        };
        let weights = input::spread(clips);
        let pictures = shots.take(&weights)?;
        shots.frames = weights.into_iter().zip(pictures).collect();
        Ok(shots)
    }

    /// Draws each pose.
    fn take(&mut self, poses: &[Vec<f32>]) -> Result<Vec<Picture>> {
        let mut draw = |weights| self.studio.draw(&[weights], &[Mat4::IDENTITY], &self.scene, BACKGROUND);
        Ok(poses.iter().map(&mut draw).collect::<Result<_, _>>()?)
    }

    /// The difference that each target makes by itself, at weight 1, from the base pose.
    pub fn scores(&mut self, metric: Metric, targets: usize) -> Result<Vec<f64>> {
        let mut poses = vec![vec![0.0; targets]; targets + 1];
        (0..targets).for_each(|t| poses[t][t] = 1.0);
        let mut pictures = self.take(&poses)?;
        let base = pictures.pop().ok_or_else(|| Failure::Failed("no picture was drawn; report this".into()))?;
        Ok(pictures.par_iter().map(|picture| difference(metric, picture, &base)).collect())
    }

    /// Mean difference between frames with only the `kept` targets and complete ones. With `only`, of the frame of this
    /// number, counted on from the first one.
    pub fn loss(&mut self, metric: Metric, kept: &[bool], only: Option<usize>) -> Result<f64> {
        let all = self.frames.len();
        let frames = only.filter(|_| all > 0).map_or(0..all, |frame| frame % all..frame % all + 1);
        let count = frames.len().max(1) as f64;
        // Pictures of frames in which no other target is active are equal.
        let lacks = |frame: &usize| self.frames[*frame].0.iter().zip(kept).any(|(w, kept)| *w != 0.0 && !kept);
        let frames: Vec<usize> = frames.filter(lacks).collect();
        let without = |w: &Vec<f32>| w.iter().zip(kept).map(|(w, kept)| if *kept { *w } else { 0.0 }).collect();
        let poses: Vec<Vec<f32>> = frames.iter().map(|frame| without(&self.frames[*frame].0)).collect();
        let (pictures, wholes) = (self.take(&poses)?, &self.frames);
        let pairs = pictures.par_iter().zip(&frames);
        let differences: Vec<f64> = pairs.map(|(part, frame)| difference(metric, part, &wholes[*frame].1)).collect();
        Ok(differences.iter().sum::<f64>() / count)
    }
}

/// 0 for equal pictures, larger the more they differ. Symmetric in `a` and `b`.
fn difference(metric: Metric, a: &Picture, b: &Picture) -> f64 {
    match metric {
        Metric::ImageMse => mean_square(a, b),
        Metric::Ssim => 1.0 - ssim(a, b),
        Metric::Perceptual => yee(a, b).graded(),
        Metric::Mse | Metric::Hausdorff | Metric::All => 0.0,
    }
}
