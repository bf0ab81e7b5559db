//! One instance and many, after Costigan et al. (MIG 2016), figures 5 and 6.

use super::FLOAT;
use super::techniques::{self, candidates, dense_and_sparse};
use crate::bench::compare::OURS;
use crate::bench::configs::Config;
use crate::bench::interleave::Common;
use crate::bench::record::{draws_words, heads_words};
use crate::bench::session::Session;
use crate::bench::subject::Subject;
use crate::bench::trial::Candidate;
use crate::bench::workload::{Setting, Workload};
use crate::output::Failure;
use deltamorph::UpdatePath;

/// Points along the axis of targets.
const POINTS: usize = 6;
/// Default crowd sizes.
const HEADS: [u32; 2] = [1, 100];
/// Targets changed per frame in the case of few changes.
const FEW: usize = 8;
/// Conditions of timing, and the expected ratio of an update for many copies to an update for one. In consecutive
/// frames, a single copy has no pause between updates, while the draws of many copies are one. Both are therefore also
/// timed at the frame rate of the many, where only the number of copies differs.
const SHARED: [(Common, &str, &str); 2] =
    [(Common::FrameRate, "at one frame rate", "0.9 to 1.1"), (Common::Nothing, "frame after frame", "")];
/// The expected gain of one crowd.
const CROWD_GOAL: &str = "3 or more";

/// Time against the number of targets kept, for one instance, many instances, and many copies of one; and the gain of a
/// crowd.
pub fn run(session: &mut Session<'_>) -> Result<(), Failure> {
    let heads = session.args.heads_or(&HEADS);
    let (one, many) = (heads[0], heads[heads.len() - 1]);
    let inputs = dense_and_sparse(session, &session.args.input)?;
    let mut subjects: Vec<Subject> = inputs.into_iter().map(|input| session.subject(input)).collect();
    let all = techniques::all(session, &UpdatePath::ALL, &FLOAT);
    let Some(main) = subjects.last_mut() else { return Ok(()) };
    let total = main.targets();
    let mut counts: Vec<usize> = (1..=POINTS).map(|i| (total * i / POINTS).max(1.min(total))).collect();
    counts.dedup();

    let random = Workload::random(total, total, session.args.input.seed);
    let passes = session.args.draws_or(1);
    let chosen = techniques::choose(session, main, &Setting::of_suite(&random, one, passes[0]), &all)?;
    session.planned += 3 * counts.len() * passes.len() + SHARED.len() * chosen.len() + 2;
    for &count in &counts {
        let mut kept = main.first_targets(count);
        let random = Workload::random(count, count, session.args.input.seed);
        for (heads, shared) in [(one, false), (many, false), (many, true)] {
            for &passes in &passes {
                let setting = Setting { shared, ..Setting::of_suite(&random, heads, passes) };
                let cell = format!("{}{}, {count} targets", heads_words(heads, shared), draws_words(passes));
                session.measure(
                    &mut kept,
                    &cell,
                    &candidates(&chosen, &setting),
                    &session.schedule(Common::Nothing),
                )?;
            }
        }
    }

    // Interleaved, so that variations of the machine's speed affect both.
    let single = Setting::of_suite(&random, 1, passes[0]);
    let copies = Setting { shared: true, ..Setting::of_suite(&random, many, passes[0]) };
    for (common, how, goal) in SHARED {
        for (name, config) in &chosen {
            let pair = [(many, &copies), (1, &single)]
                .map(|(heads, setting)| Candidate::new(&heads_words(heads, true), config, setting));
            let cell = format!("update of {name}, shared, {how}");
            session.compare_updates(main, &cell, pair, &session.schedule(common), goal)?;
        }
    }

    // One crowd against as many crowds of one instance each, recorded into one submission.
    let Some((_, config)) = chosen.into_iter().find(|(name, _)| name == OURS) else { return Ok(()) };
    for (subject, changed) in [(subjects.len() - 1, FEW.min(total)), (0, total)] {
        let subject = &mut subjects[subject];
        let random = Workload::random(subject.targets(), changed, session.args.input.seed);
        let setting = Setting::of_suite(&random, many, 0);
        let pair = [(true, format!("{many} crowds of 1")), (false, format!("1 crowd of {many}"))]
            .map(|(separate, name)| Candidate::new(&name, &Config { separate, ..config.clone() }, &setting));
        let cell = format!("{}: {changed} of {} changed, {many} heads", subject.input.name, subject.targets());
        session.compare_updates(subject, &cell, pair, &session.schedule(Common::Nothing), CROWD_GOAL)?;
    }
    Ok(())
}
