//! The competing techniques, each against every other on made-up workloads and captured clips: every update path in its
//! best configuration, and two that rebuild every frame.

use crate::args::InputArgs;
use crate::args::values::BatchSpec;
use crate::bench::configs::{Config, Wanted, configurations};
use crate::bench::interleave::{Common, Schedule, interleave};
use crate::bench::record::{CellRecord, RunRecord, Skipped, draws_words};
use crate::bench::session::Session;
use crate::bench::subject::Subject;
use crate::bench::trial::Candidate;
use crate::bench::workload::{Setting, Workload};
use crate::input::{self, Input};
use crate::output::Failure;
use deltamorph::{PoseFormat, UpdateMode, UpdatePath};
use std::path::PathBuf;

/// A technique's name and the configurations to choose the best from. The name is the path, with the mode if it is not
/// the path's default and the pose format if it is not float32.
pub type Technique = (String, Vec<Config>);
/// The name of a technique, and its fastest configuration.
pub type Chosen = (String, Config);

/// Candidates of all of `chosen` in one setting.
pub fn candidates<'a>(chosen: &[Chosen], setting: &'a Setting<'a>) -> Vec<Candidate<'a>> {
    chosen.iter().map(|(name, config)| Candidate::new(name, config, setting)).collect()
}

/// Batch sizes to choose from; few, since beyond 8 the gain is small.
const SIZES: [BatchSpec; 3] = [BatchSpec::Size(8), BatchSpec::Size(16), BatchSpec::All];

/// Every technique of `paths`, unless others are named, that can run, in each of `poses` that its path supports; adds
/// those that cannot run to the skipped ones.
pub fn all(session: &mut Session<'_>, paths: &[UpdatePath], poses: &[PoseFormat]) -> Vec<Technique> {
    let (mut techniques, float) = (vec![], PoseFormat::Float32);
    for path in session.args.update.paths_or(paths) {
        let sizes = if path.takes_all_targets() { &SIZES[..] } else { &[BatchSpec::Max] };
        let own = poses.iter().filter(|pose| path.poses().contains(pose)).map(|&pose| match pose.has_integers() {
            true => (path.default_mode(), sizes, pose, format!(" {}", pose.name())),
            false => (path.default_mode(), sizes, pose, String::new()),
        });
        let mut ways: Vec<_> = own.collect();
        // Two paths have rebuilding every frame as a separate technique: in compute passes (Godot, PlayCanvas), and in
        // vertex passes one target after the other (Godot's compatibility renderer).
        match path {
            UpdatePath::Compute => ways.push((UpdateMode::Rebuild, sizes, float, " rebuild".into())),
            UpdatePath::Feedback => {
                ways.push((UpdateMode::Rebuild, &[BatchSpec::Size(1)], float, " rebuild at batch 1".into()));
            }
            _ => {}
        }
        for (mode, sizes, pose, suffix) in ways {
            let wanted = Wanted {
                paths: &[path],
                formats: &session.args.update.formats,
                poses: &[pose],
                modes: &[mode],
                sizes,
                ..Wanted::default()
            };
            let name = format!("{}{suffix}", path.name());
            let (configs, skipped) = configurations(&wanted, session.args, session.machine.gpu.as_ref());
            skipped.into_iter().for_each(|s| session.skip(Skipped { what: name.clone(), ..s }));
            if !configs.is_empty() {
                techniques.push((name, configs));
            }
        }
    }
    techniques
}

