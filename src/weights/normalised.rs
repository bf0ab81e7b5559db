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
    use crate::{reference, testing};

    #[test]
    fn negative_weights_are_none_and_nothing_is_the_base_pose() {
        let normalised = |mut weights: Vec<f32>| {
            normalise_weights(&mut weights);
            weights
        };
        assert_eq!(normalised(vec![-1.0, 0.5]), [0.0, 0.5]);
        assert_eq!(normalised(vec![-1.0, 3.0, 1.0]), [0.0, 0.75, 0.25]);
        assert_eq!(normalised(vec![0.0, -0.0, -2.0]), [0.0, 0.0, 0.0]);
        assert!(normalised(vec![]).is_empty());
        assert!(normalised(vec![f32::NAN, 0.5]).iter().all(|w| !w.is_finite()));
        assert!(normalised(vec![f32::INFINITY, 0.5]).iter().any(|w| !w.is_finite()));
    }

    #[test]
    fn poses_are_those_of_gerdelans_formula() {
        const TARGETS: usize = 9;
        let mesh = testing::mesh(200, TARGETS);
        let pose = |weights: &[f32]| reference::evaluate_unpacked(&mesh, weights);
        let base = pose(&[]);
        let poses: [_; TARGETS] = std::array::from_fn(|t| pose(&[&vec![0.0; t][..], &[1.0]].concat()));
        // Sums below one, and above.
        for most in [0.1, 0.9] {
            let weights: [f32; TARGETS] = std::array::from_fn(|t| most * (t * 4 % 9) as f32 / 8.0);
            let sum: f64 = weights.iter().map(|w| f64::from(*w)).sum();
            let of_base = (1.0 - sum).clamp(0.0, 1.0);
            let mut factors = weights;
            normalise_weights(&mut factors);
            for (i, found) in pose(&factors).into_iter().enumerate() {
                let of_poses: f64 = poses.iter().zip(weights).map(|(pose, w)| pose[i] * f64::from(w)).sum();
                let expected = (of_base * base[i] + of_poses) / (of_base + sum);
                assert!((found - expected).abs() < 1e-5, "{weights:?}: {found}, not {expected}");
            }
        }
    }
}
