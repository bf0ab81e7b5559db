//! Families of configurations, and how they look in every figure.

use super::record::RunRecord;
use crate::plots::canvas::Marker;
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

    /// Its name: path and format, and what else the report varies.
    pub fn label(&self, all: &[Family]) -> String {
        let varies = |f: fn(&Family) -> &dyn std::fmt::Debug| {
            all.iter().any(|other| format!("{:?}", f(other)) != format!("{:?}", f(self)))
        };
        let mut label = format!("{} {}", self.path, self.format);
        if varies(|f| &f.mode) {
            label += &format!(" {}", self.mode);
        }
        // Float sums go without saying.
        if varies(|f| &f.accumulate) && self.accumulate != "float" {
            label += &format!(" {}", self.accumulate);
        }
        if varies(|f| &f.slots) {
            label += &format!(" {} slots", self.slots);
        }
        if self.shared {
            label += " shared";
        }
        label
    }
}

/// Colours by path, dark and light by format, or by sums and mode where those vary: told apart by people who see few
/// colours, too (Okabe and Ito).
const COLORS: [(&str, [RGBColor; 2]); 3] = [
    ("feedback", [RGBColor(0x00, 0x5f, 0x9e), RGBColor(0x56, 0xb4, 0xe9)]),
    ("compute", [RGBColor(0xc4, 0x4e, 0x00), RGBColor(0xe6, 0x9f, 0x00)]),
    ("cpu", [RGBColor(0x00, 0x7a, 0x5a), RGBColor(0x5f, 0xc8, 0xa4)]),
];
/// For paths without a colour of their own.
const MORE_COLORS: [[RGBColor; 2]; 6] = [
    [RGBColor(0xa8, 0x4b, 0x86), RGBColor(0xdd, 0x9c, 0xc4)],
    [RGBColor(0x5b, 0x4b, 0xb0), RGBColor(0xa9, 0x9f, 0xe0)],
    [RGBColor(0x4a, 0x4f, 0x59), RGBColor(0xa0, 0xa6, 0xb1)],
    [RGBColor(0x8c, 0x6a, 0x00), RGBColor(0xd9, 0xc0, 0x4a)],
    [RGBColor(0x00, 0x7f, 0x86), RGBColor(0x6a, 0xc9, 0xce)],
    [RGBColor(0xa1, 0x2a, 0x2a), RGBColor(0xe2, 0x93, 0x8c)],
];
const MARKERS: [Marker; 4] = [Marker::Circle, Marker::Triangle, Marker::Square, Marker::Diamond];

/// Position of each different value of `key` among those of `families`.
fn rank<T: Ord + Clone>(families: &[Family], key: impl Fn(&Family) -> T, of: &Family) -> usize {
    let mut seen: Vec<T> = families.iter().map(&key).collect();
    seen.sort();
    seen.dedup();
    seen.binary_search(&key(of)).unwrap_or(0)
}

/// Colour and marker of `family` among `all`: the marker says the format.
pub fn look(family: &Family, all: &[Family]) -> (RGBColor, Marker) {
    let own = COLORS.iter().find(|(path, _)| *path == family.path).map(|(_, pair)| *pair);
    let unnamed: Vec<Family> = all.iter().filter(|f| COLORS.iter().all(|(p, _)| *p != f.path)).cloned().collect();
    let pair = own.unwrap_or_else(|| MORE_COLORS[rank(&unnamed, |f| f.path.clone(), family) % MORE_COLORS.len()]);
    let format = rank(all, |f| f.format.clone(), family);
    let variant_of = |f: &Family| (f.mode.clone(), f.accumulate != "float", f.slots, f.shared);
    let variant = rank(all, variant_of, family);
    let one_variant = all.iter().all(|f| variant_of(f) == variant_of(family));
    let shade = if one_variant { format } else { variant };
    (pair[shade % 2], MARKERS[(format + variant / 2) % MARKERS.len()])
}

/// The families in `runs`: those of one path together, otherwise in the order they ran.
pub fn families(runs: &[&RunRecord]) -> Vec<Family> {
    let mut all: Vec<Family> = Vec::new();
    for family in runs.iter().map(|r| Family::of(r)) {
        if !all.contains(&family) {
            all.push(family);
        }
    }
    let seen = all.clone();
    all.sort_by_key(|f| seen.iter().position(|s| s.path == f.path));
    all
}