/// The fastest configuration of each technique in a short run; none if all are refused.
pub fn choose(
    session: &mut Session<'_>,
    subject: &mut Subject,
    setting: &Setting<'_>,
    techniques: &[Technique],
) -> Result<Vec<Chosen>, Failure> {
    let schedule = Schedule { frames: 6, rounds: 3, limit: session.limit / 20, common: Common::Nothing };
    let mut chosen = vec![];
    session.out.note(format_args!("choosing format and batch size of {} techniques in short runs", techniques.len()));
    let bar =
        session.out.bar(techniques.iter().map(|(_, configs)| configs.len() + schedule.rounds).sum::<usize>() as u64);
    for (name, configs) in techniques {
        bar.set_message(format!("choosing the best {name}"));
        let rivals: Vec<Chosen> = configs.iter().map(|config| (name.clone(), config.clone())).collect();
        if rivals.len() == 1 {
            chosen.extend(rivals);
            continue;
        }
        let outcomes = interleave(&session.machine, subject, &candidates(&rivals, setting), &schedule, &bar)?;
        let mut best = f64::INFINITY;
        let mut fastest = None;
        for (outcome, rival) in outcomes.into_iter().zip(rivals) {
            match outcome {
                Ok(run) if run.counts() && run.median() < best => (best, fastest) = (run.median(), Some(rival)),
                Ok(run) if run.verified => {}
                // A wrong result has to be reported, regardless of the others.
                Ok(run) => drop(session.keep("choice", name, run)),
                Err(refused) => session.skip(refused),
            }
        }
        chosen.extend(fastest);
    }
    Ok(chosen)
}

/// Default mean fraction of the vertices that a target of the sparse head moves.
pub const SPARSE: f32 = 0.08;

/// The built-in head of `args`, dense and sparse; or only INPUT, if given.
pub fn dense_and_sparse(session: &Session<'_>, args: &InputArgs) -> Result<Vec<Input>, Failure> {
    if args.input.is_some() {
        return Ok(vec![input::load(args, true, session.out)?]);
    }
    let sparse = args.head.sparsity.unwrap_or(SPARSE);
    let heads = [("dense".to_owned(), 1.0), (format!("{}% sparse", sparse * 100.0), sparse)];
    let load = |(name, sparsity)| -> Result<Input, Failure> {
        let mut args: InputArgs = args.clone();
        args.head.sparsity = Some(sparsity);
        Ok(Input { name, ..input::load(&args, true, session.out)? })
    };
    heads.into_iter().map(load).collect()
}

/// Most instances for choosing configurations: with more the choice is the same, and takes longer.
const CHOICE_HEADS: u32 = 10;
/// Changed targets in two workloads: the others keep their weights in one, and are 0 in the other.
const FEW: usize = 8;
const ACTIVE: usize = 4;

/// A mesh and its workloads, each with a description; or those of a scene, and in each workload one for each of them.
pub type Workloads = (Vec<Input>, Vec<(Vec<Workload>, String)>);

/// Workloads with all targets changed, with few, and with few active, each on a dense and a sparse mesh.
pub fn made_up(session: &Session<'_>) -> Result<Vec<Workloads>, Failure> {
    let workloads = |input: Input| {
        let (n, seed) = (input.kept.targets.len(), session.args.input.seed);
        let (few, active) = (FEW.min(n), ACTIVE.min(n));
        let works = vec![
            (vec![Workload::random(n, n, seed)], format!("all {n} changed")),
            (vec![Workload::random(n, few, seed)], format!("{few} of {n} changed")),
            (vec![Workload::few(n, active, seed)], format!("{active} non-zero of {n}")),
        ];
        (vec![input], works)
    };
    Ok(dense_and_sparse(session, &session.args.input)?.into_iter().map(workloads).collect())
}

/// Targets with constant weights beside animated ones: none, poses held by clips of public game avatars, and sliders of
/// a character creator.
const CONSTANT: [usize; 4] = [0, 28, 100, 200];
const ANIMATED: [usize; 3] = [0, ACTIVE, 12];
/// Default number of vertices of that head, since it has three times as many targets as others.
const CONSTANT_VERTICES: usize = 10_000;

/// Workloads of constant weights beside animated ones, each on a dense and a sparse mesh; the other weights are 0.
pub fn constant(session: &Session<'_>) -> Result<Vec<Workloads>, Failure> {
    let mut args = session.args.input.clone();
    args.head.vertices.get_or_insert(CONSTANT_VERTICES);
    args.head.targets.get_or_insert(CONSTANT[CONSTANT.len() - 1] + ANIMATED[ANIMATED.len() - 1]);
    let workloads = |input: Input| {
        let n = input.kept.targets.len();
        let mut counts: Vec<_> = ANIMATED.iter().flat_map(|&animated| CONSTANT.map(|held| (held, animated))).collect();
        counts.iter_mut().for_each(|(held, animated)| {
            *animated = n.min(*animated);
            *held = (n - *animated).min(*held);
        });
        counts.dedup();
        let work = |(held, animated)| {
            let workload = Workload::constant(n, held, animated, session.args.input.seed);
            (vec![workload], format!("{held} constant, {animated} animated"))
        };
        (vec![input], counts.into_iter().map(work).collect())
    };
    Ok(dense_and_sparse(session, &args)?.into_iter().map(workloads).collect())
}

