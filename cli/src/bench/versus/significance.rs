//! Whether two samples of times differ, and by which factor: nothing is assumed about their distribution but that both
//! have the same shape up to that factor.

use crate::bench::stats::Stats;
use std::f64::consts::FRAC_1_SQRT_2;

/// How often an interval may miss the true ratio, and a difference be claimed where there is none.
pub const ALPHA: f64 = 0.05;
/// Below as many values no interval of ranks has an end.
const LEAST: usize = 4;
/// Beyond as many the exact distribution takes long; no report of ours has them.
const MOST: usize = 32;

/// A ratio of two times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ratio {
    /// Of the medians.
    pub ratio: f64,
    /// The 95% confidence interval.
    pub low: f64,
    pub high: f64,
    /// Probability of a difference at least as clear where there is none.
    pub p: f64,
}

/// `b` over `a` by ranks: the exact test of Wilcoxon, Mann and Whitney (midranks where values are equal), and the
/// interval of Moses that belongs to it, between two of the sorted ratios of every value to every value. `None` for
/// samples that are too small to tell anything, too large, or not all above 0.
pub fn by_ranks(a: &[f64], b: &[f64]) -> Option<Ratio> {
    let fits =
        |values: &[f64]| (LEAST..=MOST).contains(&values.len()) && values.iter().all(|v| v.is_finite() && *v > 0.0);
    if !fits(a) || !fits(b) {
        return None;
    }
    let mut ratios: Vec<f64> = b.iter().flat_map(|b| a.iter().map(move |a| b / a)).collect();
    ratios.sort_by(f64::total_cmp);
    let outside = beyond(a.len(), b.len());
    let ratio = Stats::of(b)?.median / Stats::of(a)?.median;
    Some(Ratio { ratio, low: *ratios.get(outside)?, high: ratios[ratios.len() - 1 - outside], p: rank_sum(a, b) })
}

/// `b` over `a` from medians and standard errors alone, in the normal approximation: the standard error of a median is
/// √(π/2) that of the mean. `None` for fewer than four frames.
pub fn by_errors(a: Stats, b: Stats) -> Option<Ratio> {
    let fits = |s: Stats| s.n >= LEAST && s.median > 0.0 && s.median.is_finite() && s.stderr.is_finite();
    if !fits(a) || !fits(b) {
        return None;
    }
    let ratio = b.median / a.median;
    let of_median = (std::f64::consts::PI / 2.0).sqrt();
    let error = of_median * (a.stderr / a.median).hypot(b.stderr / b.median);
    let p = if ratio == 1.0 { 1.0 } else { erfc(ratio.ln().abs() / error * FRAC_1_SQRT_2) };
    // 97.5% of a normal distribution lie below.
    let reach = (1.959_963_984_540_054 * error).exp();
    Some(Ratio { ratio, low: ratio / reach, high: ratio * reach, p })
}

/// Each p as if it were the only one: corrected for the number of them after Holm, so that the chance of a single false
/// claim among all is at most that of one.
pub fn holm(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|i, j| values[*i].total_cmp(&values[*j]));
    let (mut corrected, mut least) = (vec![1.0; values.len()], 0.0f64);
    for (before, i) in order.into_iter().enumerate() {
        least = least.max(values[i] * (values.len() - before) as f64).min(1.0);
        corrected[i] = least;
    }
    corrected
}

/// The two-sided p of the rank sum of `b` among both samples.
fn rank_sum(a: &[f64], b: &[f64]) -> f64 {
    // Twice the midrank of a value: those below it, and those up to it, and one.
    let both = || a.iter().chain(b);
    let rank = |value: &f64| both().filter(|v| *v < value).count() + both().filter(|v| *v <= value).count() + 1;
    let ranks: Vec<usize> = both().map(rank).collect();
    let ways = ways(&ranks, b.len());
    let sum: usize = b.iter().map(rank).sum();
    let mean = b.len() * (ranks.len() + 1);
    let far: f64 =
        ways.iter().enumerate().filter(|(s, _)| s.abs_diff(mean) >= sum.abs_diff(mean)).map(|(_, n)| n).sum();
    (far / ways.iter().sum::<f64>()).min(1.0)
}

