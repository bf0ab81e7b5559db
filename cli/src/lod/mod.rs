//! `lod`: ranks targets by importance, and measures the error if fewer are kept.

mod gauge;
mod geometry;
mod picture;
mod report;
mod shots;
mod yee;

use crate::args::lod::{LodArgs, Metric};
use crate::args::values::name;
use crate::input;
use crate::output::{Output, Result, refuse};
use crate::runner::open_to_draw;
use deltamorph::BoundClip;
use deltamorph::internals::weights::names::closest;
use deltamorph::lod::{is_pinned, ranked};
use deltamorph_headless::DeviceChoice;
use gauge::Gauge;
use serde::Serialize;
use serde_json::json;
use shots::Shots;
use std::slice::from_ref;

/// The JSON of `lod`; with `--metric all`, its part for each metric. Fields may be added, never renamed.
#[derive(Serialize)]
struct Lod {
    schema: u32,
    metric: String,
    /// The targets, the most important first.
    ranking: Vec<Ranked>,
    /// Ascending in the number of targets kept.
    curve: Vec<Point>,
}

/// A target in an order of importance.
#[derive(Serialize)]
struct Ranked {
    name: String,
    /// In the unit of the metric; higher is more important.
    score: f64,
    /// Ranked first, regardless of its score.
    pinned: bool,
}

/// Errors with the first `kept` targets.
#[derive(Serialize)]
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

pub fn run(args: &LodArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<()> {
    out.check(&input::files_of(&args.input, args.weights.as_slice()), &[], None)?;
    let input = input::load(&args.input, false, out)?;
    let names = input.targets();
    if let Some(pin) = args.pin.iter().find(|pin| !names.iter().any(|name| is_pinned(name, from_ref(pin)))) {
        let near = closest(pin, &names).map_or_else(String::new, |near| format!("; did you mean '{near}'?"));
        let text =
            format!("--pin {pin}: no target of '{}' begins with it{near}; `deltamorph info` lists them", input.name);
        return refuse(text);
    }
    let clips = input.clips(args.weights.as_deref(), &[])?;
    let metrics = args.metric.each();
    let gpu = metrics.iter().any(|m| m.is_of_pictures()).then(|| open_to_draw(device, out)).transpose()?;
    let spinner = out.spinner("ranking");
    let shots = gpu.as_ref().map(|gpu| Shots::new(gpu, &input, &clips));
    let pinned: Vec<bool> = names.iter().map(|name| is_pinned(name, &args.pin)).collect();
    let mut gauge = Gauge::new(&input, &clips, shots.transpose()?, args.random, args.input.seed, &pinned);
    let of_metric = |metric: &Metric| -> Result<Lod> {
        let scores = gauge.scores(*metric)?;
        let order = ranked(&scores, &pinned);
        let place = |&t: &usize| Ranked { name: names[t].into(), score: scores[t], pinned: pinned[t] };
        let (ranking, curve) = (order.iter().map(place).collect(), gauge.curve(*metric, &order)?);
        Ok(Lod { schema: 1, metric: name(*metric), ranking, curve })
    };
    let lods: Vec<Lod> = metrics.iter().map(of_metric).collect::<Result<_, _>>()?;
    drop(spinner);
    let measured = match clips.iter().map(BoundClip::frame_count).sum::<usize>() {
        0 => "each target alone, since there is no clip".to_owned(),
        frames => format!("{frames} frames"),
    };
    let texts: Vec<String> = lods.iter().map(|lod| report::text(lod, &measured)).collect();
    out.say(texts.join("\n\n"));
    match &lods[..] {
        [lod] => out.json(lod),
        _ => out.json(&json!({ "schema": 1, "metric": "all", "rankings": lods })),
    }
}

#[cfg(test)]
mod tests;
