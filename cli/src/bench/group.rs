//! Runs in groups: those of one family differ only in what an axis shows.

use super::compare::ratios;
use super::record::{RunRecord, draws_words};
use super::stats::Stats;
use deltamorph::BatchSize;

/// Path, format, mode, poses, slots, whether instances share an animation, and draws, each as it is named.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Family([String; 7]);

impl Family {
    fn of(run: &RunRecord) -> Self {
        // Float32 poses are not named.
        let sums = if run.sums().is_empty() { String::new() } else { format!(" {}", run.sums()) };
        let shared = if run.shared { " shared".into() } else { String::new() };
        let slots = format!(" {} slots", run.slots);
        let draws = draws_words(run.draws);
        Self([run.path.clone(), format!(" {}", run.format), format!(" {}", run.mode), sums, slots, shared, draws])
    }

    /// Its name; with mode, poses and slots if they differ among `all`.
    pub fn label(&self, all: &[(Family, Vec<&RunRecord>)]) -> String {
        let told = |i: &usize| !(2..5).contains(i) || all.iter().any(|(other, _)| other.0[*i] != self.0[*i]);
        (0..7).filter(told).map(|i| self.0[i].as_str()).collect()
    }
}

/// Groups runs by `key`, in the order of the first of each.
pub fn partition<'a, K: PartialEq>(
    runs: &[&'a RunRecord],
    key: impl Fn(&RunRecord) -> K,
) -> Vec<(K, Vec<&'a RunRecord>)> {
    let mut groups: Vec<(K, Vec<&RunRecord>)> = vec![];
    for &run in runs {
        let key = key(run);
        match groups.iter_mut().find(|(other, _)| *other == key) {
            Some((_, group)) => group.push(run),
            None => groups.push((key, vec![run])),
        }
    }
    groups
}

/// The families of runs: those of one path together, otherwise in the order that they ran.
pub fn by_family<'a>(runs: &[&'a RunRecord]) -> Vec<(Family, Vec<&'a RunRecord>)> {
    partition(runs, |run| run.path.clone()).iter().flat_map(|(_, own)| partition(own, Family::of)).collect()
}

/// The runs with the most changed targets.
pub fn hardest<'a>(runs: &[&'a RunRecord]) -> Vec<&'a RunRecord> {
    let most = runs.iter().map(|run| run.changed).fold(0.0, f64::max);
    runs.iter().copied().filter(|run| run.changed == most).collect()
}

/// How many times as fast as batch 1 of its family `run` is, in rounds of both.
pub fn gain(run: &RunRecord, own: &[&RunRecord]) -> Option<Stats> {
    let single = own.iter().find(|run| run.batch_size == BatchSize::Targets(1))?;
    ratios(single, run, |round| round.ms)
}
