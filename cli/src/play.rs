//! `play`: runs a whole clip, one update per frame, and reports bytes, times and errors.

use crate::args::{PlayArgs, distinct_or};
use crate::bench::stats::Stats;
use crate::input;
use crate::output::{Failure, Output};
use crate::runner::Stage;
use crate::table::{Table, bytes, percent, sig3, thousands};
use crate::verify::{Checked, Checks, Errors};
use deltamorph::{BoundClip, PoseFormat, UpdatePath, WeightClip};
use deltamorph_head::Rng;
use deltamorph_headless::DeviceChoice;
use serde::Serialize;

/// The JSON of `play`. Fields may be added, never renamed.
#[derive(Debug, Serialize)]
struct Played {
    schema: u32,
    /// The Vulkan device's name, or "none".
    device: String,
    /// The source of the mesh: a folder, or "built-in head".
    input: String,
    clip: String,
    frames: Vec<FrameRow>,
    summary: Summary,
}

/// Measurements of a frame.
#[derive(Debug, Serialize)]
struct FrameRow {
    frame: usize,
    /// Targets whose weight differs from the frame before; in the first frame, from 0.
    changed: usize,
    /// Targets with a weight other than 0.
    active: usize,
    /// Blocks written (block formats); this and the next three are `None` if the device plans.
    dirty_blocks: Option<usize>,
    /// Those of them that were rebuilt from the base pose.
    rebuilt_blocks: Option<usize>,
    passes: Option<usize>,
    /// Bytes loaded and stored.
    bytes_moved: Option<u64>,
    /// Time on the device; `None` without one.
    gpu_ms: Option<f64>,
    /// Round trip from weights to result, in microseconds.
    cpu_us: f64,
    /// Largest position error against the source at the weights asked for, in input units; `None` if it was not
    /// measured.
    max_error: Option<f64>,
}

#[derive(Debug, Serialize)]
struct Summary {
    frames: usize,
    /// Animated and planned on the device.
    animated: bool,
    /// Whether weights belong to absolute poses: one that changes may change the factors of all active targets.
    normalise: bool,
    /// Amplitude of the noise added to the weights.
    noise: f32,
    /// Targets changed, per frame.
    changed_mean: f64,
    /// Bytes loaded and stored, per frame.
    bytes_moved_mean: Option<f64>,
    /// Bytes that incremental updates of whole float32 poses would move, per frame with a change: each vertex's pose in
    /// and out, and its delta for each changed target.
    dense_bytes_mean: f64,
    /// `bytes_moved_mean` as a share of `dense_bytes_mean`; `None` if nothing changed.
    bytes_share: Option<f64>,
    gpu_ms_median: Option<f64>,
    gpu_ms_mean: Option<f64>,
    /// Median of the round trips, in microseconds.
    cpu_us_median: Option<f64>,
    #[serde(flatten)]
    checked: Checked,
    #[serde(flatten)]
    errors: Errors,
    /// Largest angle between normals and those of the packed deltas, in degrees.
    normal_error_deg: f64,
}

pub fn run(args: &PlayArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    let PlayArgs { mut run, weights, .. } = args.clone();
    run.update.check_single("play").map_err(Failure::Usage)?;
    if args.animated {
        run.update.paths = distinct_or(&run.update.paths, &[UpdatePath::Blocks]);
        let named = run.update.named_poses().map_err(Failure::Usage)?;
        run.update.poses = distinct_or(&named, &[PoseFormat::Fixed32]);
    }
    out.check(&input::files_of(&run.input, weights.as_slice()), &[], None)?;
    let input = input::load(&run.input, true, out)?;
    let clip = input::one_clip(weights.as_deref(), &run.input, &input, &[])?;
    input.largest.set(input.largest.get() + args.noise.unwrap_or(0.0));
    let stage = Stage::new(&run, &input, device, out)?;
    let source = input.raw.clone();
    let origin = input.origin.clone();
    // Frees all but the packed mesh and the source.
    drop(input);
    let mut checks = Checks::new(&stage, Some(source));
    let frames = play(args, &mut checks, &clip, out)?;
    let summary = summary(args, &frames, &checks);
    out.say(text(&clip.name, &frames, &summary, &checks));
    out.json(&Played { schema: 1, device: stage.device(), input: origin, clip: clip.name, frames, summary })?;
    // After all output is written.
    checks.verdict(out)
}

/// The frames of a clip, with noise added to every weight if requested.
fn shaken(frames: impl Iterator<Item = Vec<f32>>, amount: Option<f32>, seed: u64) -> impl Iterator<Item = Vec<f32>> {
    let mut rng = Rng::new(seed, 0x006e_6f69_7365);
    frames.map(move |mut weights| {
        if let Some(amount) = amount {
            weights.iter_mut().for_each(|weight| *weight += rng.range(-amount, amount));
        }
        weights
    })
}

