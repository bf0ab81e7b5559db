//! `lod`: targets in their order of importance, and what is lost where fewer are kept.

mod geometry;
mod order;
mod picture;
mod shots;
mod twins;
mod yee;

use crate::args::lod::{LodArgs, Metric};
use crate::input::{self, Input};
use crate::output::{Failure, Output, to_json, write_file};
use crate::runner::{Gpu, open};
use crate::table::{Column, Table, sig3};
use deltamorph::BoundClip;
use deltamorph::headless::DeviceChoice;
use deltamorph::internals::Rng;
use deltamorph::lod::{is_pinned, mean_square};
use geometry::{Loss, Tree, hausdorff, lips};
use order::{Agreement, Order, Ranked, kendall, spearman};
use rayon::prelude::*;
use serde::Serialize;
use shots::Shots;
use twins::{Twins, pairs, twins};

/// The JSON of `lod`, or, with `--metric all`, what it has of each metric. Fields may be added, never renamed.
#[derive(Serialize)]
struct Lod {
    #[serde(flatten)]
    order: Order,
    /// Ascending in what is kept.
    curve: Vec<Point>,
    /// Targets that mirror each other.
    twins: Twins,
}

/// The JSON of `lod --metric all`.
#[derive(Serialize)]
struct All<'a> {
    schema: u32,
    metric: &'static str,
    rankings: &'a [Lod],
    /// Of each pair of metrics.
    agreement: &'a [Agreement],
}

/// What is lost where so many targets are kept.
#[derive(Clone, Debug, Serialize)]
struct Point {
    kept: usize,
    /// By metrics of vertices, the root of the mean squared error over vertices and frames, as a fraction of the diagonal; by
    /// metrics of pictures, the mean of their differences.
    error_rel: f64,
    /// The mean of the same over random orders, which have the pins in front too.
    error_random_rel: f64,
    /// The error of vertices, whatever the metric.
    vertex_rel: f64,
    /// The same on the lips alone; absent where no target tells them.
    #[serde(skip_serializing_if = "Option::is_none")]
    lips_rel: Option<f64>,
}

/// What errors are measured with.
struct Gauge<'a> {
    input: &'a Input,
    vertices: Loss,
    lips: Option<Loss>,
    shots: Option<Shots<'a>>,
    /// Targets, the most important first, in orders that are random but for the pins.
    random: Vec<Vec<usize>>,
}

pub fn run(args: &LodArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    let others: Vec<_> = args.weights.iter().chain(&args.from).cloned().collect();
    let files: Vec<_> = args.out.iter().map(|path| path.as_path()).collect();
    out.check(&input::files_of(&args.input, &others), &files, None)?;
    if args.out.is_some() && args.metric.metrics().len() > 1 {
        return Err(Failure::Usage("--out keeps one order; name one --metric".into()));
    }
    let input = input::load(&args.input, false, out)?;
    let names: Vec<&str> = input.kept.targets.iter().map(|t| t.name.as_str()).collect();
    if let Some(pin) = args.pin.iter().find(|pin| !names.iter().any(|name| is_pinned(name, std::slice::from_ref(pin))))
    {
        let text = format!("--pin {pin}: no target of '{}' begins so; `deltamorph info` lists them", input.name);
        return Err(Failure::Usage(text));
    }
    let clips = input::clips(args.weights.as_deref(), &args.input, &input, &[])?;
    let from = args.from.as_ref().map(|path| Order::read(path, &names).map(|order| (path, order))).transpose()?;
    let metrics = match &from {
        None => args.metric.metrics(),
        Some((path, order)) => vec![Metric::ALL.into_iter().find(|m| m.name() == order.metric).ok_or_else(|| {
            Failure::Failed(format!("{}: is by '{}', which is no metric here", path.display(), order.metric))
        })?],
    };
    let pins = match &from {
        Some((_, order)) => order.ranking.iter().filter(|r| r.pinned).map(|r| r.name.clone()).collect(),
        None => args.pin.clone(),
    };
    let opened =
        if metrics.iter().any(|m| m.is_of_pictures()) { Some(device_for_pictures(device, out)?) } else { None };
    let spinner = out.spinner("ranking");
    let shots = opened.as_ref().map(|gpu| Shots::new(gpu, &input, args.input.input.as_deref(), &clips));
    let mut gauge = Gauge::new(&input, &clips, shots.transpose()?, args.random, args.input.seed, &pins);
    let scores = gauge.scores(&metrics)?;
    let orders: Vec<Order> = match from {
        Some((_, order)) => vec![order],
        None => metrics.iter().zip(&scores).map(|(m, scores)| Order::new(m.name(), &names, scores, &pins)).collect(),
    };
    let curves = gauge.curves(&metrics, &orders)?;
    let pairs = pairs(&input.kept);
    spinner.finish_and_clear();
    if let (Some(path), Some(order)) = (&args.out, orders.first()) {
        write_file(path, to_json(order)?)?;
    }
    let lods: Vec<Lod> = orders
        .into_iter()
        .zip(curves)
        .map(|(order, curve)| Lod { twins: twins(&input.kept, &pairs, &order), order, curve })
        .collect();
    let measured = match clips.iter().map(BoundClip::frame_count).sum::<usize>() {
        0 => "each target by itself, since there is no clip".to_owned(),
        frames => format!("{frames} frames"),
    };
    if let [lod] = &lods[..] {
        out.say(text(lod, &measured));
        return out.json(lod);
    }
    let agreement = agreements(&metrics, &scores);
    out.say(text_of_all(&lods, &agreement, &measured));
    out.json(&All { schema: 1, metric: "all", rankings: &lods, agreement: &agreement })
}

