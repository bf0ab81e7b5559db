//! The competing techniques: every update path in its best configuration, two that rebuild every frame, and crowds that
//! the device animates.

use super::scenes::Scene;
use crate::args::distinct_or;
use crate::args::values::BatchSpec;
use crate::bench::configs::{Config, Wanted};
use crate::bench::record::{draws_words, heads_words};
use crate::bench::session::Session;
use crate::bench::workload::Setting;
use crate::output::Result;
use deltamorph::{PoseFormat, UpdateMode, UpdatePath};

/// Batch sizes to choose from; few, since beyond 8 the gain is small.
const SIZES: [BatchSpec; 3] = [BatchSpec::Size(8), BatchSpec::Size(16), BatchSpec::All];
/// Most instances for choosing configurations: with more the choice is the same, and takes longer.
const CHOICE_HEADS: u32 = 10;

/// The configurations of each technique, to choose the best from: those of every one of `paths`, unless others are
/// named, in each of `poses` that the path supports, unless others are named, or else in float32.
fn all(session: &mut Session<'_>, paths: &[UpdatePath], poses: &[PoseFormat]) -> Vec<Vec<Config>> {
    let (args, float) = (&session.args.update, PoseFormat::Float32);
    let poses = distinct_or(&args.poses, poses);
    let mut techniques = vec![];
    for path in distinct_or(&args.paths, paths) {
        let sizes = if path.takes_all_targets() { &SIZES[..] } else { &[BatchSpec::Max] };
        let own = poses.iter().filter(|pose| path.poses().contains(pose));
        let mut ways: Vec<_> = own.map(|&pose| (path.default_mode(), sizes, pose)).collect();
        if ways.is_empty() {
            ways.push((path.default_mode(), sizes, float));
        }
        // Two paths have rebuilding every frame as a separate technique: in compute passes (Godot, PlayCanvas), and in
        // vertex passes one target after the other (Godot's compatibility renderer).
        match path {
            UpdatePath::Compute => ways.push((UpdateMode::Rebuild, sizes, float)),
            UpdatePath::Feedback => ways.push((UpdateMode::Rebuild, &[BatchSpec::Size(1)], float)),
            _ => {}
        }
        for (mode, sizes, pose) in ways {
            let wanted = Wanted { paths: &[path], poses: &[pose], modes: &[mode], sizes, error_budget: 0.0 };
            let configs = session.configurations(&wanted);
            let plans = path == UpdatePath::Blocks && pose.has_integers();
            let animated = configs.iter().filter(|_| plans).map(|config| Config { animated: true, ..config.clone() });
            techniques.extend([animated.collect(), configs].into_iter().filter(|configs: &Vec<_>| !configs.is_empty()));
        }
    }
    techniques
}

/// Measures all techniques of `paths` and `poses` on each of `scenes`, for the numbers of instances in `heads`, unless
/// others are given, with few draws and with more: a cell each.
pub fn run(
    session: &mut Session<'_>,
    scenes: Vec<Scene>,
    heads: &[u32],
    paths: &[UpdatePath],
    poses: &[PoseFormat],
) -> Result<()> {
    let techniques = all(session, paths, poses);
    let args = session.args;
    let (heads, draws) = (distinct_or(&args.heads, heads), distinct_or(&args.draws, &[1]));
    session.planned += scenes.iter().map(|(_, works)| works.len()).sum::<usize>() * heads.len() * draws.len();
    for (inputs, works) in scenes {
        let mut subject = session.scene(inputs);
        let mesh = subject.info().name;
        for (workloads, change) in &works {
            let (mut chosen_with, mut chosen) = (0, vec![]);
            for &heads in &heads {
                let setting = |heads: u32, passes| {
                    // As many of each mesh.
                    let heads = heads.next_multiple_of(workloads.len() as u32);
                    Setting { workloads, heads, shared: args.shared, passes, brief: true }
                };
                let some = heads.min(CHOICE_HEADS);
                if some != chosen_with {
                    chosen_with = some;
                    let few = setting(some, draws[0]);
                    let best = techniques.iter().map(|configs| session.choose(&mut subject, configs, &few));
                    chosen = best.filter_map(Result::transpose).collect::<Result<_, _>>()?;
                }
                for &passes in &draws {
                    let setting = setting(heads, passes);
                    let heads = heads_words(setting.heads, setting.shared);
                    let cell = format!("{mesh}, {change}, {heads}{}", draws_words(passes));
                    session.measure(&mut subject, &cell, &chosen, &setting)?;
                }
            }
        }
    }
    Ok(())
}
