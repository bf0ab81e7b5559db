//! Shared helpers: lengths, angles, powers of two, a parallel map.

use glam::{DVec3, Vec3};

/// The angle between two vectors that need not have unit length, in degrees; 0 if either is zero.
pub fn angle_degrees(a: DVec3, b: DVec3) -> f64 {
    // atan2 is precise even for small angles, where acos of a dot product near 1 is not.
    let degrees = a.cross(b).length().atan2(a.dot(b)).to_degrees();
    // The last bits of atan2 differ between C libraries.
    f64::from(degrees as f32)
}

/// The largest power of two ≤ `value`, from 2^-100 to 2^100, which leaves single precision room for products.
pub fn power_of_two_below(value: f64) -> f32 {
    value.log2().floor().clamp(-100.0, 100.0).exp2() as f32
}

/// The smallest power of two ≥ `value`, from 2^-100 to 2^100.
pub fn power_of_two_above(value: f64) -> f32 {
    value.log2().ceil().clamp(-100.0, 100.0).exp2() as f32
}

/// Whether `value` is 2^n for some n, and not denormal.
pub fn is_power_of_two(value: f32) -> bool {
    value.is_normal() && value > 0.0 && value.to_bits().trailing_zeros() >= 23
}

/// The largest float32 that is at most `x`.
pub fn down(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

/// The smallest float32 that is at least `x`.
pub fn up(x: f64) -> f32 {
    -down(-x)
}

/// Length of the bounding-box diagonal of `positions`; 0 for fewer than two distinct points.
pub fn diagonal(positions: &[Vec3]) -> f32 {
    let Some(&first) = positions.first() else { return 0.0 };
    let (lo, hi) = positions.iter().fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    // The squares of tiny differences would vanish in single precision, and those of huge ones overflow.
    (hi.as_dvec3() - lo.as_dvec3()).length() as f32
}

/// For each axis, the middle of the box around `positions` if subtracting it gains precision; 0 on other axes.
///
/// It does so if the largest coordinate is at least twice the diagonal. The remainder is then at most half the
/// diagonal: positions gain two bits or more of a single-precision number, whose units in the last place shrink with
/// it. A smaller gain would not be worth a second origin. Coordinates on such an axis lie within a factor of two of
/// each other and of the middle, since they differ by at most the diagonal: differences are exact (Sterbenz), and so is
/// adding the middle again.
pub fn far_middle(positions: impl Iterator<Item = Vec3>) -> Vec3 {
    let Some((low, high)) = positions.map(|p| (p, p)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))) else {
        return Vec3::ZERO;
    };
    let low = low.as_dvec3();
    let high = high.as_dvec3();
    let diagonal = (high - low).length();
    let largest = low.abs().max(high.abs());
    let middle = low.midpoint(high);
    let axis = |i: usize| if largest[i] >= 2.0 * diagonal { middle[i] as f32 } else { 0.0 };
    Vec3::new(axis(0), axis(1), axis(2))
}

/// Maps every item, in order; on several threads if the crate is built with them. Each thread has a copy of `scratch`.
pub fn map_all<T: Sync, S: Clone + Send + Sync, R: Send>(
    items: &[T],
    mut scratch: S,
    map: impl Fn(&mut S, &T) -> R + Send + Sync,
) -> Vec<R> {
    #[cfg(feature = "threads")]
    if items.len() > 1 {
        use rayon::prelude::*;
        return items.par_iter().map_init(|| scratch.clone(), map).collect();
    }
    items.iter().map(|item| map(&mut scratch, item)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_two() {
        for (value, below) in [(1.0, 1.0), (1.5, 1.0), (0.3, 0.25), (1e300, 2f32.powi(100)), (0.0, 2f32.powi(-100))] {
            assert_eq!(power_of_two_below(value), below, "{value}");
            assert!(is_power_of_two(below));
        }
        assert!(![0.0, -2.0, 3.0, f32::NAN, f32::INFINITY, f32::MIN_POSITIVE / 2.0].into_iter().any(is_power_of_two));
    }

    #[test]
    fn what_is_far_is_moved_without_rounding() {
        let corners = [Vec3::new(0.1, 0.7, -0.3), Vec3::new(-0.2, 0.9, 0.21), Vec3::new(0.03, 0.85, -0.111)];
        for far in [0.0, 0.3, 2.0, -50.3, 1e4, -3e7, 1e30] {
            let all = corners.map(|p| p + Vec3::new(far, 0.0, -2.0 * far));
            let middle = far_middle(all.into_iter());
            assert_eq!(middle == Vec3::ZERO, far.abs() < 1.0, "{middle}");
            // Farther away x and z round to single points, and the diagonal is that of y alone.
            assert!(middle.y == 0.0 || far.abs() > 1e6, "{middle}");
            for p in all {
                let near = p - middle;
                assert_eq!(near.as_dvec3(), p.as_dvec3() - middle.as_dvec3(), "{p} - {middle}");
                assert_eq!(near + middle, p);
                assert!(far.abs() < 1.0 || near.x.abs() <= 0.5 * diagonal(&all), "{near}");
            }
        }
        assert_eq!(far_middle([Vec3::new(5.0, 0.0, -7.0)].into_iter()), Vec3::new(5.0, 0.0, -7.0));
        assert_eq!((far_middle([Vec3::ZERO; 2].into_iter()), far_middle([].into_iter())), (Vec3::ZERO, Vec3::ZERO));
    }

    #[test]
    fn the_diagonal_of_a_tiny_or_huge_mesh_is_exact() {
        for scale in [1e-38f32, 1e-30, 1.0, 1e30] {
            let found = diagonal(&[Vec3::ZERO, Vec3::new(2.0, -3.0, 6.0) * scale, Vec3::X * scale]);
            assert!((found / (7.0 * scale) - 1.0).abs() < 1e-6, "{found} at {scale}");
        }
        assert_eq!(diagonal(&[Vec3::ONE; 2]), 0.0);
    }
}
