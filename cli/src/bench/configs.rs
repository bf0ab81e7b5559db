//! Supported combinations of paths, formats, modes, poses and batch sizes.

use super::record::Skipped;
use crate::args::bench::BenchArgs;
use crate::args::distinct_or;
use crate::args::values::{BatchSpec, expand_batches};
use crate::runner::Gpu;
use deltamorph::{BatchSize, DeltaFormat, PoseFormat, UpdateDesc, UpdateMode, UpdatePath};
use std::fmt;

/// An update description and a delta format.
#[derive(Clone)]
pub struct Config {
    /// Path, batch size, mode, slots.
    pub desc: UpdateDesc,
    pub format: DeltaFormat,
    /// The largest batch that path and format allow.
    pub batch_max: Option<u32>,
    /// Each instance plays its weights as a clip, sampled and planned on the device.
    pub animated: bool,
}

impl Config {
    /// The path, with the mode if it is not the path's default, and the pose format if it is not float32.
    pub fn technique(&self) -> String {
        let UpdateDesc { path, mode, pose, .. } = self.desc;
        let more = [
            (mode != path.default_mode(), mode.name()),
            (pose.has_integers(), pose.name()),
            (self.animated, "animated"),
        ];
        let more = more.into_iter().filter(|(differs, _)| *differs);
        more.fold(path.name().to_owned(), |technique, (_, word)| format!("{technique} {word}"))
    }
}

impl fmt::Display for Config {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} batch {}", self.technique(), self.format.name(), self.desc.batch)
    }
}

/// The values to combine; each path takes the delta formats and pose formats that it supports.
#[derive(Clone, Copy)]
pub struct Wanted<'a> {
    pub paths: &'a [UpdatePath],
    pub poses: &'a [PoseFormat],
    /// None: that of each path.
    pub modes: &'a [UpdateMode],
    /// Targets per pass.
    pub sizes: &'a [BatchSpec],
    /// In input units; for block formats.
    pub error_budget: f32,
}

/// The configurations that can run, and those requested that cannot, with the reason. Defaults that cannot run are
/// skipped without a warning.
pub fn configurations(wanted: &Wanted<'_>, args: &BenchArgs, gpu: Option<&Gpu>) -> (Vec<Config>, Vec<Skipped>) {
    let (mut configs, mut skipped): (Vec<Config>, Vec<Skipped>) = (vec![], vec![]);
    let (update, sizes_named) = (&args.update, !args.batch_sizes.is_empty());
    let formats = distinct_or(&update.formats, &DeltaFormat::ALL);
    for &path in wanted.paths {
        let mut skip = |what: String, reason: String| skipped.push(Skipped { what, reason });
        let available = match (path, gpu) {
            (UpdatePath::Cpu, _) => Ok(()),
            (_, Some(gpu)) => gpu.caps().check_path(path).map_err(|e| e.to_string()),
            (_, None) => Err("there is no Vulkan device; the path 'cpu' needs none".into()),
        };
        if let Err(reason) = available {
            skip(path.name().into(), reason);
            continue;
        }
        let own = [path.default_mode()];
        let modes = if wanted.modes.is_empty() { &own } else { wanted.modes };
        let mut none = true;
        for format in formats.iter().copied().filter(|format| path.formats().contains(format)) {
            let batch_max = gpu.and_then(|gpu| gpu.caps().batch_max(path, format));
            let max = batch_max.unwrap_or(0);
            // A draw evaluates all active targets: there are no batch sizes.
            let direct = path == deltamorph_baselines::DIRECT_ATTRIBUTES && !sizes_named;
            let (batches, refused) = expand_batches(if direct { &[BatchSpec::Max] } else { wanted.sizes }, path, max);
            // Formats that only blocks support are not reported if all were requested.
            let poses = wanted.poses.iter().filter(|pose| path.poses().contains(pose) && pose.takes(format));
            for batch in batches {
                for (&pose, &mode) in poses.clone().flat_map(|pose| modes.iter().map(move |mode| (pose, mode))) {
                    none = false;
                    let desc = UpdateDesc {
                        mode,
                        slots: update.slots,
                        pose,
                        tolerance: update.drift,
                        weight_max: update.pack.weight_max,
                        error_budget: if format.is_blocks() { wanted.error_budget } else { 0.0 },
                        ..UpdateDesc::new(path, batch)
                    };
                    match desc.check() {
                        Err(e) => skip(format!("{} batch {batch}", path.name()), e.to_string()),
                        Ok(()) => configs.push(Config { desc, format, batch_max, animated: false }),
                    }
                }
            }
            // `all` is in the default list; feedback does not support it, which is not reported.
            let mut refused = refused.iter().filter(|batch| **batch != BatchSize::All && sizes_named);
            if let Some(first) = refused.next() {
                none = false;
                let sizes = refused.next_back().map_or(first.to_string(), |last| format!("{first} to {last}"));
                skip(
                    format!("{} {} batch {sizes}", path.name(), format.name()),
                    format!("the device allows at most {max} targets per pass"),
                );
            }
        }
        if none && !update.paths.is_empty() {
            let formats: Vec<&str> = path.formats().iter().map(|format| format.name()).collect();
            let poses: Vec<&str> = path.poses().iter().map(|pose| pose.name()).collect();
            let reason = format!("supports --formats {} and --poses {}", formats.join(","), poses.join(","));
            skip(path.name().into(), reason);
        }
    }
    (configs, skipped)
}