/// The clips of INPUT; without INPUT, those of each set under DELTAMORPH_DATA.
pub fn captured(session: &mut Session<'_>) -> Result<Vec<Workloads>, Failure> {
    let mut list = vec![];
    for set in sets(session)? {
        let args = InputArgs { input: Some(set), head: Default::default(), ..session.args.input.clone() };
        let input = input::load(&args, true, session.out)?;
        let read = |path: &PathBuf| {
            input::clip(path, &args, &input, &[]).map(|clip| (vec![Workload::clip(&clip)], clip.name.clone()))
        };
        let works = input.clips.iter().map(read).collect::<Result<_, _>>()?;
        list.push((vec![input], works));
    }
    Ok(list)
}

/// Measures `all` techniques on each of `list`, for one instance and for many, with few draws and with more: a cell
/// each.
pub fn run(session: &mut Session<'_>, list: Vec<Workloads>, heads: &[u32], all: &[Technique]) -> Result<(), Failure> {
    let (heads, passes) = (session.args.heads_or(heads), session.args.draws_or(1));
    for (inputs, works) in list {
        let mut subject = session.scene(inputs);
        let mesh = subject.info().name;
        session.planned += works.len() * heads.len() * passes.len();
        for (workloads, change) in &works {
            let clips = workloads.iter().any(|workload| workload.changed.is_none());
            let schedule = session.schedule(if clips { Common::Frames } else { Common::Nothing });
            let (mut chosen_with, mut chosen) = (0, vec![]);
            for &heads in &heads {
                let some = heads.min(CHOICE_HEADS);
                if some != chosen_with {
                    let setting = Setting::of_scene(workloads, some, passes[0]);
                    (chosen_with, chosen) = (some, choose(session, &mut subject, &setting, all)?);
                }
                for &passes in &passes {
                    let setting = Setting::of_scene(workloads, heads, passes);
                    let (heads, plural) = (setting.heads, if setting.heads == 1 { "" } else { "s" });
                    let cell = format!("{mesh}, {change}, {heads} head{plural}{}", draws_words(passes));
                    let runs = session.measure(&mut subject, &cell, &candidates(&chosen, &setting), &schedule)?;
                    let runs: Vec<RunRecord> = runs.into_iter().flatten().collect();
                    session.suite.cells.push(CellRecord::of(&cell, [&mesh, change], heads, &runs));
                }
            }
        }
    }
    Ok(())
}

/// The folders with clips; if there are none, the skipped entries say why.
fn sets(session: &mut Session<'_>) -> Result<Vec<PathBuf>, Failure> {
    let has_clips = |folder: &PathBuf| folder.join("neutral.obj").is_file() && folder.join("weights").is_dir();
    let (sets, reason) = match (&session.args.input.input, std::env::var_os("DELTAMORPH_DATA")) {
        (Some(input), _) => (vec![input.clone()], format!("{} has no clip in weights/*.csv", input.display())),
        (None, Some(root)) => {
            let root = PathBuf::from(root);
            let entries = std::fs::read_dir(&root).and_then(|entries| entries.map(|e| Ok(e?.path())).collect());
            let mut sets: Vec<PathBuf> = entries.map_err(|e| {
                let root = root.display();
                Failure::Failed(format!("DELTAMORPH_DATA: {root}: cannot read the folder: {e}; name the unpacked sets"))
            })?;
            sets.sort();
            (sets, format!("no folder of DELTAMORPH_DATA ({}) has neutral.obj and weights/*.csv", root.display()))
        }
        (None, None) => (vec![], "give INPUT with weights/*.csv, or set DELTAMORPH_DATA to a folder of such".into()),
    };
    let sets: Vec<PathBuf> = sets.into_iter().filter(has_clips).collect();
    if sets.is_empty() {
        session.skip(Skipped { what: "suite clips".into(), reason });
    }
    Ok(sets)
}
