//! Axes: which values are marked, and where they stand.

use crate::table::sig3;

/// How values become distances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Equal steps for equal differences.
    Linear,
    /// Equal steps for equal ratios.
    Log,
}

/// An axis over a range of values.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// How values become distances.
    pub scale: Scale,
    pub lo: f64,
    pub hi: f64,
    pub ticks: Vec<f64>,
}

/// Most ticks that stand beside each other without crowding.
const MOST_TICKS: usize = 9;
/// From this ratio on, small values need a log axis to be seen.
const LOG_RATIO: f64 = 6.0;

impl Axis {
    /// An axis for lengths of time, ratios and the like: logarithmic when the values span much, else from 0.
    pub fn values(values: impl IntoIterator<Item = f64>) -> Self {
        let (lo, hi) = span(values);
        if lo > 0.0 && hi / lo >= LOG_RATIO { Self::log(lo, hi) } else { Self::from_zero(hi) }
    }

    /// A linear axis from 0.
    pub fn from_zero(hi: f64) -> Self {
        let step = step(if hi > 0.0 { hi } else { 1.0 }, 6);
        let n = (hi / step * 1.001).ceil().max(1.0);
        let ticks = (0..=n as usize).map(|i| i as f64 * step).collect();
        Self { scale: Scale::Linear, lo: 0.0, hi: n * step, ticks }
    }

    /// A logarithmic axis for the values above 0.
    pub fn log_of(values: impl IntoIterator<Item = f64>) -> Self {
        let (lo, hi) = span(values.into_iter().filter(|v| *v > 0.0));
        // Nothing above 0 leaves a decade of nothing.
        if lo > 0.0 { Self::log(lo, hi) } else { Self::log(0.1, 1.0) }
    }

    /// A logarithmic axis that holds `lo` and `hi` with some air.
    pub fn log(lo: f64, hi: f64) -> Self {
        let (lo, hi) = (lo / 1.15, hi * 1.15);
        let sets: [&[f64]; 4] = [&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0], &[1.0, 2.0, 3.0, 5.0], &[1.0, 2.0, 5.0], &[1.0]];
        let marks = |set: &[f64]| -> Vec<f64> {
            let decades = lo.log10().floor() as i32..=hi.log10().ceil() as i32;
            let all = decades.flat_map(|d| set.iter().map(move |m| m * 10f64.powi(d)));
            all.filter(|v| (lo..=hi).contains(v)).collect()
        };
        let ticks = sets.into_iter().map(marks).find(|t| t.len() <= MOST_TICKS).unwrap_or_else(|| marks(&[1.0]));
        Self { scale: Scale::Log, lo, hi, ticks }
    }

    /// An axis for counts: every one marked while they are few, logarithmic when they span much.
    pub fn counts(values: impl IntoIterator<Item = f64> + Clone) -> Self {
        let (lo, hi) = span(values.clone());
        if lo >= 1.0 && hi / lo > 30.0 {
            let mut ticks: Vec<f64> = (0..31).map(|p| 2f64.powi(p)).filter(|v| (lo..=hi).contains(v)).collect();
            while ticks.len() > MOST_TICKS {
                ticks = ticks.into_iter().step_by(2).collect();
            }
            return Self { scale: Scale::Log, lo: lo / 1.1, hi: hi * 1.1, ticks };
        }
        let step = if hi - lo <= 20.0 { 1.0 } else { step(hi - lo, 10).max(1.0) };
        let first = (lo / step).ceil() as i64;
        let mut ticks: Vec<f64> = (first..=(hi / step) as i64).map(|i| i as f64 * step).collect();
        if step > 1.0 && ticks.first().is_some_and(|&t| t > lo) {
            ticks.insert(0, lo);
        }
        // Few values: mark these rather than what is between them.
        let mut own: Vec<f64> = values.into_iter().collect();
        own.sort_by(f64::total_cmp);
        own.dedup();
        if own.len() <= MOST_TICKS && own.windows(2).all(|w| w[1] - w[0] >= 0.04 * (hi - lo)) {
            ticks = own;
        }
        let air = 0.02 * (hi - lo).max(1.0);
        Self { scale: Scale::Linear, lo: lo - air, hi: hi + air, ticks }
    }

    /// Where `value` stands: 0 at the start, 1 at the end.
    pub fn at(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.lo) / (self.hi - self.lo),
            // A value that a logarithm cannot show stands at the start.
            Scale::Log => (value.max(self.lo) / self.lo).ln() / (self.hi / self.lo).ln(),
        }
    }

    /// The label of a tick: no more digits than it needs.
    pub fn label(value: f64) -> String {
        let text = if value.abs() >= 100.0 { format!("{value:.0}") } else { sig3(value) };
        if text.contains('e') {
            return text.replace(".0e", "e");
        }
        if text.contains('.') {
            return text.trim_end_matches('0').trim_end_matches('.').to_owned();
        }
        text
    }
}

