//! Statistics of a sample of timings.

use serde::Serialize;

/// Median, mean and spread of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stats {
    /// Half of the values are below it. Plots show it, since one late interrupt does not move it.
    pub median: f64,
    pub mean: f64,
    /// Standard error of the mean; 0 for a single value, whose spread is unknown.
    pub stderr: f64,
    pub min: f64,
    pub max: f64,
    pub n: usize,
}

impl Stats {
    /// Statistics of `values`; `None` if there are none, or one is not finite.
    pub fn of(values: &[f64]) -> Option<Self> {
        if values.is_empty() || values.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let n = sorted.len();
        let (min, max) = (sorted[0], sorted[n - 1]);
        let median = if n % 2 == 1 { sorted[n / 2] } else { sorted[n / 2 - 1].midpoint(sorted[n / 2]) };
        let count = n as f64;
        // Dividing first avoids overflow; rounding may leave the mean just outside the values.
        let mean = sorted.iter().map(|v| v / count).sum::<f64>().clamp(min, max);
        let variance = match n {
            1 => 0.0,
            _ => sorted.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0),
        };
        Some(Self { median, mean, stderr: (variance / count).sqrt(), min, max, n })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_samples() {
        let s = Stats::of(&[4.0, 1.0, 3.0, 2.0]).expect("four values");
        assert_eq!((s.median, s.mean, s.min, s.max, s.n), (2.5, 2.5, 1.0, 4.0, 4));
        assert!((s.stderr - (5.0f64 / 3.0 / 4.0).sqrt()).abs() < 1e-15);
        let one = Stats::of(&[7.0]).expect("one value");
        assert_eq!((one.median, one.mean, one.stderr, one.n), (7.0, 7.0, 0.0, 1));
        assert_eq!(Stats::of(&[9.0, 1.0, 2.0]).expect("three values").median, 2.0);
        assert_eq!((Stats::of(&[]), Stats::of(&[1.0, f64::NAN])), (None, None));
    }
}
