//! Small functions that several rooms use.

use glam::Vec3;

/// Length of the bounding-box diagonal of `positions`; 0 for fewer than two distinct points.
pub fn diagonal(positions: &[Vec3]) -> f32 {
    let Some(&first) = positions.first() else { return 0.0 };
    let (lo, hi) = positions.iter().fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    // The squares of tiny differences would vanish in single precision, and those of huge ones overflow.
    (hi.as_dvec3() - lo.as_dvec3()).length() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_diagonal_of_a_tiny_or_huge_mesh_is_exact() {
        for scale in [1e-38f32, 1e-30, 1.0, 1e30] {
            let found = diagonal(&[Vec3::ZERO, Vec3::new(2.0, -3.0, 6.0) * scale, Vec3::X * scale]);
            assert!((found / (7.0 * scale) - 1.0).abs() < 1e-6, "{found} at {scale}");
        }
        assert_eq!(diagonal(&[Vec3::ONE; 2]), 0.0);
    }
}