/// In how many ways `taken` of `ranks` add up to each sum.
fn ways(ranks: &[usize], taken: usize) -> Vec<f64> {
    let most: usize = ranks.iter().sum();
    let mut ways = vec![vec![0.0; most + 1]; taken + 1];
    ways[0][0] = 1.0;
    for &rank in ranks {
        for count in (1..=taken).rev() {
            for sum in rank..=most {
                ways[count][sum] += ways[count - 1][sum - rank];
            }
        }
    }
    ways.pop().unwrap_or_default()
}

/// How many of the sorted ratios of samples of these sizes lie outside of the interval, at each end.
fn beyond(a: usize, b: usize) -> usize {
    let ranks: Vec<usize> = (1..=a + b).collect();
    let (ways, least) = (ways(&ranks, b), b * (b + 1) / 2);
    let (all, mut below): (f64, f64) = (ways.iter().sum(), 0.0);
    ways[least..]
        .iter()
        .take_while(|n| {
            below += **n;
            below / all <= ALPHA / 2.0
        })
        .count()
        .saturating_sub(1)
}

/// The complementary error function, to 1.2e-7 of its value (Press et al., Numerical Recipes, 2nd ed., 6.2: `erfcc`).
fn erfc(x: f64) -> f64 {
    const TERMS: [f64; 10] = [
        -1.265_512_23,
        1.000_023_68,
        0.374_091_96,
        0.096_784_18,
        -0.186_288_06,
        0.278_868_07,
        -1.135_203_98,
        1.488_515_87,
        -0.822_152_23,
        0.170_872_77,
    ];
    let t = 1.0 / (1.0 + 0.5 * x.abs());
    let tail = t * (TERMS.iter().rev().fold(0.0, |sum, term| sum * t + term) - x * x).exp();
    if x < 0.0 { 2.0 - tail } else { tail }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn critical_values_are_those_of_the_tables() {
        // Mann and Whitney's U, two-sided, 5%: at most so many of the pairs are the other way round.
        for (a, b, critical) in [(4, 4, 0), (5, 5, 2), (5, 8, 6), (8, 8, 13), (10, 10, 23), (10, 20, 55), (20, 20, 127)]
        {
            assert_eq!(beyond(a, b), critical, "{a} and {b}");
        }
    }

    #[test]
    fn known_samples() {
        // No value of one among those of the other: 2 of the 252 ways to choose 5 of 10.
        let a = [1.0, 2.0, 3.0, 4.0, 5.0];
        let b = a.map(|v| v * 10.0);
        let found = by_ranks(&a, &b).expect("enough");
        assert!((found.p - 2.0 / 252.0).abs() < 1e-12 && found.ratio == 10.0, "{found:?}");
        // The third of the sorted ratios (2, 2.5, 3.3, 4, …) from either end.
        assert_eq!((found.low, found.high), (10.0 / 3.0, 30.0));
        let same = by_ranks(&a, &a).expect("enough");
        assert_eq!((same.ratio, same.p), (1.0, 1.0));
        assert!(same.low < 1.0 && same.high > 1.0);
        // Hollander and Wolfe, Nonparametric Statistical Methods, 4.1: permeability of the human chorioamnion at term
        // and before; W = 30, one-sided p = 0.127.
        let term = [0.80, 0.83, 1.89, 1.04, 1.45, 1.38, 1.91, 1.64, 0.73, 1.46];
        let before = [1.15, 0.88, 0.90, 0.74, 1.21];
        let found = by_ranks(&term, &before).expect("enough");
        assert!((found.p - 0.2544).abs() < 1e-4, "{found:?}");
        assert!(
            by_ranks(&a[..3], &b).is_none() && by_ranks(&a, &[0.0; 5]).is_none() && by_ranks(&[1.0; 99], &b).is_none()
        );
    }

    #[test]
    fn medians_and_errors_give_the_normal_approximation() {
        for (z, p) in [(0.0, 1.0), (1.0, 0.317_310_5), (1.959_964, 0.05), (5.0, 5.733_031e-7), (-1.0, 1.682_689_5)] {
            assert!((erfc(z * FRAC_1_SQRT_2) / p - 1.0).abs() < 1e-6, "{z}");
        }
        let stats = |median: f64, stderr: f64| Stats { median, mean: median, stderr, min: median, max: median, n: 100 };
        let found = by_errors(stats(10.0, 0.0), stats(11.0, 0.1)).expect("enough");
        let reach = (1.96 * 1.2533 * 0.1f64 / 11.0).exp();
        assert!((found.low - 1.1 / reach).abs() < 1e-4 && (found.high - 1.1 * reach).abs() < 1e-4, "{found:?}");
        assert!(found.p < 1e-4);
        assert_eq!(by_errors(stats(5.0, 0.0), stats(5.0, 0.0)).map(|r| (r.low, r.high, r.p)), Some((1.0, 1.0, 1.0)));
        assert_eq!(by_errors(stats(5.0, 0.0), stats(6.0, 0.0)).map(|r| r.p), Some(0.0));
        assert!(by_errors(stats(5.0, 0.1), Stats { n: 1, ..stats(5.0, 0.0) }).is_none());
    }

    #[test]
    fn many_comparisons_are_corrected_for() {
        let corrected = holm(&[0.01, 0.04, 0.03, 0.005]);
        for (found, expected) in corrected.iter().zip([0.03, 0.06, 0.06, 0.02]) {
            assert!((found - expected).abs() < 1e-12, "{corrected:?}");
        }
        assert_eq!(holm(&[0.9, 0.8]), [1.0, 1.0]);
        assert!(holm(&[]).is_empty());
    }

    /// Skewed noise above a floor, as times have it.
    fn times(seed: &mut u64, n: usize) -> Vec<f64> {
        let mut uniform = || {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((*seed >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        (0..n).map(|_| 1.0 - 0.2 * uniform().ln()).collect()
    }

    #[test]
    fn claims_are_false_as_seldom_as_they_say() {
        let (mut seed, mut claimed, mut missed, mut found) = (1, 0, 0, 0);
        const TRIALS: usize = 2000;
        for _ in 0..TRIALS {
            let (a, b) = (times(&mut seed, 10), times(&mut seed, 10));
            claimed += usize::from(by_ranks(&a, &b).expect("enough").p < ALPHA);
            let slower: Vec<f64> = times(&mut seed, 10).iter().map(|v| v * 1.5).collect();
            let ratio = by_ranks(&a, &slower).expect("enough");
            missed += usize::from(!(ratio.low..=ratio.high).contains(&1.5));
            found += usize::from(ratio.p < ALPHA);
        }
        // 4.3% is what the steps of ranks leave of 5%; three standard deviations around it.
        assert!((57..=116).contains(&claimed) && (57..=116).contains(&missed), "{claimed} {missed}");
        assert!(found > TRIALS * 9 / 10, "{found}");
    }

    proptest! {
        #[test]
        fn ranks_agree_with_every_choice_tried(
            values in prop::collection::vec(1..6u32, 8..11),
            split in 4..5usize,
        ) {
            let values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let (a, b) = values.split_at(split);
            let rank = |v: f64| {
                let count = |keep: &dyn Fn(f64) -> bool| values.iter().filter(|o| keep(**o)).count() as f64;
                count(&|o| o < v) + (count(&|o| o == v) + 1.0) / 2.0
            };
            let mean = b.len() as f64 * (values.len() as f64 + 1.0) / 2.0;
            let far = (b.iter().map(|v| rank(*v)).sum::<f64>() - mean).abs();
            let (mut all, mut as_far) = (0, 0);
            for chosen in 0..1u32 << values.len() {
                if chosen.count_ones() as usize == b.len() {
                    let of = |(i, v): (usize, &f64)| if chosen >> i & 1 == 1 { rank(*v) } else { 0.0 };
                    let sum: f64 = values.iter().enumerate().map(of).sum();
                    all += 1;
                    as_far += u32::from((sum - mean).abs() >= far - 1e-9);
                }
            }
            let found = by_ranks(a, b).expect("enough");
            prop_assert!((found.p - f64::from(as_far) / f64::from(all)).abs() < 1e-12, "{:?}", found);
            prop_assert!(found.low <= found.ratio && found.ratio <= found.high, "{:?}", found);
        }
    }
}
