//! Every technique against every other: on made-up workloads, and on captured clips.

use super::session::{Session, Subject, dense_and_sparse};
use super::technique::{self, Chosen, candidates};
use crate::args::InputArgs;
use crate::bench::compare::CellRecord;
use crate::bench::interleave::Common;
use crate::bench::record::Skipped;
use crate::bench::run::RunRecord;
use crate::bench::setting::Setting;
use crate::bench::workload::Workload;
use crate::input::{self, Input};
use crate::output::Failure;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::PathBuf;

/// Configurations are chosen with at most this many heads: with more the choice is the same, and takes longer.
const CHOICE_HEADS: u32 = 10;
/// Targets that change where the others are still, and where the others are 0.
const FEW: usize = 8;
const ACTIVE: usize = 4;

/// A mesh, and what changes on it: the workloads, and each in words.
pub type Workloads = (Input, Vec<(Workload, String)>);

/// All, few, and few active targets × dense and sparse.
pub fn made_up(session: &Session<'_>) -> Result<Vec<Workloads>, Failure> {
    let workloads = |input: Input| {
        let (n, seed) = (input.kept.targets.len(), session.args.input.seed);
        let (few, active) = (FEW.min(n), ACTIVE.min(n));
        let works = vec![
            (Workload::random(n, n, seed), format!("all {n} changed")),
            (Workload::random(n, few, seed), format!("{few} of {n} changed")),
            (Workload::few(n, active, seed), format!("{active} non-zero of {n}")),
        ];
        (input, works)
    };
    Ok(dense_and_sparse(session)?.into_iter().map(workloads).collect())
}

/// The clips of INPUT; without INPUT, those of each set under DELTAMORPH_DATA.
pub fn captured(session: &mut Session<'_>) -> Result<Vec<Workloads>, Failure> {
    let mut list = vec![];
    for set in sets(session)? {
        let args = InputArgs { input: Some(set), head: Default::default(), ..session.args.input.clone() };
        let input = input::load(&args, true, session.out)?;
        let read = |path: &PathBuf| {
            input::clip(path, &args, &input.kept).map(|clip| (Workload::clip(&clip), clip.name.clone()))
        };
        let works = input.clips.iter().map(read).collect::<Result<_, _>>()?;
        list.push((input, works));
    }
    Ok(list)
}

/// Every technique on each of `list`, for one head and many: a cell each.
pub fn run(session: &mut Session<'_>, list: Vec<Workloads>, heads: &[u32]) -> Result<(), Failure> {
    let (all, heads) = (technique::all(session), session.args.heads_or(heads));
    for (input, works) in list {
        let mut subject = Subject::new(session, input);
        session.bar.inc_length((works.len() * heads.len()) as u64);
        for (workload, change) in &works {
            let schedule = session.schedule(if workload.changed.is_none() { Common::Frames } else { Common::Nothing });
            let mut choices: HashMap<u32, Vec<Chosen>> = HashMap::new();
            for &heads in &heads {
                let some = heads.min(CHOICE_HEADS);
                let chosen = match choices.entry(some) {
                    Entry::Occupied(known) => known.into_mut(),
                    Entry::Vacant(place) => place.insert(technique::choose(
                        session,
                        &mut subject,
                        &Setting::of_suite(workload, some),
                        &all,
                    )?),
                };
                let (mesh, plural) = (subject.input.name.clone(), if heads == 1 { "" } else { "s" });
                let cell = format!("{mesh}, {change}, {heads} head{plural}");
                let setting = Setting::of_suite(workload, heads);
                let runs = session.measure(&mut subject, &cell, &candidates(chosen, &setting), &schedule)?;
                let runs: Vec<RunRecord> = runs.into_iter().flatten().collect();
                session.suite.cells.push(CellRecord::of(&cell, [&mesh, change], heads, &runs));
                session.bar.inc(1);
            }
        }
    }
    Ok(())
}

/// The folders with clips; where there are none, what was skipped says why.
fn sets(session: &mut Session<'_>) -> Result<Vec<PathBuf>, Failure> {
    let has_clips = |folder: &PathBuf| folder.join("neutral.obj").is_file() && folder.join("weights").is_dir();
    let (sets, reason) = match (&session.args.input.input, std::env::var_os("DELTAMORPH_DATA")) {
        (Some(input), _) => (vec![input.clone()], format!("{} has no clip in weights/*.csv", input.display())),
        (None, Some(root)) => {
            let root = PathBuf::from(root);
            let unreadable = |e: std::io::Error| {
                let root = root.display();
                Failure::Failed(format!("DELTAMORPH_DATA: {root}: cannot read the folder: {e}; name the unpacked sets"))
            };
            let entries = std::fs::read_dir(&root).map_err(unreadable)?;
            let mut sets = entries.map(|e| e.map(|e| e.path())).collect::<Result<Vec<_>, _>>().map_err(unreadable)?;
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
