//! Families of configurations, and how they look in every figure.

use crate::bench::run::RunRecord;
use crate::plots::Look;
use deltamorph::UpdatePath;

/// A family of configurations that differ in what an axis shows only.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Family {
    path: String,
    format: String,
    /// What a name says where it differs among families: mode, sums, slots.
    variant: [String; 3],
    /// One animation for all heads.
    shared: bool,
}

impl Family {
    pub fn of(run: &RunRecord) -> Self {
        // Float sums go without saying.
        let sums = if run.accumulate == "float" { String::new() } else { format!(" {}", run.accumulate) };
        Self {
            path: run.path.clone(),
            format: run.format.clone(),
            variant: [format!(" {}", run.mode), sums, format!(" {} slots", run.slots)],
            shared: run.shared,
        }
    }

    /// Its name: path and format, and what else differs among `all`.
    pub fn label(&self, all: &[Family]) -> String {
        let differs = |i: &usize| all.iter().any(|other| other.variant[*i] != self.variant[*i]);
        let variant: String = (0..3).filter(differs).map(|i| self.variant[i].as_str()).collect();
        format!("{} {}{variant}{}", self.path, self.format, if self.shared { " shared" } else { "" })
    }

    /// A hue for each path; among those of its path in `all`, a variant for each family.
    pub fn look(&self, all: &[Family]) -> Look {
        let path = UpdatePath::ALL.iter().position(|path| path.name() == self.path).unwrap_or(UpdatePath::ALL.len());
        Look::new(path, all.iter().filter(|other| other.path == self.path && *other < self).count())
    }
}

/// Runs that have the same `key` together, in the order of their first.
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

/// The families of runs: those of one path together, otherwise in the order they ran.
pub fn by_family<'a>(runs: &[&'a RunRecord]) -> Vec<(Family, Vec<&'a RunRecord>)> {
    partition(runs, |run| run.path.clone()).iter().flat_map(|(_, own)| partition(own, Family::of)).collect()
}

pub fn families(runs: &[&RunRecord]) -> Vec<Family> {
    by_family(runs).into_iter().map(|(family, _)| family).collect()
}
