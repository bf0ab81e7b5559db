//! The ordinary run: every configuration that was asked for, one after the other.

use super::cache::Cache;
use super::configs::{Wanted, configurations};
use super::interleave::{Candidate, Schedule, interleave};
use super::machine::Machine;
use super::record::{Report, Skipped};
use super::run::unused;
use super::setting::{Config, Setting};
use super::trial::Context;
use super::workload::Workload;
use crate::args::bench::BenchArgs;
use crate::args::values::{BatchSpec, SUMS, expand_changed};
use crate::input::{self, Input};
use crate::output::{Failure, Output};
use crate::runner::Gpu;
use deltamorph::headless::DeviceChoice;
use deltamorph::{Accumulate, BoundClip, DeltaFormat, UpdatePath};

/// Batch sizes where none are given.
const FULL_SWEEP: [BatchSpec; 2] = [BatchSpec::Range(1, None), BatchSpec::All];
const BRIEF_SWEEP: [BatchSpec; 3] = [BatchSpec::Size(8), BatchSpec::Max, BatchSpec::All];
/// Paths where none are given. The techniques of others have a suite of their own.
const PATHS: [UpdatePath; 4] = [UpdatePath::Feedback, UpdatePath::Compute, UpdatePath::Blocks, UpdatePath::Cpu];
/// Formats where none are given. The float32 of `cpu` is the dense one; in blocks it is there for the asking.
const FORMATS: [DeltaFormat; 4] = [DeltaFormat::Float32, DeltaFormat::Snorm16, DeltaFormat::Fast, DeltaFormat::Small];

/// Run everything that `args` ask for.
pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report, Failure> {
    let input = input::load(&args.input, true, out)?;
    let counts = expand_changed(&args.changed, input.kept.targets.len()).map_err(Failure::Usage)?;
    let clips = clips(args, &input)?;
    let budget = args.update.budget(input.kept.diagonal).map_err(Failure::Usage)?;
    let machine = Machine::open(args, device, &input, out)?;
    let gpu = machine.gpu.as_ref();
    let (full, mut skipped) = wanted(args, gpu, budget, &FULL_SWEEP);
    let (brief, _) = wanted(args, gpu, budget, &BRIEF_SWEEP);

    let random = |&n: &usize| Workload::random(input.kept.targets.len(), n, args.input.seed);
    let workloads: Vec<Workload> = counts.iter().map(random).chain(clips.iter().map(Workload::clip)).collect();
    let mut settings = vec![];
    // Where a path evaluates in draws, draws are what has to be compared.
    let drawn = full.iter().any(|config| config.desc.path.evaluates_in_draws());
    for heads in args.heads_or(&[1]) {
        let plain = |workload| Setting { workload, heads, shared: args.shared, drawn, brief: false };
        settings.extend(workloads.iter().map(plain));
    }

    // Every batch size where most changes; elsewhere a few, for the plot against changed targets.
    let configs = |setting: &Setting<'_>| match setting.workload.changed {
        Some(n) if Some(&n) != counts.last() => &brief,
        _ => &full,
    };
    let bar = out.bar(settings.iter().map(|s| configs(s).len() as u64).sum());
    let context = Context { args, input: &input, bandwidth: machine.bandwidth };
    let mut cache = Cache::default();
    let mut runs = vec![];
    for setting in &settings {
        for config in configs(setting) {
            let (path, format, batch) = (config.desc.path.name(), config.format.name(), config.desc.batch);
            let sums = if config.desc.accumulate == Accumulate::Exact { " exact" } else { "" };
            let (workload, heads) = (setting.workload, setting.heads);
            let changed = workload.changed.map_or("its".into(), |n| n.to_string());
            let work = format!("{}, {changed} changed, {heads} heads", workload.name);
            let what = format!("{path} {format}{sums} batch {batch}, {work}");
            bar.set_message(what.clone());
            let one = [Candidate { what, config: config.clone(), setting }];
            for outcome in interleave(context, gpu, &mut cache, &one, &Schedule::whole(args.frames))? {
                match outcome {
                    Ok(run) => runs.push(run),
                    // The others are measured all the same.
                    Err(refused) => skipped.push(refused),
                }
            }
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    let named = clips.iter().filter(|_| !args.weights.is_empty()).map(|clip| clip.name.clone());
    let unplayed = named.filter(|name| runs.iter().all(|run| run.workload != *name)).collect();
    Ok(Report { runs, skipped, unplayed, ..machine.report(&input) })
}

/// The clips given with `--weights`; without any, those of the input.
fn clips(args: &BenchArgs, input: &Input) -> Result<Vec<BoundClip>, Failure> {
    let paths = if args.weights.is_empty() { &input.clips } else { &args.weights };
    let mut clips: Vec<BoundClip> = vec![];
    for path in paths {
        let mut clip = input::clip(path, &args.input, &input.kept)?;
        // Reports tell workloads apart by name.
        let taken = |name: &str| name == "random" || clips.iter().any(|c| c.name == name);
        clip.name = unused(&clip.name, " ", taken);
        clips.push(clip);
    }
    Ok(clips)
}

/// What can run, and what was asked for and cannot, with the reason.
fn wanted(args: &BenchArgs, gpu: Option<&Gpu>, budget: f32, sweep: &[BatchSpec]) -> (Vec<Config>, Vec<Skipped>) {
    let update = &args.update;
    let wanted = Wanted {
        paths: update.paths_or(&PATHS),
        paths_named: !update.paths.is_empty(),
        formats: if update.formats.is_empty() { &FORMATS } else { &update.formats },
        sums: if update.accumulate.is_empty() { &SUMS } else { &update.accumulate },
        modes: update.modes.clone(),
        sizes: if args.batch_sizes.is_empty() { sweep } else { &args.batch_sizes },
        sizes_named: !args.batch_sizes.is_empty(),
        error_budget: budget,
    };
    configurations(&wanted, update, gpu)
}
