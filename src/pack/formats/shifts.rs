//! Entries whose integers have a fixed number of bits: the header is one word, which has how far an entry's integers
//! are shifted, those of the first triple in bits 0..8, those of the second in bits 8..16.

use super::{Lane, quantise};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::POSE_FLOATS;

/// By how many bits the integers of an entry are to be shifted, by triple.
#[inline(always)]
pub(super) fn shifts(header: &[u32]) -> [u32; TRIPLES] {
    [header[0] & 0xff, header[0] >> 8 & 0xff]
}

/// Bits of the largest integer of an entry once it is shifted, by triple; before, integers have `bits`.
///
/// # Errors
/// What is wrong with the header, which may be hostile.
pub(super) fn check(header: &[u32], bits: [u32; TRIPLES]) -> Result<[u32; TRIPLES], String> {
    let shifts = shifts(header);
    let bits: [u32; TRIPLES] = std::array::from_fn(|triple| bits[triple] + shifts[triple]);
    // Shifted, a component still fits the 32 bits that it is decoded in.
    match header[0] >> 16 == 0 && bits.iter().all(|bits| *bits <= 32) {
        true => Ok(bits),
        false => Err(format!("shifts of {:#x}", header[0])),
    }
}

/// The header of an entry, and its integers by place in the block: shifted as little as lets them fit `bits`.
pub(super) fn quantised(
    bits: [u32; TRIPLES],
    steps: [f32; TRIPLES],
    lanes: &[Lane],
) -> (u32, impl Iterator<Item = (usize, [i32; POSE_FLOATS])>) {
    let step = move |triple: usize, shift: u32| f64::from(steps[triple]) * f64::from(1u32 << shift);
    let fits = |triple: usize, shift: u32| {
        let most = f64::from((1 << (bits[triple] - 1)) - 1);
        let mut components = lanes.iter().flat_map(|(_, d)| &d[TRIPLE * triple..TRIPLE * (triple + 1)]);
        components.all(|v| (f64::from(*v) / step(triple, shift)).round().abs() <= most)
    };
    let shifts = [0, 1].map(|triple| (0..31).find(|&s| fits(triple, s)).unwrap_or(31));
    let integers = lanes.iter().map(move |(lane, delta)| {
        let quantised = |i: usize| quantise(delta[i], step(i / TRIPLE, shifts[i / TRIPLE]));
        (*lane as usize, std::array::from_fn(quantised))
    });
    (shifts[0] | shifts[1] << 8, integers)
}

/// The `bits` bits of `word` from bit `at` on as a signed number.
#[inline(always)]
pub(super) fn field(word: u32, at: u32, bits: u32) -> i32 {
    ((word << (32 - at - bits)) as i32) >> (32 - bits)
}
