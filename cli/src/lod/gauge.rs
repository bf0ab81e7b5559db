//! Measures for `lod`: scores of targets, and errors of clips that keep only the first targets of an order.

use super::Point;
use super::geometry::{Loss, hausdorff, tree};
use super::order::Order;
use super::shots::Shots;
use crate::args::lod::Metric;
use crate::input::Input;
use crate::output::Failure;
use deltamorph::BoundClip;
use deltamorph::lod::{is_pinned, mean_square};
use deltamorph_head::Rng;
use rayon::prelude::*;

/// Random orders that are drawn, each in one frame: a software driver takes a tenth of a second for a picture.
const DRAWN: usize = 32;

/// Measures on a mesh and its clips.
pub struct Gauge<'a> {
    input: &'a Input,
    vertices: Loss,
    shots: Option<Shots<'a>>,
    /// Random orders of targets, pins first, for comparison.
    random: Vec<Vec<usize>>,
}

impl<'a> Gauge<'a> {
    pub fn new(
        input: &'a Input,
        clips: &[BoundClip],
        shots: Option<Shots<'a>>,
        random: usize,
        seed: u64,
        pins: &[String],
    ) -> Self {
        let mesh = &input.kept;
        let shuffled = |stream: usize| {
            let mut rng = Rng::new(seed, stream as u64);
            let mut order: Vec<usize> = (0..mesh.targets.len()).collect();
            (1..order.len()).rev().for_each(|i| order.swap(i, rng.below(i + 1)));
            order.sort_by_key(|t| !is_pinned(&mesh.targets[*t].name, pins));
            order
        };
        Self { input, vertices: Loss::new(mesh, clips), shots, random: (0..random).map(shuffled).collect() }
    }

    /// A list of scores for each metric, with a number for each target.
    pub fn scores(&mut self, metrics: &[Metric]) -> Result<Vec<Vec<f64>>, Failure> {
        let mesh = &self.input.kept;
        let base = tree(&mesh.positions);
        let of_pictures: Vec<Metric> = metrics.iter().copied().filter(|m| m.is_of_pictures()).collect();
        let mut drawn = match &mut self.shots {
            Some(shots) => shots.scores(&of_pictures, mesh.targets.len())?,
            None => vec![],
        }
        .into_iter();
        let list = |metric: &Metric| match metric {
            Metric::Mse => mesh.targets.iter().map(|t| mean_square(mesh, t)).collect(),
            Metric::Hausdorff => mesh.targets.par_iter().map(|t| hausdorff(mesh, &base, t)).collect(),
            _ => drawn.next().unwrap_or_default(),
        };
        Ok(metrics.iter().map(list).collect())
    }

    /// A curve for each of `metrics`, along its order in `orders`.
    pub fn curves(&mut self, metrics: &[Metric], orders: &[Order]) -> Result<Vec<Vec<Point>>, Failure> {
        let targets = &self.input.kept.targets;
        let scale = 1.0 / crate::verify::scale(self.input.kept.diagonal);
        let mut kept: Vec<usize> = (1..=4).map(|quarter| (targets.len() * quarter).div_ceil(4)).collect();
        kept.dedup();
        let of_pictures: Vec<Metric> = metrics.iter().copied().filter(|m| m.is_of_pictures()).collect();
        let mut curves = vec![vec![]; metrics.len()];
        for kept in kept {
            let random: Vec<Vec<bool>> = self.random.iter().map(|order| first(order, kept)).collect();
            let vertex_random =
                random.iter().map(|keeps| self.vertices.of(keeps)).sum::<f64>() * scale / random.len() as f64;
            let mut drawn_random = vec![0.0; of_pictures.len()];
            if let Some(shots) = &mut self.shots {
                let count = random.len().min(DRAWN);
                for (number, keeps) in random.iter().take(count).enumerate() {
                    let losses = shots.loss(&of_pictures, keeps, Some(number))?;
                    drawn_random.iter_mut().zip(losses).for_each(|(sum, loss)| *sum += loss / count as f64);
                }
            }
            for ((metric, order), curve) in metrics.iter().zip(orders).zip(&mut curves) {
                let keeps = first(&order.targets, kept);
                let vertex_rel = self.vertices.of(&keeps) * scale;
                let (error_rel, error_random_rel) =
                    match (&mut self.shots, of_pictures.iter().position(|m| m == metric)) {
                        (Some(shots), Some(i)) => (shots.loss(&[*metric], &keeps, None)?[0], drawn_random[i]),
                        _ => (vertex_rel, vertex_random),
                    };
                curve.push(Point { kept, error_rel, error_random_rel, vertex_rel });
            }
        }
        Ok(curves)
    }
}

/// Whether each target is among the first `kept` of an order.
fn first(order: &[usize], kept: usize) -> Vec<bool> {
    let mut keeps = vec![false; order.len()];
    order[..kept].iter().for_each(|t| keeps[*t] = true);
    keeps
}
