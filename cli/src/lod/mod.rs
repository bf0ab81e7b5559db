//! `lod`: ranks targets by importance, and measures the error if fewer are kept.

mod gauge;
mod geometry;
mod order;
mod picture;
mod report;
mod shots;
mod yee;

use crate::args::lod::{LodArgs, Metric};
use crate::args::values::name;
use crate::input;
use crate::output::{Failure, Output};
use crate::runner::{Gpu, open};
use deltamorph::BoundClip;
use deltamorph::internals::weights::names::closest;
use deltamorph::lod::is_pinned;
use deltamorph_headless::DeviceChoice;
use gauge::Gauge;
use order::{Agreement, Order, kendall, spearman};
use report::{text, text_of_all};
use serde::Serialize;
use shots::Shots;

/// The JSON of `lod`; with `--metric all`, its part for each metric. Fields may be added, never renamed.
#[derive(Serialize)]
struct Lod {
    #[serde(flatten)]
    order: Order,
    /// Ascending in the number of targets kept.
    curve: Vec<Point>,
}

/// The JSON of `lod --metric all`.
#[derive(Serialize)]
struct All<'a> {
    schema: u32,
    metric: &'static str,
    rankings: &'a [Lod],
    /// One for each pair of metrics.
    agreement: &'a [Agreement],
}

/// Errors with the first `kept` targets.
#[derive(Clone, Debug, Serialize)]
struct Point {
    kept: usize,
    /// For metrics of vertices, the root mean square error over vertices and frames, as a fraction of the diagonal; for
    /// metrics of pictures, their mean difference.
    error_rel: f64,
    /// Mean of `error_rel` over random orders, with the pins first; for metrics of pictures, over the first 32, each in
    /// one frame.
    error_random_rel: f64,
    /// The error of vertices, for any metric.
    vertex_rel: f64,
}

pub fn run(args: &LodArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    out.check(&input::files_of(&args.input, args.weights.as_slice()), &[], None)?;
    let input = input::load(&args.input, false, out)?;
    let names = input.targets();
    if let Some(pin) = args.pin.iter().find(|pin| !names.iter().any(|name| is_pinned(name, std::slice::from_ref(pin))))
    {
        let near = closest(pin, &names).map_or_else(String::new, |near| format!("; did you mean '{near}'?"));
        let text =
            format!("--pin {pin}: no target of '{}' begins with it{near}; `deltamorph info` lists them", input.name);
        return Err(Failure::Usage(text));
    }
    let clips = input::clips(args.weights.as_deref(), &args.input, &input, &[])?;
    let metrics = args.metric.each();
    let compares = metrics.iter().any(|m| m.is_of_pictures());
    let opened = if compares { Some(device_for_pictures(device, out)?) } else { None };
    let spinner = out.spinner("ranking");
    let path = args.input.input.as_deref();
    let shots = opened.as_ref().map(|gpu| Shots::new(gpu, &input, path, &clips));
    let mut gauge = Gauge::new(&input, &clips, shots.transpose()?, args.random, args.input.seed, &args.pin);
    let scores = gauge.scores(&metrics)?;
    let order = |(metric, scores): (&Metric, &Vec<f64>)| Order::new(&name(*metric), &names, scores, &args.pin);
    let orders: Vec<Order> = metrics.iter().zip(&scores).map(order).collect();
    let curves = gauge.curves(&metrics, &orders)?;
    let measured = match clips.iter().map(BoundClip::frame_count).sum::<usize>() {
        0 => "each target alone, since there is no clip".to_owned(),
        frames => format!("{frames} frames"),
    };
    drop(spinner);
    let lods: Vec<Lod> = orders.into_iter().zip(curves).map(|(order, curve)| Lod { order, curve }).collect();
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
        let what = "pictures are drawn on a Vulkan device, and there is none";
        Failure::Failed(format!("{what}; use --metric mse or hausdorff"))
    })
}

fn agreements(metrics: &[Metric], scores: &[Vec<f64>]) -> Vec<Agreement> {
    let pairs = (0..metrics.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    pairs
        .map(|(a, b)| Agreement {
            metrics: [a, b].map(|m| name(metrics[m])),
            kendall: kendall(&scores[a], &scores[b]),
            spearman: spearman(&scores[a], &scores[b]),
        })
        .collect()
}

#[cfg(test)]
mod tests;
