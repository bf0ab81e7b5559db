//! Families of configurations, and how they look in every figure.

use crate::bench::run::RunRecord;
use crate::plots::Marker;
use deltamorph::UpdatePath;
use plotters::prelude::RGBColor;

/// A family of configurations that differ in what an axis shows only.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Family {
    pub path: String,
    pub format: String,
    pub mode: String,
    pub accumulate: String,
    pub slots: u32,
    /// One animation for all heads.
    pub shared: bool,
}

impl Family {
    pub fn of(run: &RunRecord) -> Self {
        Self {
            path: run.path.clone(),
            format: run.format.clone(),
            mode: run.mode.clone(),
            accumulate: run.accumulate.clone(),
            slots: run.slots,
            shared: run.shared,
        }
    }

    /// Its name: path and format, and what else differs among `all`.
    pub fn label(&self, all: &[Family]) -> String {
        let mut label = format!("{} {}", self.path, self.format);
        if all.iter().any(|other| other.mode != self.mode) {
            label += &format!(" {}", self.mode);
        }
        // Float sums go without saying.
        if self.accumulate != "float" && all.iter().any(|other| other.accumulate != self.accumulate) {
            label += &format!(" {}", self.accumulate);
        }
        if all.iter().any(|other| other.slots != self.slots) {
            label += &format!(" {} slots", self.slots);
        }
        label + if self.shared { " shared" } else { "" }
    }

    /// Colour and marker among `all`: the colour says the path, the marker the format, and the shade the format too, or
    /// sums and mode where those vary.
    pub fn style(&self, all: &[Family]) -> (RGBColor, Marker) {
        let path = UpdatePath::ALL.iter().position(|path| path.name() == self.path).unwrap_or(COLORS.len());
        let [dark, light] = COLORS[path % COLORS.len()];
        let format = rank(all, |f| f.format.clone(), self);
        let variant_of = |f: &Family| (f.mode.clone(), f.accumulate != "float", f.slots, f.shared);
        let variant = rank(all, variant_of, self);
        let one_variant = all.iter().all(|f| variant_of(f) == variant_of(self));
        let shade = if one_variant { format } else { variant };
        (if shade % 2 == 0 { dark } else { light }, MARKERS[(format + variant / 2) % MARKERS.len()])
    }
}

/// Dark and light, for the paths in their order: told apart by people who see few colours, too (Okabe and Ito).
pub const COLORS: [[RGBColor; 2]; 9] = [
    [RGBColor(0x00, 0x5f, 0x9e), RGBColor(0x56, 0xb4, 0xe9)],
    [RGBColor(0xc4, 0x4e, 0x00), RGBColor(0xe6, 0x9f, 0x00)],
    [RGBColor(0xa8, 0x4b, 0x86), RGBColor(0xdd, 0x9c, 0xc4)],
    [RGBColor(0x00, 0x7a, 0x5a), RGBColor(0x5f, 0xc8, 0xa4)],
    [RGBColor(0x5b, 0x4b, 0xb0), RGBColor(0xa9, 0x9f, 0xe0)],
    [RGBColor(0x4a, 0x4f, 0x59), RGBColor(0xa0, 0xa6, 0xb1)],
    [RGBColor(0x8c, 0x6a, 0x00), RGBColor(0xd9, 0xc0, 0x4a)],
    [RGBColor(0x00, 0x7f, 0x86), RGBColor(0x6a, 0xc9, 0xce)],
    [RGBColor(0xa1, 0x2a, 0x2a), RGBColor(0xe2, 0x93, 0x8c)],
];
pub const MARKERS: [Marker; 4] = [Marker::Circle, Marker::Triangle, Marker::Square, Marker::Diamond];

/// Position of each different value of `key` among those of `families`.
fn rank<T: Ord>(families: &[Family], key: impl Fn(&Family) -> T, of: &Family) -> usize {
    let mut seen: Vec<T> = families.iter().map(&key).collect();
    seen.sort();
    seen.dedup();
    seen.binary_search(&key(of)).unwrap_or(0)
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
