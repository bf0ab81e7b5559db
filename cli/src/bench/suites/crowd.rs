//! One head and many, after Costigan et al. (MIG 2016), figures 5 and 6.

use super::session::{Session, Subject, dense_and_sparse};
use super::technique;
use crate::bench::compare::{Comparison, OURS};
use crate::bench::interleave::{Candidate, Common};
use crate::bench::run::heads_words;
use crate::bench::setting::{Config, Setting};
use crate::bench::workload::Workload;
use crate::output::Failure;

/// Points along the axis of targets.
const POINTS: usize = 6;
/// Heads of the crowd, unless told otherwise.
const HEADS: [u32; 2] = [1, 100];
/// Targets changed per frame where few change.
const FEW: usize = 8;
/// How a shared animation is timed, and what an update for many copies may cost, compared with one for one. Frame after
/// frame, the one copy has no pause between its updates, while the draws of the many are one: so both are timed at the
/// frame rate of the many too, where nothing but the copies differs.
const SHARED: [(Common, &str, &str); 2] =
    [(Common::FrameRate, "at one frame rate", "0.9 to 1.1"), (Common::Nothing, "frame after frame", "")];
/// What one crowd has to gain.
const CROWD_GOAL: &str = "3 or more";

/// Time against the number of targets kept, for one head, many, and many copies of one; and what a crowd saves.
pub fn run(session: &mut Session<'_>) -> Result<(), Failure> {
    let heads = session.args.heads_or(&HEADS);
    let (one, many) = (heads[0], heads[heads.len() - 1]);
    let mut subjects: Vec<Subject> = vec![];
    for input in dense_and_sparse(session)? {
        subjects.push(Subject::new(session, input));
    }
    let all = technique::all(session);
    let Some(main) = subjects.last_mut() else { return Ok(()) };
    let total = main.targets();
    let mut counts: Vec<usize> = (1..=POINTS).map(|i| (total * i / POINTS).max(1.min(total))).collect();
    counts.dedup();
    session.bar.inc_length(3 * counts.len() as u64 + SHARED.len() as u64 + 2);

    let random = Workload::random(total, total, session.args.input.seed);
    let chosen = technique::choose(session, main, &drawn(&random, one, false), &all)?;
    for &count in &counts {
        let mut kept = main.first_targets(count);
        let random = Workload::random(count, count, session.args.input.seed);
        for (heads, shared) in [(one, false), (many, false), (many, true)] {
            let setting = drawn(&random, heads, shared);
            let cell = format!("{}, {count} targets", heads_words(heads, shared));
            session.measure(&mut kept, &cell, &candidates(&chosen, &setting), &session.schedule(Common::Nothing))?;
            session.bar.inc(1);
        }
    }

    // In turns, so that the machine's own ups and downs hit both.
    let (single, copies) = (drawn(&random, 1, false), drawn(&random, many, true));
    for (common, how, goal) in SHARED {
        for (name, config) in &chosen {
            let names = [heads_words(many, true), heads_words(1, true)];
            let pair = [Candidate::new(&names[0], config, &copies), Candidate::new(&names[1], config, &single)];
            let cell = format!("update of {name}, shared, {how}");
            if let [Some(a), Some(b)] = &session.measure(main, &cell, &pair, &session.schedule(common))?[..] {
                session.suite.comparisons.extend(Comparison::new(&cell, [a, b], names, |round| round.update_ms, goal));
            }
        }
        session.bar.inc(1);
    }

    let Some((_, config)) = chosen.into_iter().find(|(name, _)| name == OURS) else { return Ok(()) };
    let cases = [(subjects.len() - 1, FEW.min(total)), (0, total)];
    for (subject, changed) in cases {
        let gain = crowd_gain(session, &mut subjects[subject], &config, changed, many)?;
        session.suite.comparisons.extend(gain);
        session.bar.inc(1);
    }
    Ok(())
}

/// One crowd against as many crowds of one head each, recorded into one submission.
fn crowd_gain(
    session: &mut Session<'_>,
    subject: &mut Subject,
    config: &Config,
    changed: usize,
    heads: u32,
) -> Result<Option<Comparison>, Failure> {
    let random = Workload::random(subject.targets(), changed, session.args.input.seed);
    let setting = Setting { drawn: false, ..drawn(&random, heads, false) };
    let names = [format!("{heads} crowds of 1"), format!("1 crowd of {heads}")];
    let pair = [(true, &names[0]), (false, &names[1])]
        .map(|(separate, name)| Candidate::new(name, &Config { separate, ..config.clone() }, &setting));
    let cell = format!("{}: {changed} of {} changed, {heads} heads", subject.input.name, subject.targets());
    let runs = session.measure(subject, &cell, &pair, &session.schedule(Common::Nothing))?;
    let [Some(singles), Some(crowd)] = &runs[..] else { return Ok(None) };
    Ok(Comparison::new(&cell, [singles, crowd], names, |round| round.update_ms, CROWD_GOAL))
}

fn drawn(workload: &Workload, heads: u32, shared: bool) -> Setting<'_> {
    Setting { workload, heads, shared, drawn: true, brief: true }
}

fn candidates<'a>(chosen: &[(String, Config)], setting: &'a Setting<'a>) -> Vec<Candidate<'a>> {
    chosen.iter().map(|(name, config)| Candidate::new(name, config, setting)).collect()
}
