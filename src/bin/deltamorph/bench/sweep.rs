//! Which configurations run, on what.

use super::bandwidth;
use super::measure::{Config, Context, References, Setting};
use super::record::{Bandwidth, DeviceInfo, InputInfo, Report, Skipped};
use super::stamp;
use super::workload::{Clip, Random, Workload};
use crate::args::BenchArgs;
use crate::args::values::{
    AccumulateChoice, BatchLimit, BatchSpec, FormatChoice, PathChoice, expand_batches, expand_changed,
};
use crate::info::triangles;
use crate::input::{self, Input};
use crate::output::{Failure, Output};
use crate::runner::{Gpu, Runner, packed};
use deltamorph::headless::DeviceChoice;
use deltamorph::mesh::packed::{DeltaFormat, PackedMesh};
use deltamorph::plan::{BatchSize, UpdateDesc, UpdatePath};
use std::collections::HashMap;
use std::sync::Arc;

/// Batch sizes where none are given.
const FULL_SWEEP: [BatchSpec; 2] = [BatchSpec::Range(1, None), BatchSpec::All];
const BRIEF_SWEEP: [BatchSpec; 3] = [BatchSpec::Size(8), BatchSpec::Max, BatchSpec::All];
/// Run everything that `args` ask for.
///
/// # Errors
/// The input or a clip cannot be used; an option asks for what the mesh does not have; a device that fails.
pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report, Failure> {
    let input = input::load(&args.input, out)?;
    let threads = args.update.threads.unwrap_or(0);
    let gpu = Gpu::open(device, out)?;
    if gpu.is_none() {
        out.note("carrying on with the path 'cpu'");
    }
    let counts = expand_changed(&args.changed, input.kept.targets.len()).map_err(Failure::Usage)?;
    let clips = clips(args, &input)?;
    let budget = args.update.budget(input.kept.diagonal).map_err(Failure::Usage)?;
    let (full, mut skipped) = configurations(args, gpu.as_ref(), budget, &FULL_SWEEP);
    let (brief, _) = configurations(args, gpu.as_ref(), budget, &BRIEF_SWEEP);

    let randoms: Vec<(usize, Random)> =
        counts.iter().map(|&n| (n, Random::new(input.kept.targets.len(), n, args.input.seed))).collect();
    let mut settings = vec![];
    for &heads in &args.heads {
        settings.extend(randoms.iter().map(|(n, w)| Setting { workload: w, changed: Some(*n), heads }));
        settings.extend(clips.iter().map(|w| Setting { workload: w, changed: None, heads }));
    }

    let spinner = out.spinner("measuring memory bandwidth");
    let largest = (input.kept.vertex_count() * input.kept.targets.len() * DeltaFormat::Float32.stride()) as u64;
    let cpu = bandwidth::measure(largest, threads);
    let device_bandwidth = match &gpu {
        Some(gpu) => gpu.headless.bandwidth(largest.max(1 << 20))?,
        None => None,
    };
    spinner.finish_and_clear();
    let bandwidth = Bandwidth {
        cpu_read_gb_s: cpu.map(|b| b.0),
        cpu_copy_gb_s: cpu.map(|b| b.1),
        device_copy_gb_s: device_bandwidth.map(|b| b.copy),
        device_read_gb_s: device_bandwidth.map(|b| b.read),
    };

    // Every batch size where most changes; elsewhere a few, for the plot against changed targets.
    let configs = |setting: &Setting<'_>| match setting.changed {
        Some(n) if Some(&n) != counts.last() => &brief,
        _ => &full,
    };
    let bar = out.bar(settings.iter().map(|s| configs(s).len() as u64).sum());
    let mut meshes: HashMap<DeltaFormat, Arc<PackedMesh>> = HashMap::new();
    let mut references = References::default();
    let mut runs = vec![];
    for setting in &settings {
        for config in configs(setting) {
            if let Some(reason) = too_many_active(config, setting) {
                skipped.push(Skipped { what: config.desc.path.name().into(), reason });
                bar.inc(1);
                continue;
            }
            bar.set_message(format!(
                "{} {} batch {}, {}, {} changed",
                config.desc.path.name(),
                config.format.name(),
                config.desc.batch,
                setting.workload.name(),
                setting.changed.map_or("its".into(), |n| n.to_string())
            ));
            let mesh = match meshes.get(&config.format) {
                Some(mesh) => mesh.clone(),
                None => {
                    let mesh = packed(&input, gpu.as_ref(), config.format, &args.update.pack)?;
                    meshes.insert(config.format, mesh.clone());
                    mesh
                }
            };
            let context = Context { args, input: &input, bandwidth };
            let what = || {
                let (path, batch, heads) = (config.desc.path.name(), config.desc.batch, setting.heads);
                format!("{path} {} batch {batch}, {heads} heads", config.format.name())
            };
            match Runner::new(gpu.as_ref(), &mesh, config.desc, setting.heads, threads) {
                Ok(runner) => runs.push(context.measure(runner, setting, config, &mesh, &mut references)?),
                // Too large for the device, say: the rest goes on.
                Err(e) => skipped.push(Skipped { what: what(), reason: e.to_string() }),
            }
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    let moved: usize = input.kept.targets.iter().map(|t| t.vertices.len()).sum();
    Ok(Report {
        schema: 1,
        version: env!("CARGO_PKG_VERSION").into(),
        created: stamp::now(),
        command: stamp::command_line(),
        device: device_info(gpu.as_ref(), threads),
        input: InputInfo {
            name: input.kept.name.clone(),
            origin: input.origin.clone(),
            vertices: input.kept.vertex_count(),
            targets: input.kept.targets.len(),
            triangles: triangles(&input.kept),
            diagonal: input.kept.diagonal,
            tolerance: input.kept.tolerance.position,
            moved_mean: moved as f64 / (input.kept.vertex_count() * input.kept.targets.len()).max(1) as f64,
        },
        bandwidth,
        runs,
        skipped,
    })
}

/// Why a draw of `direct-attributes` cannot take a workload; `None` where it can, and for other paths.
fn too_many_active(config: &Config, setting: &Setting<'_>) -> Option<String> {
    let (UpdatePath::DirectAttributes, BatchSize::Targets(most)) = (config.desc.path, config.desc.batch) else {
        return None;
    };
    let active = |head, frame| setting.workload.weights(head, frame).iter().filter(|w| **w != 0.0).count();
    let frames = 0..setting.workload.period();
    let worst = (0..setting.heads).flat_map(|head| frames.clone().map(move |frame| active(head, frame))).max()?;
    (worst > most as usize).then(|| {
        let workload = setting.workload.name();
        format!("{worst} targets are active in '{workload}', a draw has vertex attributes for {most} in this format")
    })
}

/// The clips given with `--weights`; without any, those of the input.
fn clips(args: &BenchArgs, input: &Input) -> Result<Vec<Clip>, Failure> {
    let paths = if args.weights.is_empty() { &input.clips } else { &args.weights };
    let mut clips: Vec<Clip> = vec![];
    for path in paths {
        let (clip, frames) = input::clip(path, &args.input, &input.kept)?;
        // Reports tell workloads apart by name.
        let taken = |name: &str| name == "random" || clips.iter().any(|c| c.name() == name);
        let numbered = (2..).map(|n| format!("{} {n}", clip.name));
        let name = std::iter::once(clip.name.clone()).chain(numbered).find(|name| !taken(name));
        clips.push(Clip::new(name.unwrap_or_default(), frames));
    }
    Ok(clips)
}

/// What can run, and what was asked for and cannot, with the reason.
fn configurations(
    args: &BenchArgs,
    gpu: Option<&Gpu>,
    budget: f32,
    sweep: &[BatchSpec],
) -> (Vec<Config>, Vec<Skipped>) {
    let all = [PathChoice::Feedback, PathChoice::Compute, PathChoice::Blocks, PathChoice::Cpu];
    let update = &args.update;
    let paths = if update.paths.is_empty() { &all[..] } else { &update.paths };
    // The float32 of `cpu` is the dense one; in blocks it is there for the asking.
    let formats = [FormatChoice::Float32, FormatChoice::Snorm16, FormatChoice::Fast, FormatChoice::Small];
    let formats = if update.formats.is_empty() { &formats[..] } else { &update.formats };
    let sums = [AccumulateChoice::Float, AccumulateChoice::Exact];
    let sums = if update.accumulate.is_empty() { &sums[..] } else { &update.accumulate };
    let sizes = if args.batch_sizes.is_empty() { sweep } else { &args.batch_sizes };
    let (mut configs, mut skipped) = (vec![], vec![]);
    for path in paths.iter().map(|p| p.update_path()) {
        let available = match (path, gpu) {
            (UpdatePath::Cpu, _) => Ok(()),
            (_, Some(gpu)) => gpu.caps().check_path(path).map_err(|e| e.to_string()),
            (_, None) => Err("there is no Vulkan device; the path 'cpu' takes its place".into()),
        };
        if let Err(reason) = available {
            skipped.push(Skipped { what: path.name().into(), reason });
            continue;
        }
        // A draw takes the active targets, whatever their number: there is nothing to sweep.
        let one = [BatchSpec::Max];
        let direct = path == UpdatePath::DirectAttributes && args.batch_sizes.is_empty();
        let sizes = if direct { &one[..] } else { sizes };
        for format in formats.iter().filter_map(|f| f.delta_format(path)) {
            let dense = !format.is_blocks();
            let batch_max = gpu.and_then(|g| g.caps().batch_max(path, format)).filter(|_| path != UpdatePath::Cpu);
            let limit = BatchLimit { max: batch_max.unwrap_or(0), all: path.takes_all_targets() };
            let (batches, refused) = expand_batches(sizes, limit);
            // What only blocks have is no news where everything was asked for.
            let has = |sums: &AccumulateChoice| match (sums, format) {
                (AccumulateChoice::Float, _) => path != UpdatePath::Scatter,
                (AccumulateChoice::Exact, DeltaFormat::BlockFloat32) => false,
                (AccumulateChoice::Exact, _) => !dense,
            };
            let sums: Vec<_> = sums.iter().filter(|s| has(s)).collect();
            for batch in batches {
                for (mode, sums) in update.modes(path).into_iter().flat_map(|m| sums.iter().map(move |s| (m, **s))) {
                    let desc = UpdateDesc {
                        mode,
                        slots: update.slots,
                        accumulate: update.sums(sums),
                        error_budget: if dense { 0.0 } else { budget },
                        ..UpdateDesc::new(path, batch)
                    };
                    match desc.check() {
                        Ok(()) => configs.push(Config { desc, format, batch_max }),
                        Err(e) => {
                            let what = format!("{} batch {batch}", path.name());
                            skipped.push(Skipped { what, reason: e.to_string() });
                        }
                    }
                }
            }
            // `all` is in the default list; that feedback has no such thing is no news.
            let named = |b: &&BatchSize| **b != BatchSize::All && !args.batch_sizes.is_empty();
            let refused: Vec<&BatchSize> = refused.iter().filter(named).collect();
            if let (Some(first), Some(last)) = (refused.first(), refused.last()) {
                let sizes = if first == last { first.to_string() } else { format!("{first} to {last}") };
                skipped.push(Skipped {
                    what: format!("{} {} batch {sizes}", path.name(), format.name()),
                    reason: format!("the device allows at most {} targets per pass", limit.max),
                });
            }
        }
    }
    (configs, skipped)
}

fn device_info(gpu: Option<&Gpu>, threads: usize) -> DeviceInfo {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let cpu = DeviceInfo {
        name: "none".into(),
        kind: "none".into(),
        cpu: stamp::processor(),
        threads: if threads == 0 { cores } else { threads },
        ..DeviceInfo::default()
    };
    let Some(caps) = gpu.map(Gpu::caps) else { return cpu };
    let (major, minor, patch) = caps.api_version;
    let index = deltamorph::headless::Headless::devices().ok().and_then(|all| {
        all.iter().position(|c| (&c.name, &c.driver, &c.driver_info) == (&caps.name, &caps.driver, &caps.driver_info))
    });
    DeviceInfo {
        name: caps.name.clone(),
        kind: caps.kind.into(),
        driver: caps.driver.clone(),
        driver_info: caps.driver_info.clone(),
        api_version: format!("{major}.{minor}.{patch}"),
        index,
        ..cpu
    }
}