fn device_for_pictures(device: Option<&DeviceChoice>, out: &Output) -> Result<Gpu, Failure> {
    open(device, out)?.ok_or_else(|| {
        let what = "this metric compares pictures, which are drawn on a Vulkan device, and there is none";
        Failure::Failed(format!("{what}; take --metric mse or hausdorff"))
    })
}

impl<'a> Gauge<'a> {
    fn new(
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
        Self {
            input,
            vertices: Loss::new(mesh, clips, &vec![true; mesh.vertex_count()]),
            lips: lips(mesh).map(|inside| Loss::new(mesh, clips, &inside)),
            shots,
            random: (0..random).map(shuffled).collect(),
        }
    }

    /// A list for each metric, with a number for each target.
    fn scores(&mut self, metrics: &[Metric]) -> Result<Vec<Vec<f64>>, Failure> {
        let mesh = &self.input.kept;
        let base = Tree::new(&mesh.positions);
        let of_pictures: Vec<Metric> = metrics.iter().copied().filter(|m| m.is_of_pictures()).collect();
        let mut drawn = match &mut self.shots {
            Some(shots) => shots.scores(&of_pictures, mesh.targets.len())?,
            None => vec![],
        }
        .into_iter();
        let list = |metric: &Metric| match metric {
            Metric::Mse => mesh.targets.iter().map(|t| mean_square(mesh, t)).collect(),
            Metric::Hausdorff => mesh.targets.par_iter().map(|t| hausdorff(mesh, &base, t)).collect(),
            Metric::ImageMse | Metric::Ssim | Metric::Perceptual | Metric::Yee => drawn.next().unwrap_or_default(),
        };
        Ok(metrics.iter().map(list).collect())
    }

