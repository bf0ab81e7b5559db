//! Every technique against every other: on made-up workloads, and on captured clips.

use super::Lab;
use super::subject::{Subject, dense_and_sparse};
use super::technique::{self, Technique};
use crate::args::InputArgs;
use crate::bench::compare::{CellRecord, SuiteRecord};
use crate::bench::race::{Entrant, Tempo};
use crate::bench::record::Skipped;
use crate::bench::setting::{Config, Setting};
use crate::bench::workload::Workload;
use crate::input::{self, Input};
use crate::output::Failure;
use std::collections::HashMap;
use std::path::PathBuf;

/// Heads, unless told otherwise.
const HEADS: [u32; 3] = [1, 10, 100];
/// Configurations are chosen with at most this many heads: with more the choice is the same, and takes longer.
const CHOICE_HEADS: u32 = 10;
/// Targets that change where the others are still, and where the others are 0.
const FEW: usize = 8;
const ACTIVE: usize = 4;

/// All, few, and few active targets × dense and sparse × heads.
pub fn techniques(lab: &mut Lab<'_>) -> Result<SuiteRecord, Failure> {
    let mut suite = SuiteRecord { name: "techniques".into(), ..SuiteRecord::default() };
    let all = technique::all(lab);
    let heads = lab.args.heads_or(&HEADS);
    let subjects = dense_and_sparse(lab)?;
    lab.bar.inc_length((subjects.len() * 3 * heads.len()) as u64);
    for mut subject in subjects {
        let (n, seed) = (subject.targets(), lab.args.input.seed);
        let (few, active) = (FEW.min(n), ACTIVE.min(n));
        for (workload, change) in [
            (Workload::random(n, n, seed), format!("all {n} changed")),
            (Workload::random(n, few, seed), format!("{few} of {n} changed")),
            (Workload::few(n, active, seed), format!("{active} non-zero of {n}")),
        ] {
            suite.cells.extend(compare(lab, &mut subject, &workload, &change, &heads, &all)?);
        }
    }
    Ok(suite)
}

pub struct ClipSet {
    input: Input,
    clips: Vec<Workload>,
}

/// Read the clips of INPUT; without INPUT, those of each set under DELTAMORPH_DATA. Before anything is measured: a set
/// that cannot be used is not to cost what was measured before it.
pub fn clip_sets(lab: &mut Lab<'_>) -> Result<Vec<ClipSet>, Failure> {
    let mut list = vec![];
    for set in sets(lab)? {
        let args = InputArgs { input: Some(set), head: Default::default(), ..lab.args.input.clone() };
        let input = input::load(&args, true, lab.out)?;
        let read = |path: &PathBuf| input::clip(path, &args, &input.kept).map(|clip| Workload::clip(&clip));
        let clips = input.clips.iter().map(read).collect::<Result<_, _>>()?;
        list.push(ClipSet { input, clips });
    }
    Ok(list)
}

/// Every technique on these clips.
pub fn clips(lab: &mut Lab<'_>, sets: Vec<ClipSet>) -> Result<SuiteRecord, Failure> {
    let mut suite = SuiteRecord { name: "clips".into(), ..SuiteRecord::default() };
    let all = technique::all(lab);
    let heads = lab.args.heads_or(&[1]);
    for ClipSet { input, clips } in sets {
        let mut subject = Subject::new(lab, input);
        lab.bar.inc_length((clips.len() * heads.len()) as u64);
        for clip in &clips {
            suite.cells.extend(compare(lab, &mut subject, clip, &clip.name, &heads, &all)?);
        }
    }
    Ok(suite)
}

/// The folders with clips; where there are none, what was skipped says why.
fn sets(lab: &mut Lab<'_>) -> Result<Vec<PathBuf>, Failure> {
    let has_clips = |folder: &PathBuf| folder.join("neutral.obj").is_file() && folder.join("weights").is_dir();
    let (sets, reason) = match (&lab.args.input.input, std::env::var_os("DELTAMORPH_DATA")) {
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
        lab.skip(Skipped { what: "suite clips".into(), reason });
    }
    Ok(sets)
}

/// A cell for each number of heads.
fn compare(
    lab: &mut Lab<'_>,
    subject: &mut Subject,
    workload: &Workload,
    change: &str,
    heads: &[u32],
    techniques: &[Technique],
) -> Result<Vec<CellRecord>, Failure> {
    let setting = |heads| Setting { workload, heads, shared: false, drawn: true, brief: true };
    let tempo = if workload.changed.is_none() { Tempo::SameFrames } else { Tempo::Own };
    let mut choices: HashMap<u32, Vec<(String, Config)>> = HashMap::new();
    let mut cells = vec![];
    for &heads in heads {
        let some = heads.min(CHOICE_HEADS);
        if let std::collections::hash_map::Entry::Vacant(place) = choices.entry(some) {
            place.insert(technique::choose(lab, subject, &setting(some), techniques)?);
        }
        let setting = setting(heads);
        let entrant = |(name, config): &(String, Config)| Entrant {
            what: name.clone(),
            config: config.clone(),
            setting: &setting,
        };
        let entrants: Vec<Entrant<'_>> = choices[&some].iter().map(entrant).collect();
        let plural = if heads == 1 { "" } else { "s" };
        let cell = format!("{}, {}, {heads} head{plural}", subject.input.name, change);
        let runs = lab.measure(subject, &cell, &entrants, &lab.pace(tempo))?;
        let runs: Vec<_> = runs.into_iter().flatten().collect();
        cells.push(CellRecord::of(&cell, [&subject.input.name, change], heads, &runs));
        lab.bar.inc(1);
    }
    Ok(cells)
}
