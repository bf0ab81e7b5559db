//! The techniques that compete: every update path in its best configuration, and two that rebuild every frame.

use super::session::{Session, Subject};
use crate::args::values::BatchSpec;
use crate::bench::configs::{Wanted, configurations};
use crate::bench::interleave::{Candidate, Common, Schedule};
use crate::bench::record::Skipped;
use crate::bench::setting::{Config, Setting};
use crate::output::Failure;
use deltamorph::{BatchSize, DeltaFormat, UpdateDesc, UpdateMode, UpdatePath};

/// A technique, and the configurations that the best one is chosen from.
pub struct Technique {
    /// The path, and the mode where it is not the path's own.
    name: String,
    /// At least one.
    configs: Vec<Config>,
}

/// The name of a technique, and its fastest configuration.
pub type Chosen = (String, Config);

/// All of `chosen` in one setting.
pub fn candidates<'a>(chosen: &[Chosen], setting: &'a Setting<'a>) -> Vec<Candidate<'a>> {
    chosen.iter().map(|(name, config)| Candidate::new(name, config, setting)).collect()
}

/// Batch sizes to choose from: few are enough, since beyond 8 the gain is small.
const SIZES: [BatchSpec; 3] = [BatchSpec::Size(8), BatchSpec::Size(16), BatchSpec::All];
/// The paths asked for, or every path that the command line knows.
pub fn paths(session: &Session<'_>) -> Vec<UpdatePath> {
    session.args.update.paths_or(&UpdatePath::ALL)
}

/// The formats asked for, or all.
pub fn formats(session: &Session<'_>) -> Vec<DeltaFormat> {
    let named = &session.args.update.formats;
    if named.is_empty() { DeltaFormat::ALL.to_vec() } else { named.clone() }
}

/// Every technique that can run; those that cannot become entries of what was skipped.
pub fn all(session: &mut Session<'_>) -> Vec<Technique> {
    let mut techniques = vec![];
    for path in paths(session) {
        let sizes = if path.takes_all_targets() { &SIZES[..] } else { &[BatchSpec::Max] };
        let mut modes = vec![(path.default_mode(), sizes, "")];
        // Rebuilding every frame is a technique of its own on two paths: in compute passes (Godot, PlayCanvas), and in
        // vertex passes one target after the other (Godot's compatibility renderer).
        match path {
            UpdatePath::Compute => modes.push((UpdateMode::Rebuild, sizes, " rebuild")),
            UpdatePath::Feedback => modes.push((UpdateMode::Rebuild, &[BatchSpec::Size(1)], " rebuild at batch 1")),
            _ => {}
        }
        for (mode, sizes, suffix) in modes {
            let wanted = Wanted {
                paths: vec![path],
                paths_named: !session.args.update.paths.is_empty(),
                formats: &formats(session),
                sums: &[UpdateDesc::new(path, BatchSize::All).accumulate],
                modes: vec![mode],
                sizes,
                ..Wanted::default()
            };
            let name = format!("{}{suffix}", path.name());
            let (configs, skipped) = configurations(&wanted, &session.args.update, session.machine.gpu.as_ref());
            skipped.into_iter().for_each(|s| session.skip(Skipped { what: name.clone(), ..s }));
            if !configs.is_empty() {
                techniques.push(Technique { name, configs });
            }
        }
    }
    techniques
}

/// The fastest configuration of each technique in a short run; none where all are refused.
pub fn choose(
    session: &mut Session<'_>,
    subject: &mut Subject,
    setting: &Setting<'_>,
    techniques: &[Technique],
) -> Result<Vec<Chosen>, Failure> {
    let schedule =
        Schedule { frames: 6, rounds: 3, limit: Some(session.args.time_limit() / 20), common: Common::Nothing };
    let mut chosen = vec![];
    for technique in techniques {
        session.bar.set_message(format!("choosing the best {}", technique.name));
        if let [config] = technique.configs.as_slice() {
            chosen.push((technique.name.clone(), config.clone()));
            continue;
        }
        let rivals: Vec<Chosen> = technique.configs.iter().map(|c| (technique.name.clone(), c.clone())).collect();
        let outcomes = session.interleave(subject, &candidates(&rivals, setting), &schedule)?;
        let mut best = f64::INFINITY;
        let mut fastest = None;
        for (outcome, rival) in outcomes.into_iter().zip(rivals) {
            match outcome {
                Ok(run) if run.counts() && run.median() < best => (best, fastest) = (run.median(), Some(rival)),
                Ok(run) if run.verified => {}
                // Wrong: that has to be seen, whatever the others do.
                Ok(run) => session.keep("choice", &technique.name, run),
                Err(refused) => session.skip(refused),
            }
        }
        chosen.extend(fastest);
    }
    Ok(chosen)
}