/// Space between two labels.
const LABEL_GAP: f64 = 5.0;

/// Which labels, centred at the first number and as wide as the second, can stand beside each other: the last one, and
/// before it those that leave a gap. Ascending.
pub fn fitting(labels: &[(f64, f64)]) -> Vec<bool> {
    let mut start = f64::INFINITY;
    let mut fits: Vec<bool> = labels
        .iter()
        .rev()
        .map(|(center, width)| {
            let fits = center + width / 2.0 + LABEL_GAP <= start;
            start = if fits { center - width / 2.0 } else { start };
            fits
        })
        .collect();
    fits.reverse();
    fits
}

fn span(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (lo, hi) = values.into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
    if lo <= hi { (lo, hi) } else { (0.0, 1.0) }
}

/// The step of 1, 2 or 5 that cuts `range` into at most `parts`.
fn step(range: f64, parts: usize) -> f64 {
    let raw = range / parts as f64;
    let power = 10f64.powf(raw.log10().floor());
    let multiple = [1.0, 2.0, 5.0].into_iter().find(|m| m * power >= raw * 0.999).unwrap_or(10.0);
    multiple * power
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn familiar_ranges() {
        assert_eq!(Axis::from_zero(5.9).ticks, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(Axis::values([8.0, 52.0]).scale, Scale::Log);
        assert_eq!(Axis::values([8.0, 12.0]).scale, Scale::Linear);
        let log = Axis::log_of([0.0, 1e-6, 1e-4]);
        assert!(log.scale == Scale::Log && log.lo > 8e-7 && log.ticks.len() == 9, "{log:?}");
        assert_eq!((Axis::log_of([0.0]).at(0.0), Axis::log_of([]).scale), (0.0, Scale::Log));
        assert_eq!(Axis::counts((1..=15).map(f64::from)).ticks.len(), 15);
        assert_eq!(Axis::counts([4.0, 16.0, 36.0, 72.0]).ticks, [4.0, 16.0, 36.0, 72.0]);
        assert_eq!(Axis::counts([1.0, 64.0]).ticks, [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0]);
        assert_eq!(
            ["0.5", "7", "1.5", "100", "2000", "1e-5"].map(String::from),
            [0.5, 7.0, 1.5, 100.0, 2000.0, 1e-5].map(Axis::label)
        );
    }

    #[test]
    fn labels_that_would_touch_are_left_out() {
        let at = |centers: &[f64]| fitting(&centers.iter().map(|c| (*c, 14.0)).collect::<Vec<_>>());
        assert_eq!(at(&[10.0, 30.0, 50.0]), [true; 3]);
        assert_eq!(at(&[10.0, 20.0, 30.0, 50.0]), [true, false, true, true]);
        assert_eq!(at(&[0.0, 15.0]), [false, true], "the last one stays");
        assert!(at(&[]).is_empty());
    }

    proptest! {
        #[test]
        fn ticks_are_few_and_on_the_axis(values in prop::collection::vec(1e-4..1e5f64, 1..40)) {
            for axis in [Axis::values(values.clone()), Axis::counts(values.clone())] {
                prop_assert!(axis.ticks.len() <= 22, "{:?}", axis);
                for t in &axis.ticks {
                    prop_assert!((-1e-9..=1.0 + 1e-9).contains(&axis.at(*t)), "{:?} {}", axis, t);
                }
                for v in &values {
                    prop_assert!((-1e-9..=1.0 + 1e-9).contains(&axis.at(*v)), "{:?} {}", axis, v);
                }
                prop_assert!(axis.ticks.is_sorted());
            }
        }
    }
}
