//! `play`: a whole clip, one update per frame: what each moved, what it took, and how far the pose is off.

mod record;

use crate::args::play::PlayArgs;
use crate::bench::stats::Stats;
use crate::clips;
use crate::input::{self, Input};
use crate::output::{Failure, Output};
use crate::stage::Stage;
use crate::table::{Table, bytes, percent, sig3, thousands};
use crate::verify::{Found, Promise};
use deltamorph::headless::DeviceChoice;
use deltamorph::internals::Rng;
use deltamorph::reference::{compare, evaluate, evaluate_unpacked};
use deltamorph::{Accumulate, BoundClip, MorphMesh, PackedMesh, PoseFormat, UpdatePath, WeightClip};
use record::{FrameRow, Planned, Played, Summary};
use std::sync::Arc;

pub fn run(args: &PlayArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    out.check(&input::files_of(&args.input, args.weights.as_slice()), &[], None)?;
    let input = input::load(&args.input, true, out)?;
    let clip = clips::the_one(args.weights.as_deref(), &args.input, &input)?;
    let mut update = args.update.clone();
    if args.animated {
        update.paths = if update.paths.is_empty() { vec![UpdatePath::Blocks] } else { update.paths };
        update.accumulate = if update.accumulate.is_empty() { vec![Accumulate::Exact] } else { update.accumulate };
    }
    let stage = Stage::best("play", &update, args.batch_size, &input, device, out)?;
    // From here on the packed mesh is enough, and the raw files' where errors against them can be told.
    let Input { raw, packed, origin, .. } = input;
    let checks = Checks::new(&stage, packed.is_none().then_some(raw));
    let (frames, checks) = play(args, &stage, checks, &clip, out)?;
    let summary = summary(args, &stage, &frames, &checks);
    out.say(text(&clip.name, &stage, &frames, &summary));
    let wrong = checks.wrong;
    out.json(&Played { schema: 1, device: stage.device(), input: origin, clip: clip.name, frames, summary })?;
    // Everything is written first.
    match wrong {
        None => Ok(()),
        Some((frame, complaint)) => Err(Failure::Failed(format!(
            "frame {frame} is wrong through '{}': {complaint}; try another --path, and report this with what \
             `deltamorph devices` prints",
            stage.desc.path.name()
        ))),
    }
}

/// The frames of a clip, with noise added to every weight where there is any.
fn shaken(frames: impl Iterator<Item = Vec<f32>>, amount: Option<f32>, seed: u64) -> impl Iterator<Item = Vec<f32>> {
    let mut rng = Rng::new(seed, 0x006e_6f69_7365);
    frames.map(move |mut weights| {
        if let Some(amount) = amount {
            weights.iter_mut().for_each(|weight| *weight += rng.range(-amount, amount));
        }
        weights
    })
}

struct Checks<'a> {
    mesh: &'a PackedMesh,
    promise: Promise,
    /// `None` where INPUT is a packed file.
    raw: Option<Arc<MorphMesh>>,
    count: usize,
    found: Found,
    /// Position error against the weights as asked for.
    request: f64,
    /// The first frame that breaks the promise, and how.
    wrong: Option<(usize, String)>,
}

