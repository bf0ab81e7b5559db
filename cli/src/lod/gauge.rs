//! Measures for `lod`: scores of targets, and errors of clips that keep only the first targets of an order.

use super::Point;
use super::geometry::{Loss, hausdorff, tree};
use super::shots::Shots;
use crate::args::lod::Metric;
use crate::input::Input;
use crate::output::Result;
use crate::verify::scale;
use deltamorph::BoundClip;
use deltamorph::lod::mean_square;
use deltamorph_head::Rng;
use rayon::prelude::*;

/// Random orders that are drawn, each in one frame: a software driver takes a tenth of a second for a picture.
const DRAWN: usize = 32;

/// Measures on a mesh and its clips.
pub struct Gauge<'a> {
    input: &'a Input,
    vertices: Loss,
    /// For metrics of pictures.
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
        pinned: &[bool],
    ) -> Self {
        let shuffled = |stream: usize| {
            let mut rng = Rng::new(seed, stream as u64);
            let mut order: Vec<usize> = (0..pinned.len()).collect();
            (1..order.len()).rev().for_each(|i| order.swap(i, rng.below(i + 1)));
            order.sort_by_key(|t| !pinned[*t]);
            order
        };
        Self { input, vertices: Loss::new(&input.kept, clips), shots, random: (0..random).map(shuffled).collect() }
    }

    /// A number for each target.
    pub fn scores(&mut self, metric: Metric) -> Result<Vec<f64>> {
        let mesh = &self.input.kept;
        if let Some(shots) = self.shots.as_mut().filter(|_| metric.is_of_pictures()) {
            return shots.scores(metric, mesh.targets.len());
        }
        if metric == Metric::Mse {
            return Ok(mesh.targets.iter().map(|t| mean_square(mesh, t)).collect());
        }
        let base = tree(&mesh.positions);
        Ok(mesh.targets.par_iter().map(|t| hausdorff(mesh, &base, t)).collect())
    }

    /// The errors along an order of the targets.
    pub fn curve(&mut self, metric: Metric, order: &[usize]) -> Result<Vec<Point>> {
        let scale = scale(self.input.kept.diagonal);
        let mut counts: Vec<usize> = (1..=4).map(|quarter| (order.len() * quarter).div_ceil(4)).collect();
        counts.dedup();
        let mut curve = vec![];
        for kept in counts {
            let keeps = first(order, kept);
            let random: Vec<Vec<bool>> = self.random.iter().map(|order| first(order, kept)).collect();
            let of_vertices = |keeps: &Vec<bool>| self.vertices.of(keeps) / scale;
            let vertex_rel = of_vertices(&keeps);
            let (error_rel, of_random): (f64, Vec<f64>) = match &mut self.shots {
                Some(shots) if metric.is_of_pictures() => {
                    let drawn = random.iter().take(DRAWN).enumerate();
                    let losses = drawn.map(|(number, keeps)| shots.loss(metric, keeps, Some(number)));
                    let losses = losses.collect::<Result<_, _>>()?;
                    (shots.loss(metric, &keeps, None)?, losses)
                }
                _ => (vertex_rel, random.iter().map(of_vertices).collect()),
            };
            let error_random_rel = of_random.iter().sum::<f64>() / of_random.len() as f64;
            curve.push(Point { kept, error_rel, error_random_rel, vertex_rel });
        }
        Ok(curve)
    }
}

/// Whether each target is among the first `kept` of an order.
fn first(order: &[usize], kept: usize) -> Vec<bool> {
    let mut keeps = vec![false; order.len()];
    order[..kept].iter().for_each(|t| keeps[*t] = true);
    keeps
}
