//! `play`: runs a whole clip, one update per frame, and reports bytes, times and errors.

use crate::args::{PlayArgs, distinct_or};
use crate::bench::stats::Stats;
use crate::input;
use crate::output::{Failure, Output, Result, With};
use crate::runner::Stage;
use crate::table::{Table, bytes, percent, sig3, thousands};
use crate::verify::Checks;
use deltamorph::{BoundClip, PoseFormat, UpdatePath, WeightClip};
use deltamorph_head::Rng;
use deltamorph_headless::DeviceChoice;
use serde::Serialize;
use serde_json::json;

/// Measurements of a frame, in JSON. Fields may be added, never renamed.
#[derive(Serialize)]
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

pub fn run(args: &PlayArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<()> {
    let mut run = args.run.clone();
    input::check("play", &run, &[], out)?;
    if args.animated {
        run.update.paths = distinct_or(&run.update.paths, &[UpdatePath::Blocks]);
        run.update.poses = distinct_or(&run.update.poses, &[PoseFormat::Fixed32]);
    }
    let input = input::load(&run.input, true, out)?;
    let clip = input.one_clip(run.weights.as_deref(), &[])?;
    input.largest.set(input.largest.get() + args.noise.unwrap_or(0.0));
    let stage = Stage::new(&run, &input, device, out)?;
    let source = input.raw.clone();
    let origin = input.origin.clone();
    // Frees all but the packed mesh and the source.
    drop(input);
    let mut checks = Checks::new(&stage, Some(source));
    let frames = play(args, &mut checks, &clip, out)?;
    let (text, summary) = summary(args, &clip.name, &frames, &checks);
    out.say(text);
    // `input` is the source of the mesh: a folder, or "built-in head". Fields may be added, never renamed.
    out.json(&json!({
        "schema": 1, "device": stage.device(), "input": origin, "clip": clip.name, "frames": frames, "summary": summary,
    }))?;
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

fn play(args: &PlayArgs, checks: &mut Checks<'_>, clip: &BoundClip, out: &Output) -> Result<Vec<FrameRow>> {
    let stage = checks.stage;
    let frames = || shaken(clip.frames(), args.noise, args.run.input.seed);
    let mut runner = if args.animated {
        let (name, fps, values) = (clip.name.clone(), clip.fps, frames().flatten().collect());
        stage.animated(WeightClip { name, fps, values, ..WeightClip::default() })?
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

/// The result in words: means and maxima over frames, and the errors; and the summary in JSON.
fn summary(args: &PlayArgs, clip: &str, frames: &[FrameRow], checks: &Checks<'_>) -> (String, impl Serialize) {
    let mut table = Table::new(&["per frame", "mean", "least", "median", "most"], 1);
    let stats =
        |value: &dyn Fn(&FrameRow) -> Option<f64>| Stats::of(&frames.iter().filter_map(value).collect::<Vec<_>>());
    let mut row = |name: &str, stats: Option<Stats>, show: fn(f64) -> String| {
        if let Some(s) = stats {
            table.row([name.to_owned(), show(s.mean), show(s.min), show(s.median), show(s.max)]);
        }
    };
    let count = |n: Option<usize>| n.map(|n| n as f64);
    let changed = stats(&|f| count(Some(f.changed)));
    row("targets changed", changed, sig3);
    row("targets active", stats(&|f| count(Some(f.active))), sig3);
    if checks.stage.mesh.layout().format.is_blocks() {
        row("blocks written", stats(&|f| count(f.dirty_blocks)), sig3);
        row("of these from base", stats(&|f| count(f.rebuilt_blocks)), sig3);
    }
    row("passes", stats(&|f| count(f.passes)), sig3);
    let moved = stats(&|f| f.bytes_moved.map(|n| n as f64));
    row("moved", moved, bytes);
    let [gpu, cpu] = [stats(&|f| f.gpu_ms), stats(&|f| Some(f.cpu_us))];
    row("device ms", gpu, sig3);
    row("round trip µs", cpu, sig3);

    // Bytes that incremental updates of whole float32 poses would move, per frame with a change: each vertex's pose in
    // and out, and its delta for each changed target.
    let pose_bytes = checks.stage.mesh.layout().vertex_count * PoseFormat::Float32.stride();
    let dense = stats(&|f| Some((if f.changed > 0 { (f.changed + 2) * pose_bytes } else { 0 }) as f64));
    let [dense, changed] = [dense, changed].map(|stats| stats.map_or(0.0, |s| s.mean));
    let moved = moved.map(|s| s.mean);
    let share = moved.filter(|_| dense > 0.0).map(|moved| moved / dense);
    let of_dense = share.map_or(String::new(), |share| {
        format!(": {} of the bytes of whole poses in float32 ({})", percent(share), bytes(dense))
    });
    let told = match moved {
        Some(moved) => format!("moved {} per frame{of_dense}", bytes(moved)),
        None => "planned on the device".into(),
    };
    // The largest angle between normals is that to those of the packed deltas.
    let normal_error = checks.found.error.normal_degrees;
    let (count, setup, found, normals) =
        (thousands(frames.len()), checks.stage.describe(), checks.text(), sig3(normal_error));
    let text = format!("{clip}, {count} frames, {setup}\n\n{table}\n\n{told}\n{found}; normals {normals}°");
    // `normalise`: one weight that changes may change the factors of all active targets.
    let more = json!({
        "frames": frames.len(), "animated": args.animated, "normalise": args.run.input.normalise,
        "noise": args.noise.unwrap_or(0.0), "changed_mean": changed, "bytes_moved_mean": moved,
        "dense_bytes_mean": dense, "bytes_share": share, "gpu_ms_median": gpu.map(|s| s.median),
        "gpu_ms_mean": gpu.map(|s| s.mean), "cpu_us_median": cpu.map(|s| s.median), "normal_error_deg": normal_error,
    });
    (text, With { fields: checks.record(), more })
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