    /// A curve for each of `metrics`, whose orders are `orders`.
    fn curves(&mut self, metrics: &[Metric], orders: &[Order]) -> Result<Vec<Vec<Point>>, Failure> {
        let targets = &self.input.kept.targets;
        let names: Vec<&str> = targets.iter().map(|t| t.name.as_str()).collect();
        let scale = 1.0 / crate::verify::scale(self.input.kept.diagonal);
        let mut kept: Vec<usize> = (1..=4).map(|quarter| (targets.len() * quarter).div_ceil(4)).collect();
        kept.dedup();
        let of_pictures: Vec<Metric> = metrics.iter().copied().filter(|m| m.is_of_pictures()).collect();
        let mut curves = vec![vec![]; metrics.len()];
        for kept in kept {
            let first = |order: &Vec<usize>| {
                let mut keeps = vec![false; order.len()];
                order[..kept].iter().for_each(|t| keeps[*t] = true);
                keeps
            };
            let random: Vec<Vec<bool>> = self.random.iter().map(first).collect();
            let vertex_random =
                random.iter().map(|keeps| self.vertices.of(keeps)).sum::<f64>() * scale / random.len() as f64;
            let mut drawn_random = vec![0.0; of_pictures.len()];
            if let Some(shots) = &mut self.shots {
                for keeps in random.iter().filter(|keeps| keeps.contains(&false)) {
                    let losses = shots.loss(&of_pictures, keeps)?;
                    drawn_random.iter_mut().zip(losses).for_each(|(sum, loss)| *sum += loss / random.len() as f64);
                }
            }
            for ((metric, order), curve) in metrics.iter().zip(orders).zip(&mut curves) {
                let keeps = order.keeps(&names, kept);
                let vertex_rel = self.vertices.of(&keeps) * scale;
                let (error_rel, error_random_rel) =
                    match (&mut self.shots, of_pictures.iter().position(|m| m == metric)) {
                        (Some(shots), Some(i)) => (shots.loss(&[*metric], &keeps)?[0], drawn_random[i]),
                        _ => (vertex_rel, vertex_random),
                    };
                let lips_rel = self.lips.as_ref().map(|lips| lips.of(&keeps) * scale);
                curve.push(Point { kept, error_rel, error_random_rel, vertex_rel, lips_rel });
            }
        }
        Ok(curves)
    }
}

fn agreements(metrics: &[Metric], scores: &[Vec<f64>]) -> Vec<Agreement> {
    let pairs = (0..metrics.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    pairs
        .map(|(a, b)| Agreement {
            metrics: [metrics[a].name().into(), metrics[b].name().into()],
            kendall: kendall(&scores[a], &scores[b]),
            spearman: spearman(&scores[a], &scores[b]),
        })
        .collect()
}

fn lips_cell(point: &Point) -> String {
    point.lips_rel.map_or("–".into(), sig3)
}

fn ratio(point: &Point) -> String {
    sig3(point.error_rel / point.error_random_rel)
}

fn text(lod: &Lod, measured: &str) -> String {
    let ranking: &[Column<'_, Ranked>] = &[
        ("target", &|r| r.name.clone()),
        ("score", &|r| sig3(r.score)),
        ("pinned", &|r| if r.pinned { "yes".into() } else { String::new() }),
    ];
    let curve: &[Column<'_, Point>] = &[
        ("kept", &|p| p.kept.to_string()),
        ("error", &|p| sig3(p.error_rel)),
        ("random orders", &|p| sig3(p.error_random_rel)),
        ("ratio", &ratio),
        ("error of vertices", &|p| sig3(p.vertex_rel)),
        ("of the lips", &lips_cell),
    ];
    let (ranking, curve) = (Table::of(&lod.order.ranking, ranking), Table::of(&lod.curve, curve));
    format!("targets by {}, the most important first:\n{ranking}\n\nerrors over {measured}:\n{curve}", lod.order.metric)
}

fn text_of_all(lods: &[Lod], agreement: &[Agreement], measured: &str) -> String {
    let half: Vec<(&str, &Point)> =
        lods.iter().filter_map(|l| Some((l.order.metric.as_str(), l.curve.get(1)?))).collect();
    let halves: &[Column<'_, (&str, &Point)>] = &[
        ("metric", &|(name, _)| (*name).into()),
        ("kept", &|(_, p)| p.kept.to_string()),
        ("error", &|(_, p)| sig3(p.error_rel)),
        ("random orders", &|(_, p)| sig3(p.error_random_rel)),
        ("ratio", &|(_, p)| ratio(p)),
        ("error of vertices", &|(_, p)| sig3(p.vertex_rel)),
        ("of the lips", &|(_, p)| lips_cell(p)),
    ];
    let pairs: &[Column<'_, Agreement>] = &[
        ("metrics", &|a| a.metrics.join(", ")),
        ("Kendall", &|a| format!("{:.2}", a.kendall)),
        ("Spearman", &|a| format!("{:.2}", a.spearman)),
    ];
    let (halves, pairs) = (Table::of(&half, halves), Table::of(agreement, pairs));
    format!("half of the targets kept, errors over {measured}:\n{halves}\n\nagreement of orders:\n{pairs}")
}

#[cfg(test)]
mod tests;
