//! Normalised blending: weights of absolute poses.

/// Converts weights of absolute poses to weights of deltas: the poses are averaged, and the base pose fills the rest.
///
/// A. Gerdelan, "Animating Blend Shapes": the factor of the base pose is 1 - Σ w, clamped to 0 to 1, and all factors
/// are divided by their sum, so that they sum to one:
///
/// ```text
/// pose = (w₀ base + Σ wᵢ poseᵢ) / (w₀ + Σ wᵢ),  w₀ = clamp(1 - Σ wᵢ, 0, 1)
///      = base + Σ wᵢ / max(1, Σ wᵢ) · (poseᵢ - base)
/// ```
///
/// Weights with a sum of at most 1 are unchanged; above that, each is divided by the sum, so that changing one changes
/// every factor that is not 0, and an update applies as many. Gerdelan's printed shader does not clamp: its base pose
/// may have a negative factor, and the sum is one without a division, which is what unconverted weights of deltas do.
///
/// Negative weights count as 0, since an average has no negative parts; a sum of 0 gives the base pose. A weight that
/// is not finite makes weights NaN, which crowds reject.
///
/// Applies to targets given as whole meshes or as deltas: poseᵢ is the base pose plus delta i.
pub fn normalise_weights(weights: &mut [f32]) {
    weights.iter_mut().filter(|w| **w < 0.0).for_each(|w| *w = 0.0);
    // float64, so that many small weights add up precisely.
    let sum: f64 = weights.iter().map(|w| f64::from(*w)).sum();
    if sum > 1.0 || sum.is_nan() {
        weights.iter_mut().for_each(|w| *w = (f64::from(*w) / sum) as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph_head::Rng;

    /// Base and targets, as whole meshes of a few numbers.
    fn meshes(rng: &mut Rng, targets: usize) -> Vec<Vec<f64>> {
        (0..=targets).map(|_| (0..9).map(|_| f64::from(rng.range(-2.0, 2.0))).collect()).collect()
    }

    /// Σ f p / Σ f, of base and targets.
    fn averaged(meshes: &[Vec<f64>], factors: &[f64]) -> Vec<f64> {
        let sum: f64 = factors.iter().sum();
        let at = |i: usize| meshes.iter().zip(factors).map(|(mesh, f)| mesh[i] * f).sum::<f64>() / sum;
        (0..9).map(at).collect()
    }

    /// The base pose plus weighted deltas.
    fn of_deltas(meshes: &[Vec<f64>], weights: &[f32]) -> Vec<f64> {
        let delta = |(mesh, w): (&Vec<f64>, &f32), i: usize| f64::from(*w) * (mesh[i] - meshes[0][i]);
        let at = |i: usize| meshes[0][i] + meshes[1..].iter().zip(weights).map(|both| delta(both, i)).sum::<f64>();
        (0..9).map(at).collect()
    }

    fn apart(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn poses_are_gerdelans_in_both_readings_and_they_differ_above_one() {
        let mut rng = Rng::new(7, 0);
        let (mut above, mut below) = (0, 0);
        for _ in 0..1000 {
            let targets = 1 + rng.below(6);
            let meshes = meshes(&mut rng, targets);
            let most = rng.range(0.1, 1.5);
            let weights: Vec<f32> = (0..targets).map(|_| rng.range(0.0, most)).collect();
            let factors = |base: f64| -> Vec<f64> {
                std::iter::once(base).chain(weights.iter().map(|w| f64::from(*w))).collect()
            };
            let sum: f64 = weights.iter().map(|w| f64::from(*w)).sum();
            let text = averaged(&meshes, &factors((1.0 - sum).clamp(0.0, 1.0)));
            let shader = averaged(&meshes, &factors(1.0 - sum));
            let mut normalised = weights.clone();
            normalise_weights(&mut normalised);
            // Weights are rounded to float32 once.
            assert!(apart(&of_deltas(&meshes, &normalised), &text) < 2e-6, "{weights:?}");
            assert!(apart(&of_deltas(&meshes, &weights), &shader) < 1e-12, "{weights:?}");
            if sum > 1.01 {
                assert!(apart(&text, &shader) > 1e-6, "{weights:?}");
                above += 1;
            } else if sum <= 1.0 {
                assert_eq!(normalised, weights);
                below += 1;
            }
        }
        assert!(above > 200 && below > 100, "{above} {below}");
    }

    #[test]
    fn one_weight_changes_every_active_factor_above_one_and_only_its_own_below() {
        let changed = |before: [f32; 4], after: [f32; 4]| {
            let [before, after] = [before, after].map(|mut weights| {
                normalise_weights(&mut weights);
                weights
            });
            before.iter().zip(after).filter(|(a, b)| **a != *b).count()
        };
        assert_eq!(changed([0.2, 0.3, 0.0, 0.1], [0.2, 0.3, 0.0, 0.2]), 1);
        assert_eq!(changed([0.9, 0.8, 0.0, 0.1], [0.9, 0.8, 0.0, 0.2]), 3);
    }

    #[test]
    fn negative_weights_are_none_and_nothing_is_the_base_pose() {
        let normalised = |mut weights: Vec<f32>| {
            normalise_weights(&mut weights);
            weights
        };
        assert_eq!(normalised(vec![-1.0, 0.5]), [0.0, 0.5]);
        assert_eq!(normalised(vec![-1.0, 3.0, 1.0]), [0.0, 0.75, 0.25]);
        assert_eq!(normalised(vec![1.0, -1.0]), [1.0, 0.0]);
        assert_eq!(normalised(vec![0.0, -0.0, -2.0]), [0.0, 0.0, 0.0]);
        assert!(normalised(vec![]).is_empty());
        assert!(normalised(vec![f32::NAN, 0.5]).iter().all(|w| !w.is_finite()));
        assert!(normalised(vec![f32::INFINITY, 0.5]).iter().any(|w| !w.is_finite()));
    }
}