fn play(args: &PlayArgs, checks: &mut Checks<'_>, clip: &BoundClip, out: &Output) -> Result<Vec<FrameRow>, Failure> {
    let stage = checks.stage;
    let frames = || shaken(clip.frames(), args.noise, args.run.input.seed);
    let mut runner = if args.animated {
        let names = stage.mesh.layout().targets.iter().map(|t| t.name.clone()).collect();
        let values = frames().flatten().collect();
        stage.animated(&WeightClip { name: clip.name.clone(), names, fps: clip.fps, values, notes: vec![] })?
    } else {
        stage.runner(stage.desc)?
    };
    let count = clip.frame_count();
    let bar = out.bar(count as u64);
    let mut rows = Vec::with_capacity(count);
    let mut before = vec![0.0; stage.mesh.layout().targets.len()];
    for (frame, weights) in frames().enumerate() {
        let due = frame % args.every == 0 || frame + 1 == count;
        let refused = |e| Failure::Failed(format!("clip '{}', {e}", clip.name));
        let (step, max_error) = checks.step(frame, &mut runner, &weights, due).map_err(refused)?;
        let planned = (!args.animated).then_some(step.stats);
        rows.push(FrameRow {
            frame,
            changed: weights.iter().zip(&before).filter(|(a, b)| a != b).count(),
            active: weights.iter().filter(|w| **w != 0.0).count(),
            dirty_blocks: planned.map(|stats| stats.dirty_blocks),
            rebuilt_blocks: planned.map(|stats| stats.rebuilt_blocks),
            passes: planned.map(|stats| stats.passes),
            bytes_moved: planned.map(|stats| stats.bytes_moved),
            gpu_ms: step.gpu_ms,
            cpu_us: step.cpu_ms * 1e3,
            max_error,
        });
        before = weights;
        bar.inc(1);
    }
    Ok(rows)
}

fn summary(args: &PlayArgs, frames: &[FrameRow], checks: &Checks<'_>) -> Summary {
    let mean = |value: fn(&FrameRow) -> usize| {
        frames.iter().map(|f| value(f) as f64).sum::<f64>() / frames.len().max(1) as f64
    };
    let pose_bytes = checks.stage.mesh.layout().vertex_count * PoseFormat::Float32.stride();
    let dense = mean(|f| if f.changed > 0 { f.changed + 2 } else { 0 }) * pose_bytes as f64;
    let moved = (!args.animated).then(|| mean(|f| f.bytes_moved.unwrap_or(0) as usize));
    let gpu = Stats::of(&frames.iter().filter_map(|f| f.gpu_ms).collect::<Vec<_>>());
    let cpu = Stats::of(&frames.iter().map(|f| f.cpu_us).collect::<Vec<_>>());
    Summary {
        frames: frames.len(),
        animated: args.animated,
        normalise: args.run.input.normalise,
        noise: args.noise.unwrap_or(0.0),
        changed_mean: mean(|f| f.changed),
        bytes_moved_mean: moved,
        dense_bytes_mean: dense,
        bytes_share: moved.filter(|_| dense > 0.0).map(|moved| moved / dense),
        gpu_ms_median: gpu.map(|s| s.median),
        gpu_ms_mean: gpu.map(|s| s.mean),
        cpu_us_median: cpu.map(|s| s.median),
        checked: checks.record(),
        errors: checks.errors,
        normal_error_deg: checks.found.error.normal_degrees,
    }
}

/// The result in words: means and maxima over frames, and the errors.
fn text(clip: &str, frames: &[FrameRow], s: &Summary, checks: &Checks<'_>) -> String {
    let mut table = Table::new(&["per frame", "mean", "least", "median", "most"], 1);
    let mut row = |name: &str, value: &dyn Fn(&FrameRow) -> Option<f64>, show: &dyn Fn(f64) -> String| {
        if let Some(s) = Stats::of(&frames.iter().filter_map(value).collect::<Vec<_>>()) {
            table.row([name.to_owned(), show(s.mean), show(s.min), show(s.median), show(s.max)]);
        }
    };
    row("targets changed", &|f| Some(f.changed as f64), &sig3);
    row("targets active", &|f| Some(f.active as f64), &sig3);
    if checks.stage.mesh.layout().format.is_blocks() {
        row("blocks written", &|f| f.dirty_blocks.map(|n| n as f64), &sig3);
        row("of these from base", &|f| f.rebuilt_blocks.map(|n| n as f64), &sig3);
    }
    row("passes", &|f| f.passes.map(|n| n as f64), &sig3);
    row("moved", &|f| f.bytes_moved.map(|n| n as f64), &bytes);
    row("device ms", &|f| f.gpu_ms, &sig3);
    row("round trip µs", &|f| Some(f.cpu_us), &sig3);
    let share = s.bytes_share.map_or(String::new(), |share| {
        format!(": {} of what whole poses in float32 would take ({})", percent(share), bytes(s.dense_bytes_mean))
    });
    let moved = match s.bytes_moved_mean {
        Some(moved) => format!("moved {} per frame{share}", bytes(moved)),
        None => "planned on the device".into(),
    };
    let (frames, setup, found) = (thousands(s.frames), checks.stage.describe(), checks.text());
    let normals = sig3(s.normal_error_deg);
    format!("{clip}, {frames} frames, {setup}\n\n{table}\n\n{moved}\n{found}; normals {normals}°")
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
