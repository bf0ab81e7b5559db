//! The ordinary run: the configurations of each workload, measured in turns.

use super::configs::{Config, Wanted};
use super::record::{Report, draws_words, heads_words};
use super::session::Session;
use super::workload::{Setting, Workload};
use crate::args::bench::BenchArgs;
use crate::args::distinct_or;
use crate::args::values::BatchSpec::{self, All, Max, Range, Size};
use crate::args::values::expand_changed;
use crate::input::{self, Input};
use crate::output::{Failure, Output, Result};
use deltamorph::{BoundClip, PoseFormat, UpdatePath};
use deltamorph_headless::DeviceChoice;

/// Batch sizes of the main comparison.
const MAIN: [BatchSpec; 7] = [Size(1), Size(2), Size(4), Size(8), Size(16), Max, All];
/// Changed targets of the main comparison, beside all of them.
const FEW: usize = 8;
/// Batch sizes of `--full`: for clips and the most changes, and for fewer changes.
const FULL: [BatchSpec; 2] = [Range(1, None), All];
const FULL_OF_FEW: [BatchSpec; 3] = [Size(8), Max, All];
/// Default paths. Baselines have a suite of their own.
const PATHS: [UpdatePath; 4] = [UpdatePath::Feedback, UpdatePath::Compute, UpdatePath::Blocks, UpdatePath::Cpu];
/// Seconds to time a configuration for, by default.
const SECONDS: f32 = 0.4;
/// Default pose formats: the first, with `--full` both.
const POSES: [PoseFormat; 2] = [PoseFormat::Float32, PoseFormat::Fixed32];

pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report> {
    let input = input::load(&args.input, false, out)?;
    let targets = input.kept.targets.len();
    let main = [Some(FEW.min(targets)), None];
    let changed = if args.full || !args.changed.is_empty() { &args.changed[..] } else { &main };
    let counts = expand_changed(changed, targets).map_err(Failure::Usage)?;
    let clips = clips(args, &input)?;
    let mut session = Session::open(args, device, &input, SECONDS, out)?;
    let poses = distinct_or(&args.update.poses, if args.full { &POSES } else { &POSES[..1] });
    let mut configs = |sizes| {
        session.configurations(&Wanted {
            paths: &distinct_or(&args.update.paths, &PATHS),
            poses: &poses,
            modes: &args.update.modes,
            sizes: if args.batch_sizes.is_empty() { sizes } else { &args.batch_sizes },
            error_budget: args.update.budget(input.kept.diagonal),
        })
    };
    let [most, few]: [Vec<Config>; 2] =
        if args.full { [&FULL[..], &FULL_OF_FEW] } else { [&MAIN[..]; 2] }.map(&mut configs);

    let random = |&n: &usize| Workload::random(targets, n, args.input.seed);
    let workloads: Vec<Workload> = counts.iter().map(random).chain(clips.iter().map(Workload::clip)).collect();
    // If a path evaluates in draws, all configurations draw.
    let drawn = most.iter().any(|config| config.desc.path.evaluates_in_draws());
    let mut settings = vec![];
    for heads in distinct_or(&args.heads, &[1]) {
        for passes in distinct_or(&args.draws, &[drawn.into()]) {
            let setting = |workloads| Setting { workloads, heads, shared: args.shared, passes, brief: false };
            settings.extend(workloads.chunks(1).map(setting));
        }
    }
    session.planned = settings.len();
    let mut subject = session.scene(vec![input]);
    for setting in &settings {
        let Workload { name, changed, .. } = setting.first();
        let configs = if changed.is_some_and(|n| Some(&n) != counts.last()) { &few } else { &most };
        let work = match changed {
            Some(n) => format!("{n} of {targets} targets changed"),
            None => format!("clip {name}"),
        };
        let cell = format!("{work}, {}{}", heads_words(setting.heads, setting.shared), draws_words(setting.passes));
        session.measure(&mut subject, &cell, configs, setting)?;
    }
    let mut report = session.report();
    let named = clips.iter().filter(|_| !args.weights.is_empty()).map(|clip| clip.name.clone());
    report.unmeasured.extend(named.filter(|name| report.runs.iter().all(|run| run.workload != *name)));
    Ok(report)
}

/// The clips given with `--weights`; without any, `--full` takes those of the input.
fn clips(args: &BenchArgs, input: &Input) -> Result<Vec<BoundClip>> {
    let of_input = if args.full { &input.clips[..] } else { &[] };
    let paths = if args.weights.is_empty() { of_input } else { &args.weights };
    let mut clips: Vec<BoundClip> = vec![];
    for path in paths {
        let mut clip = input.clip(path, &[])?;
        // Reports tell workloads apart by name.
        let taken = |name: &str| name == "random" || clips.iter().any(|c| c.name == name);
        let numbered = (2u32..).map(|n| format!("{} {n}", clip.name));
        let free = std::iter::once(clip.name.clone()).chain(numbered).find(|name| !taken(name));
        clip.name = free.unwrap_or_default();
        clips.push(clip);
    }
    Ok(clips)
}
