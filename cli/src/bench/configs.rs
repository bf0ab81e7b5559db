//! Supported combinations of paths, formats, modes, poses and batch sizes.

use super::record::Skipped;
use crate::args::bench::BenchArgs;
use crate::args::values::{BatchSpec, expand_batches};
use crate::runner::Gpu;
use deltamorph::{BatchSize, DeltaFormat, PoseFormat, UpdateDesc, UpdateMode, UpdatePath};

/// An update description and a delta format.
#[derive(Clone, Debug)]
pub struct Config {
    /// Path, batch size, mode, slots.
    pub desc: UpdateDesc,
    pub format: DeltaFormat,
    /// The largest batch that path and format allow.
    pub batch_max: Option<u32>,
    /// One crowd per instance, all in one submission.
    pub separate: bool,
    /// Each instance plays its weights as a clip, sampled and planned on the device.
    pub animated: bool,
}

/// The values to combine; each path takes the delta formats and pose formats that it supports.
#[derive(Clone, Copy, Default)]
pub struct Wanted<'a> {
    pub paths: &'a [UpdatePath],
    /// None: all.
    pub formats: &'a [DeltaFormat],
    pub poses: &'a [PoseFormat],
    /// None: that of each path.
    pub modes: &'a [UpdateMode],
    /// Targets per pass.
    pub sizes: &'a [BatchSpec],
    /// In input units; for block formats.
    pub error_budget: f32,
}

/// The configurations that can run, and those requested that cannot, with the reason. Defaults that cannot run are
/// skipped without a note.
pub fn configurations(wanted: &Wanted<'_>, args: &BenchArgs, gpu: Option<&Gpu>) -> (Vec<Config>, Vec<Skipped>) {
    let (mut configs, mut skipped): (Vec<Config>, Vec<Skipped>) = (vec![], vec![]);
    let (update, sizes_named) = (&args.update, !args.batch_sizes.is_empty());
    let formats = if wanted.formats.is_empty() { &DeltaFormat::ALL } else { wanted.formats };
    for &path in wanted.paths {
        let own = [path.default_mode()];
        let modes = if wanted.modes.is_empty() { &own } else { wanted.modes };
        let available = match (path, gpu) {
            (UpdatePath::Cpu, _) => Ok(()),
            (_, Some(gpu)) => gpu.caps().check_path(path).map_err(|e| e.to_string()),
            (_, None) => Err("there is no Vulkan device; the path 'cpu' needs none".into()),
        };
        if let Err(reason) = available {
            skipped.push(Skipped { what: path.name().into(), reason });
            continue;
        }
        let before = (configs.len(), skipped.len());
        for format in formats.iter().copied().filter(|format| path.formats().contains(format)) {
            let batch_max = gpu.and_then(|gpu| gpu.caps().batch_max(path, format));
            let max = batch_max.unwrap_or(0);
            // A draw evaluates all active targets: there are no batch sizes.
            let direct = path == UpdatePath::DirectAttributes && !sizes_named;
            let (batches, refused) = expand_batches(if direct { &[BatchSpec::Max] } else { wanted.sizes }, path, max);
            // Formats that only blocks support are not reported if all were requested.
            let held = |pose: &&PoseFormat| pose.takes(format);
            let on_path = |pose: &&PoseFormat| path.poses().contains(pose);
            let poses: Vec<PoseFormat> = wanted.poses.iter().filter(held).filter(on_path).copied().collect();
            for batch in batches {
                for (&mode, &pose) in modes.iter().flat_map(|mode| poses.iter().map(move |pose| (mode, pose))) {
                    let desc = UpdateDesc::new(path, batch)
                        .mode(mode)
                        .slots(update.slots)
                        .pose(pose)
                        .tolerance(update.drift)
                        .weight_max(update.pack.weight_max)
                        .error_budget(if format.is_blocks() { wanted.error_budget } else { 0.0 });
                    match desc.check() {
                        Ok(()) => configs.push(Config { desc, format, batch_max, separate: false, animated: false }),
                        Err(e) => {
                            let what = format!("{} batch {batch}", path.name());
                            skipped.push(Skipped { what, reason: e.to_string() });
                        }
                    }
                }
            }
            // `all` is in the default list; feedback does not support it, which is not reported.
            let named = |b: &&BatchSize| **b != BatchSize::All && sizes_named;
            let mut refused = refused.iter().filter(named);
            if let Some(first) = refused.next() {
                let sizes = refused.next_back().map_or(first.to_string(), |last| format!("{first} to {last}"));
                skipped.push(Skipped {
                    what: format!("{} {} batch {sizes}", path.name(), format.name()),
                    reason: format!("the device allows at most {max} targets per pass"),
                });
            }
        }
        if !update.paths.is_empty() && before == (configs.len(), skipped.len()) {
            let formats: Vec<&str> = path.formats().iter().map(|format| format.name()).collect();
            let poses: Vec<&str> = path.poses().iter().map(|pose| pose.name()).collect();
            let reason = format!("takes --formats {} and --poses {}", formats.join(","), poses.join(","));
            skipped.push(Skipped { what: path.name().into(), reason });
        }
    }
    (configs, skipped)
}
