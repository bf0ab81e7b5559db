//! Half floats: binary16 of IEEE 754.

/// The largest number that a half float holds.
pub(super) const LARGEST: f32 = 65504.0;

/// Rounds to the nearest half float, ties to even; infinite from 65520 on. NaN stays NaN.
pub(super) fn from_f32(value: f32) -> u16 {
    let (sign, size) = ((value.to_bits() >> 16 & 0x8000) as u16, value.to_bits() & 0x7fff_ffff);
    sign | match size {
        0x7f80_0001.. => 0x7e00,
        0x477f_f000.. => 0x7c00,
        // Normal: the exponent's bias goes from 127 to 15, and 13 bits are rounded away; a carry correctly increments
        // the exponent.
        0x3880_0000.. => ((size - 0x3800_0000 + 0xfff + (size >> 13 & 1)) >> 13) as u16,
        // Below 2^-14 steps are 2^-24. Multiplying by a power of two is exact, and double precision has room for
        // halves.
        _ => (f64::from(f32::from_bits(size)) * f64::from(1 << 24)).round_ties_even() as u16,
    }
}

/// Converts to float32, exactly.
pub(super) fn to_f32(half: u16) -> f32 {
    let (sign, size) = (u32::from(half & 0x8000) << 16, u32::from(half & 0x7fff));
    f32::from_bits(match size {
        0x7c00.. => sign | 0x7f80_0000 | (size & 0x3ff) << 13,
        0x400.. => sign | ((size << 13) + 0x3800_0000),
        _ => sign | (size as f32 / (1 << 24) as f32).to_bits(),
    })
}

/// Returns whether a half float represents this number exactly, the sign of zero included.
pub(super) fn is_half(value: f32) -> bool {
    to_f32(from_f32(value)).to_bits() == value.to_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_exact_and_what_lies_between_rounds_to_the_nearest_even() {
        for half in (0..0x7c00u16).chain(0x8000..0xfc00) {
            assert_eq!(from_f32(to_f32(half)), half, "{half:#x}");
        }
        for half in 0..0x7bffu16 {
            let (low, high) = (f64::from(to_f32(half)), f64::from(to_f32(half + 1)));
            let middle = ((low + high) / 2.0) as f32; // exact: a half float and one bit more
            let even = half + (half & 1);
            for (value, expected) in [(middle.next_down(), half), (middle, even), (middle.next_up(), half + 1)] {
                assert_eq!((from_f32(value), from_f32(-value)), (expected, expected | 0x8000), "{value:e}");
                assert!(!is_half(value) && !is_half(-value), "{value:e}");
            }
            assert!(is_half(low as f32) && is_half(-low as f32), "{low:e}");
        }
        assert_eq!([1.0, 65504.0, 2f32.powi(-14), f32::INFINITY].map(from_f32), [0x3c00, 0x7bff, 0x400, 0x7c00]);
        assert_eq!([65519.99, 65520.0].map(from_f32), [0x7bff, 0x7c00]);
        assert!(to_f32(from_f32(f32::NAN)).is_nan());
        assert_eq!(to_f32(0xfc00), f32::NEG_INFINITY);
        assert!([70000.0, 65505.0, 1e-12, 1.0 / 3.0].iter().all(|x| !is_half(*x)));
    }
}