fn play<'a>(
    args: &PlayArgs,
    stage: &Stage,
    mut checks: Checks<'a>,
    clip: &BoundClip,
    out: &Output,
) -> Result<(Vec<FrameRow>, Checks<'a>), Failure> {
    let frames = || shaken(clip.frames(), args.noise, args.input.seed);
    let mut runner = if args.animated {
        let names = stage.mesh.layout().targets.iter().map(|t| t.name.clone()).collect();
        let values = frames().flatten().collect();
        stage.animated(&WeightClip { name: clip.name.clone(), names, fps: clip.fps, values })?
    } else {
        stage.runner()?
    };
    let count = clip.frame_count();
    let bar = out.bar(count as u64);
    let mut rows = Vec::with_capacity(count);
    let mut before = vec![0.0; stage.mesh.layout().targets.len()];
    for (frame, weights) in frames().enumerate() {
        let refused = |e| Failure::Failed(format!("clip '{}', frame {frame}: {}", clip.name, Failure::from(e)));
        let step = runner.step(std::slice::from_ref(&weights)).map_err(refused)?;
        let bound = f64::from(step.stats.bound);
        checks.found.bound = checks.found.bound.max(bound);
        let measured = frame % args.every == 0 || frame + 1 == count;
        let found = match measured {
            true => {
                let played = runner.played(&stage.mesh)?;
                Some(checks.measure(frame, &runner.pose(0)?, &weights, played, bound))
            }
            false => None,
        };
        rows.push(FrameRow {
            frame,
            changed: weights.iter().zip(&before).filter(|(a, b)| a != b).count(),
            active: weights.iter().filter(|w| **w != 0.0).count(),
            planned: if args.animated { Planned::default() } else { Planned::of(&step.stats) },
            gpu_ms: step.gpu_ms,
            cpu_us: step.cpu_ms * 1e3,
            max_error: found.map(|f| f.error.position),
        });
        before = weights;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok((rows, checks))
}

impl<'a> Checks<'a> {
    fn new(stage: &'a Stage, raw: Option<Arc<MorphMesh>>) -> Self {
        let promise = Promise::new(&stage.desc, stage.mesh.layout());
        Self { mesh: &stage.mesh, promise, raw, count: 0, found: Found::default(), request: 0.0, wrong: None }
    }

    /// `played`: what a device made of `weights`, where it animates.
    fn measure(&mut self, frame: usize, pose: &[f32], weights: &[f32], played: Option<Vec<f32>>, bound: f64) -> Found {
        let applied = played.unwrap_or_else(|| self.promise.applied(weights));
        let error = compare(pose, &evaluate(self.mesh, &applied));
        let raw = self.raw.as_ref().map(|raw| compare(pose, &evaluate_unpacked(raw, weights))).unwrap_or_default();
        let request = if applied == weights { error } else { compare(pose, &evaluate(self.mesh, weights)) };
        let found = Found { error, raw, bound };
        if !self.promise.kept(&found) && self.wrong.is_none() {
            self.wrong = Some((frame, self.promise.complaint(&found)));
        }
        self.count += 1;
        self.found = self.found.max(found);
        self.request = self.request.max(request.position);
        found
    }
}

fn summary(args: &PlayArgs, stage: &Stage, frames: &[FrameRow], checks: &Checks<'_>) -> Summary {
    let mean = |value: &dyn Fn(&FrameRow) -> f64| frames.iter().map(value).sum::<f64>() / frames.len().max(1) as f64;
    let vertices = stage.mesh.layout().vertex_count;
    let dense = |f: &FrameRow| {
        if f.changed > 0 { (vertices * PoseFormat::Float32.stride() * (f.changed + 2)) as f64 } else { 0.0 }
    };
    let moved = (!args.animated).then(|| mean(&|f| f.planned.bytes_moved.unwrap_or(0) as f64));
    let dense = mean(&dense);
    let gpu = Stats::of(&frames.iter().filter_map(|f| f.gpu_ms).collect::<Vec<_>>());
    let cpu = Stats::of(&frames.iter().map(|f| f.cpu_us).collect::<Vec<_>>());
    let (found, scale) = (&checks.found, checks.promise.scale());
    Summary {
        frames: frames.len(),
        setup: stage.setup(),
        animated: args.animated,
        noise: args.noise.unwrap_or(0.0),
        changed_mean: mean(&|f| f.changed as f64),
        bytes_moved_mean: moved,
        dense_bytes_mean: dense,
        bytes_share: moved.filter(|_| dense > 0.0).map(|moved| moved / dense),
        gpu_ms_median: gpu.map(|s| s.median),
        gpu_ms_mean: gpu.map(|s| s.mean),
        cpu_us_median: cpu.map(|s| s.median),
        checks: checks.count,
        max_error: found.error.position,
        max_error_rel: found.error.position / scale,
        normal_error_deg: found.error.normal_degrees,
        request_error_rel: checks.request / scale,
        raw_error_rel: checks.raw.as_ref().map(|_| found.raw.position / scale),
        bound: found.bound,
    }
}

/// The same for people: what frames took on average and at most, and the errors.
fn text(clip: &str, stage: &Stage, frames: &[FrameRow], s: &Summary) -> String {
    let mut table = Table::new(&["per frame", "mean", "least", "median", "most"], 1);
    let mut row = |name: &str, value: &dyn Fn(&FrameRow) -> Option<f64>, show: &dyn Fn(f64) -> String| {
        if let Some(s) = Stats::of(&frames.iter().filter_map(value).collect::<Vec<_>>()) {
            table.row([name.to_owned(), show(s.mean), show(s.min), show(s.median), show(s.max)]);
        }
    };
    row("targets changed", &|f| Some(f.changed as f64), &sig3);
    row("targets active", &|f| Some(f.active as f64), &sig3);
    if stage.mesh.layout().format.is_blocks() {
        row("blocks written", &|f| f.planned.dirty_blocks.map(|n| n as f64), &sig3);
        row("of these from base", &|f| f.planned.rebuilt_blocks.map(|n| n as f64), &sig3);
    }
    row("passes", &|f| f.planned.passes.map(|n| n as f64), &sig3);
    row("moved", &|f| f.planned.bytes_moved.map(|n| n as f64), &bytes);
    row("device ms", &|f| f.gpu_ms, &sig3);
    row("round trip µs", &|f| Some(f.cpu_us), &sig3);
    let share = s.bytes_share.map_or(String::new(), |share| {
        format!(": {} of what whole poses in float32 would take ({})", percent(share), bytes(s.dense_bytes_mean))
    });
    let scale = Promise::new(&stage.desc, stage.mesh.layout()).scale();
    let bound =
        if s.bound > 0.0 { format!(", at most {} by the bound kept", sig3(s.bound / scale)) } else { String::new() };
    let raw = s.raw_error_rel.map_or(String::new(), |raw| format!("; {} against the raw files", sig3(raw)));
    let moved = s
        .bytes_moved_mean
        .map_or("planned on the device\n".into(), |moved| format!("moved {} per frame{share}\n", bytes(moved)));
    format!(
        "{clip}, {} frames, {}\n\n{table}\n\n\
         {moved}largest error in {} frames, of the diagonal: {} against the float64 reference{bound}; {} against \
         the weights asked for{raw}; normals {}°",
        thousands(s.frames),
        stage.describe(),
        thousands(s.checks),
        sig3(s.max_error_rel),
        sig3(s.request_error_rel),
        sig3(s.normal_error_deg),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_small_and_comes_again() {
        let frames = vec![vec![0.5f32; 7]; 20];
        let shaken = |seed| shaken(frames.clone().into_iter(), Some(0.01), seed).collect::<Vec<_>>();
        assert!(shaken(1).iter().flatten().all(|w| (w - 0.5).abs() <= 0.0101 && *w != 0.5));
        assert_eq!(shaken(1), shaken(1));
        assert_ne!(shaken(1), shaken(2));
    }
}
