//! Axes: ticks, labels, and positions of values.

use super::{ALL, Axes, Series};
use crate::table::sig3;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;
use std::ops::Range;

/// An axis over a range of values.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Logarithmic; else linear.
    log: bool,
    lo: f64,
    hi: f64,
    /// Position where numbers end: 1, or before "all".
    end: f64,
    /// Ticks with their labels; a label is empty if there is no room for it.
    ticks: Vec<(f64, String)>,
}

/// Most ticks of measures.
const MOST_TICKS: usize = 9;
/// Most ticks of counts, which have one or two digits.
const MOST_COUNTS: usize = 21;
/// Ratios above which small values and counts are legible only on a log axis.
const LOG_RATIO: f64 = 6.0;
const LOG_RATIO_OF_COUNTS: f64 = 30.0;
/// Position where numbers end if "all" follows.
const END: f64 = 0.92;
/// Width of a character of a label, in points, and of a gap between labels.
const CHARACTER: f64 = 7.2;

impl Axis {
    /// The axes of a line chart. Error bars that reach far beyond all points are cut off at their ends.
    pub fn of_lines(axes: Axes, all: &[Series]) -> [Self; 2] {
        let points = || all.iter().flat_map(|series| &series.points);
        let (x, y) = (points().map(|p| p.x), points().map(|p| p.y));
        match axes {
            Axes::Counts => [Self::counts(x), Self::values(y)],
            Axes::CountsFromZero => [Self::counts(x), Self::from_zero(y.fold(0.0, f64::max))],
            Axes::Values => [Self::values(x), Self::values(y)],
        }
    }

    /// The name of the axis, which says whether it is logarithmic.
    pub fn named(&self, name: &str) -> String {
        if self.log { format!("{name} (log scale)") } else { name.to_owned() }
    }

    /// `value`, or the end of the axis that it is beyond.
    pub fn within(&self, value: f64) -> f64 {
        value.clamp(self.lo, self.hi)
    }

    /// An axis for measures: logarithmic if the values above 0 span a large ratio, with 0 at the start; else linear
    /// from 0.
    pub fn values(values: impl IntoIterator<Item = f64>) -> Self {
        let (lo, hi) = span(values.into_iter().filter(|v| *v > 0.0));
        if lo <= 0.0 || hi / lo < LOG_RATIO {
            return Self::from_zero(hi);
        }
        let (lo, hi) = (lo / 1.15, hi * 1.15);
        Self::new(true, lo, hi, 1.0, &log_ticks(lo, hi))
    }

    /// A linear axis from 0.
    pub fn from_zero(hi: f64) -> Self {
        let hi = if hi > 0.0 { 1.05 * hi } else { 1.0 };
        Self::new(false, 0.0, hi, 1.0, &marks(0.0, hi, MOST_TICKS))
    }

    /// An axis for counts: ticks at the values if they are few; logarithmic if they span a large ratio; [`ALL`] is
    /// labelled "all".
    pub fn counts(values: impl IntoIterator<Item = f64>) -> Self {
        let (mut own, beyond): (Vec<f64>, Vec<f64>) = values.into_iter().partition(|v| v.is_finite());
        own.sort_by(f64::total_cmp);
        own.dedup();
        let (lo, hi) = span(own.iter().copied());
        let end = if beyond.is_empty() { 1.0 } else { END };
        let log = lo >= 1.0 && hi / lo > LOG_RATIO_OF_COUNTS;
        let ticks = if own.len() <= MOST_TICKS {
            own
        } else if log {
            log_ticks(lo, hi)
        } else {
            std::iter::once(lo).chain(marks(lo, hi, MOST_COUNTS).into_iter().filter(|mark| *mark > lo)).collect()
        };
        let air = 0.02 * (hi - lo).max(1.0);
        let (lo, hi) = if log { (lo / 1.1, hi * 1.1) } else { (lo - air, hi + air) };
        Self::new(log, lo, hi, end, &ticks)
    }

    fn new(log: bool, lo: f64, hi: f64, end: f64, ticks: &[f64]) -> Self {
        let all = (end < 1.0).then(|| (ALL, "all".into()));
        let ticks = ticks.iter().map(|&tick| (tick, label(tick))).chain(all).collect();
        Self { log, lo, hi, end, ticks }
    }

    /// Keeps the labels that fit on a horizontal axis of `length` points: the last one, and earlier ones that leave a
    /// gap.
    pub fn fitting(mut self, length: f64) -> Self {
        let mut start = f64::INFINITY;
        let places: Vec<f64> = self.ticks.iter().map(|(tick, _)| length * self.at(*tick)).collect();
        for ((_, label), at) in self.ticks.iter_mut().zip(places).rev() {
            let half = CHARACTER / 2.0 * label.chars().count() as f64;
            if at + half + CHARACTER / 2.0 <= start {
                start = at - half;
            } else {
                label.clear();
            }
        }
        self
    }

