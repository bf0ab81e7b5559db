//! The chapter's figure: the gain of batching.

use crate::args::values::BatchSpec;
use crate::bench::configs::{Config, Wanted, configurations};
use crate::bench::interleave::Common;
use crate::bench::record::{Comparison, RunRecord, Skipped, batch_words, fastest};
use crate::bench::session::Session;
use crate::bench::trial::Candidate;
use crate::bench::workload::{Setting, Workload};
use crate::input::Input;
use crate::output::Failure;
use deltamorph::{BatchSize, PoseFormat, UpdateMode, UpdatePath};

/// Targets changed per frame in the case of few changes; the other case is all of them.
const FEW: usize = 8;

/// Every batch size of every dense path and format.
pub fn run(session: &mut Session<'_>, input: Input) -> Result<(), Failure> {
    let mut subject = session.subject(input);
    let incremental = |path: &UpdatePath| path.default_mode() == UpdateMode::Incremental;
    let wanted = Wanted {
        paths: &session.args.update.paths_or(&UpdatePath::ALL).into_iter().filter(incremental).collect::<Vec<_>>(),
        formats: &session.args.update.formats,
        poses: &[PoseFormat::Float32],
        sizes: &[BatchSpec::Range(1, None)],
        ..Wanted::default()
    };
    let (configs, skipped) = configurations(&wanted, session.args, session.machine.gpu.as_ref());
    skipped.into_iter().for_each(|s| session.skip(s));
    // Paths without batches are left out.
    let configs: Vec<Config> = configs.into_iter().filter(|c| c.batch_max.is_some()).collect();
    if configs.is_empty() {
        let reason = "takes --paths and --formats that have batches: compute, feedback, vertex-store; float32, snorm16";
        session.skip(Skipped { what: "suite chapter".into(), reason: reason.into() });
    }
    let mut changes = vec![FEW.min(subject.targets()), subject.targets()];
    changes.dedup();
    let families = configs.chunk_by(|a, b| (a.desc.path, a.format) == (b.desc.path, b.format));
    session.planned += changes.len() * families.clone().count();
    for &changed in &changes {
        let random = Workload::random(subject.targets(), changed, session.args.input.seed);
        let heads = session.args.heads_or(&[1])[0];
        let setting = Setting { drawn: false, ..Setting::of_suite(&random, heads) };
        for family in families.clone() {
            let name = format!("{} {}", family[0].desc.path.name(), family[0].format.name());
            let candidates: Vec<Candidate<'_>> =
                family.iter().map(|c| Candidate::new(&batch_words(c.desc.batch), c, &setting)).collect();
            let cell = format!("{name}, {changed} of {} changed", subject.targets());
            let runs = session.measure(&mut subject, &cell, &candidates, &session.schedule(Common::Nothing))?;
            session.suite.comparisons.extend(gain(&cell, &runs));
        }
    }
    Ok(())
}

/// Compares batch 1 with the fastest batch size.
fn gain(cell: &str, runs: &[Option<RunRecord>]) -> Option<Comparison> {
    let right = || runs.iter().flatten().filter(|r| r.counts());
    let one = right().find(|r| r.batch_size == BatchSize::Targets(1))?;
    let best = fastest(right())?;
    let names = [one, best].map(|run| batch_words(run.batch_size));
    Comparison::new(cell, [one, best], names, "")
}
