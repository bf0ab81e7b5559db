//! The ordinary run: every requested configuration, one after the other.

use super::configs::{Config, Wanted, configurations};
use super::interleave::{Common, Schedule, interleave};
use super::record::{Report, Skipped};
use super::session::Session;
use super::subject::Subject;
use super::trial::Candidate;
use super::workload::{Setting, Workload};
use crate::args::bench::BenchArgs;
use crate::args::distinct_or;
use crate::args::values::{BatchSpec, expand_changed};
use crate::input::{self, Input};
use crate::output::{Failure, Output};
use deltamorph::{BoundClip, DeltaFormat, PoseFormat, UpdatePath};
use deltamorph_headless::DeviceChoice;

/// Default batch sizes.
const FULL_SWEEP: [BatchSpec; 2] = [BatchSpec::Range(1, None), BatchSpec::All];
const BRIEF_SWEEP: [BatchSpec; 3] = [BatchSpec::Size(8), BatchSpec::Max, BatchSpec::All];
/// Default paths. Baselines have a suite of their own.
const PATHS: [UpdatePath; 4] = [UpdatePath::Feedback, UpdatePath::Compute, UpdatePath::Blocks, UpdatePath::Cpu];
/// Default formats. Float32 is dense on `cpu`; in blocks it runs only on request.
const FORMATS: [DeltaFormat; 4] = [DeltaFormat::Float32, DeltaFormat::Snorm16, DeltaFormat::Fast, DeltaFormat::Small];
/// Default pose formats.
const POSES: [PoseFormat; 2] = [PoseFormat::Float32, PoseFormat::Fixed32];

pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report, Failure> {
    let input = input::load(&args.input, true, out)?;
    let counts = expand_changed(&args.changed, input.kept.targets.len()).map_err(Failure::Usage)?;
    let clips = clips(args, &input)?;
    let budget = args.update.budget(input.kept.diagonal);
    let poses = distinct_or(&args.update.named_poses().map_err(Failure::Usage)?, &POSES);
    let mut session = Session::open(args, device, &input, out)?;
    let (full, skipped) = wanted(&session, &poses, budget, &FULL_SWEEP);
    let (brief, _) = wanted(&session, &poses, budget, &BRIEF_SWEEP);
    skipped.into_iter().for_each(|skipped| session.skip(skipped));

    let random = |&n: &usize| Workload::random(input.kept.targets.len(), n, args.input.seed);
    let workloads: Vec<Workload> = counts.iter().map(random).chain(clips.iter().map(Workload::clip)).collect();
    // If a path evaluates in draws, all configurations draw.
    let drawn = full.iter().any(|config| config.desc.path.evaluates_in_draws());
    let setting = |heads, workload| Setting { workload, others: &[], heads, shared: args.shared, drawn, brief: false };
    let heads = args.heads_or(&[1]).into_iter();
    let settings: Vec<_> = heads.flat_map(|n| workloads.iter().map(move |workload| setting(n, workload))).collect();

    // Every batch size for the most changes; otherwise a few, for the plot against changed targets.
    let configs = |setting: &Setting<'_>| match setting.workload.changed {
        Some(n) if Some(&n) != counts.last() => &brief,
        _ => &full,
    };
    session.bar.inc_length(settings.iter().map(|s| configs(s).len() as u64).sum());
    let mut subject = Subject::new(input);
    let whole = Schedule { frames: args.frames, rounds: 1, limit: None, common: Common::Nothing };
    for setting in &settings {
        for config in configs(setting) {
            let (path, format, batch) = (config.desc.path.name(), config.format.name(), config.desc.batch);
            let pose = if config.desc.pose.has_integers() { config.desc.pose.name() } else { "" };
            let (workload, heads) = (setting.workload, setting.heads);
            let changed = workload.changed.map_or("its".into(), |n| n.to_string());
            let work = format!("{}, {changed} changed, {heads} heads", workload.name);
            let what = format!("{path} {format} {pose} batch {batch}, {work}").replace("  ", " ");
            session.bar.set_message(what.clone());
            let one = [Candidate::new(&what, config, setting)];
            for outcome in interleave(&session.machine, &mut subject, &one, &whole)? {
                match outcome {
                    Ok(run) => drop(session.keep("", "", run)),
                    // The others are measured regardless.
                    Err(refused) => session.skip(refused),
                }
            }
            session.bar.inc(1);
        }
    }
    let report = session.report();
    let named = clips.iter().filter(|_| !args.weights.is_empty()).map(|clip| clip.name.clone());
    let unplayed = named.filter(|name| report.runs.iter().all(|run| run.workload != *name)).collect();
    Ok(Report { unplayed, ..report })
}

/// The clips given with `--weights`; without any, those of the input.
fn clips(args: &BenchArgs, input: &Input) -> Result<Vec<BoundClip>, Failure> {
    let paths = if args.weights.is_empty() { &input.clips } else { &args.weights };
    let mut clips: Vec<BoundClip> = vec![];
    for path in paths {
        let mut clip = input::clip(path, &args.input, input, &[])?;
        // Reports tell workloads apart by name.
        let taken = |name: &str| name == "random" || clips.iter().any(|c| c.name == name);
        let numbered = (2u32..).map(|n| format!("{} {n}", clip.name));
        let free = std::iter::once(clip.name.clone()).chain(numbered).find(|name| !taken(name));
        clip.name = free.unwrap_or_default();
        clips.push(clip);
    }
    Ok(clips)
}

/// The configurations that can run, and those requested that cannot, with the reason.
fn wanted(
    session: &Session<'_>,
    poses: &[PoseFormat],
    error_budget: f32,
    sweep: &[BatchSpec],
) -> (Vec<Config>, Vec<Skipped>) {
    let (args, update) = (session.args, &session.args.update);
    let wanted = Wanted {
        paths: &update.paths_or(&PATHS),
        formats: if update.formats.is_empty() { &FORMATS } else { &update.formats },
        poses,
        modes: &update.modes,
        sizes: if args.batch_sizes.is_empty() { sweep } else { &args.batch_sizes },
        error_budget,
    };
    configurations(&wanted, args, session.machine.gpu.as_ref())
}