    /// Position of `value`: 0 at the start, 1 at the end.
    fn at(&self, value: f64) -> f64 {
        if value == ALL {
            return 1.0 - 0.3 * (1.0 - self.end);
        }
        // Values without a logarithm are at the start.
        let part = if self.log {
            (value.max(self.lo) / self.lo).ln() / (self.hi / self.lo).ln()
        } else {
            (value - self.lo) / (self.hi - self.lo)
        };
        self.end * part
    }

    /// The label of a tick; empty if there is no room for one.
    pub fn label(&self, value: f64) -> String {
        self.ticks.iter().find(|(tick, _)| *tick == value).map_or(String::new(), |(_, label)| label.clone())
    }
}

impl Ranged for Axis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (start, end): (i32, i32)) -> i32 {
        start + (f64::from(end - start) * self.at(*value)).round() as i32
    }

    fn key_points<H: KeyPointHint>(&self, hint: H) -> Vec<f64> {
        if hint.weight().allow_light_points() { vec![] } else { self.ticks.iter().map(|(tick, _)| *tick).collect() }
    }

    fn range(&self) -> Range<f64> {
        self.lo..self.hi
    }
}

/// Formats `value` without superfluous digits.
fn label(value: f64) -> String {
    let text = if value.abs() >= 100.0 { format!("{value:.0}") } else { sig3(value) };
    match text.contains('.') && !text.contains('e') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text.replace(".0e", "e"),
    }
}

fn span(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (lo, hi) = values.into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
    if lo <= hi { (lo, hi) } else { (0.0, 1.0) }
}

/// Multiples of 1, 2 or 5 times a power of ten in a range, at most `most`.
fn marks(lo: f64, hi: f64, most: usize) -> Vec<f64> {
    RangedCoordf64::from(lo..hi).key_points(most)
}

/// Ticks in each decade, as many as fit.
fn log_ticks(lo: f64, hi: f64) -> Vec<f64> {
    let sets: [&[f64]; 4] = [&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0], &[1.0, 2.0, 3.0, 5.0], &[1.0, 2.0, 5.0], &[1.0]];
    let marks = |set: &[f64]| -> Vec<f64> {
        let decades = lo.log10().floor() as i32..=hi.log10().ceil() as i32;
        let all = decades.flat_map(|d| set.iter().map(move |m| m * 10f64.powi(d)));
        all.filter(|v| (lo..=hi).contains(v)).collect()
    };
    sets.into_iter().map(marks).find(|ticks| ticks.len() <= MOST_TICKS).unwrap_or_else(|| marks(&[1.0]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn labels(axis: &Axis) -> String {
        axis.ticks.iter().map(|(_, label)| label.as_str()).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn familiar_ranges() {
        for (axis, log, expected) in [
            (Axis::from_zero(5.9), false, "0 1 2 3 4 5 6"),
            (Axis::from_zero(0.0), false, "0 0.2 0.4 0.6 0.8 1"),
            (Axis::values([8.0, 12.0]), false, "0 2 4 6 8 10 12"),
            (Axis::values([8.0, 52.0]), true, "7 10 15 20 30 40 50"),
            (Axis::values([0.0, 1e-6, 1e-4]), true, "1e-6 2e-6 3e-6 5e-6 1e-5 2e-5 3e-5 5e-5 1e-4"),
            (Axis::values([]), false, "0 0.2 0.4 0.6 0.8 1"),
            (Axis::counts((1..=12).map(f64::from)), false, "1 2 3 4 5 6 7 8 9 10 11 12"),
            (Axis::counts([4.0, 16.0, 36.0, 72.0]), false, "4 16 36 72"),
            (Axis::counts([1.0, 8.0, ALL]), false, "1 8 all"),
            (Axis::counts([1.0, 64.0]), true, "1 64"),
            // Labels that would touch are left out; the last one stays.
            (Axis::counts([1.0, 2.0, 4.0, 8.0, 700.0, 720.0]), true, "1 2 4 8  720"),
        ] {
            let axis = axis.fitting(450.0);
            assert_eq!((axis.log, labels(&axis).as_str()), (log, expected), "{axis:?}");
        }
        let narrow = Axis::counts((1..=12).map(f64::from)).fitting(120.0);
        assert_eq!(labels(&narrow), " 2  4  6  8  10  12");
        assert_eq!(Axis::values([0.0, 1.0, 9.0]).at(0.0), 0.0);
        assert_eq!([0.5, 7.0, 1.5, 100.0, 2000.0, 1e-5].map(label), ["0.5", "7", "1.5", "100", "2000", "1e-5"]);
    }

    proptest! {
        #[test]
        fn ticks_are_few_and_on_the_axis(values in prop::collection::vec(1e-4..1e5f64, 1..40)) {
            for axis in [Axis::values(values.clone()), Axis::counts(values.clone())] {
                prop_assert!(axis.ticks.len() <= 22, "{:?}", axis);
                for value in values.iter().chain(axis.ticks.iter().map(|(tick, _)| tick)) {
                    prop_assert!((-1e-9..=1.0 + 1e-9).contains(&axis.at(*value)), "{:?} {}", axis, value);
                }
                prop_assert!(axis.ticks.is_sorted());
            }
        }
    }
}
