//! Block entries with integers of fixed width. The header is one word of shifts: the first triple's in bits 0..8, the
//! second's in bits 8..16.

use super::{BlockFormat, Lane, fixed, quantise};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::error::ensure;
use crate::pack::POSE_FLOATS;
use std::ops::Range;

/// A format with integers of fixed width.
pub(crate) trait Shifted {
    /// Bits of an integer, by triple.
    const BITS: [u32; TRIPLES];

    /// Delta words per entry in blocks of `size` vertices.
    fn entry_words(size: usize) -> usize;

    /// Writes the integers of a vertex into zeroed words of an entry.
    fn put(size: usize, lane: usize, delta: [i32; POSE_FLOATS], deltas: &mut [u32]);

    fn check_deltas(_deltas: &[u32]) -> Result<(), String> {
        Ok(())
    }

    /// Calls `f(lane, integers)` for these vertices of an entry.
    fn for_each(size: usize, lanes: Range<usize>, deltas: &[u32], f: impl FnMut(usize, [i32; POSE_FLOATS]));
}

impl<F: Shifted> BlockFormat for F {
    fn header_words(&self) -> usize {
        1
    }

    fn words(&self, entry: usize, _: &[u32], _: &[u32], size: usize) -> Range<usize> {
        fixed(entry, F::entry_words(size))
    }

    /// Uses the smallest shift with which the integers fit.
    fn encode(&self, size: usize, steps: [f32; TRIPLES], lanes: &[Lane], [headers, deltas]: [&mut Vec<u32>; 2]) {
        let step = |triple: usize, shift: u32| f64::from(steps[triple]) * f64::from(1u32 << shift);
        let fits = |triple: usize, shift: u32| {
            let most = f64::from((1 << (F::BITS[triple] - 1)) - 1);
            let mut components = lanes.iter().flat_map(|(_, d)| &d[TRIPLE * triple..TRIPLE * (triple + 1)]);
            components.all(|v| (f64::from(*v) / step(triple, shift)).round().abs() <= most)
        };
        let shifts = [0, 1].map(|triple| (0..31).find(|&s| fits(triple, s)).unwrap_or(31));
        headers.push(shifts[0] | shifts[1] << 8);
        let at = deltas.len();
        deltas.resize(at + F::entry_words(size), 0);
        for (lane, delta) in lanes {
            let quantised = |i: usize| quantise(delta[i], step(i / TRIPLE, shifts[i / TRIPLE]));
            F::put(size, *lane as usize, std::array::from_fn(quantised), &mut deltas[at..]);
        }
    }

    fn check_header(&self, header: &[u32]) -> Result<[u32; TRIPLES], String> {
        let shifts = self.shifts(header);
        let bits: [u32; TRIPLES] = std::array::from_fn(|triple| F::BITS[triple] + shifts[triple]);
        // A shifted component must fit the 32 bits it is decoded into.
        let fits = header[0] >> 16 == 0 && bits.iter().all(|bits| *bits <= 32);
        ensure!(fits, format!("shifts of {:#x}", header[0]));
        Ok(bits)
    }

    fn check_deltas(&self, deltas: &[u32]) -> Result<(), String> {
        F::check_deltas(deltas)
    }

    #[inline(always)]
    fn shifts(&self, header: &[u32]) -> [u32; TRIPLES] {
        [header[0] & 0xff, header[0] >> 8 & 0xff]
    }

    type Component = i32;

    #[inline(always)]
    fn decode(
        &self,
        size: usize,
        lanes: Range<usize>,
        _: &[u32],
        deltas: &[u32],
        mut f: impl FnMut(usize, usize, i32),
    ) {
        F::for_each(
            size,
            lanes,
            deltas,
            #[inline(always)]
            |lane, delta| {
                for (c, number) in delta.into_iter().enumerate() {
                    f(lane, c, number);
                }
            },
        );
    }
}

/// Bits `at..at + bits` of `word`, sign-extended.
#[inline(always)]
pub(super) fn field(word: u32, at: u32, bits: u32) -> i32 {
    ((word << (32 - at - bits)) as i32) >> (32 - bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::formats::{fast::Fast, pair::Pair};
    use proptest::prelude::*;

    /// Random blocks of 32 vertices, integers truncated to the format's width.
    fn comes_back<F: Shifted>(block: &[[i32; POSE_FLOATS]]) {
        let cut = |delta: &[i32; POSE_FLOATS]| std::array::from_fn(|i| delta[i] >> (32 - F::BITS[i / TRIPLE]));
        let expected: Vec<_> = block.iter().map(cut).enumerate().collect();
        let (mut words, mut found) = (vec![0; F::entry_words(32)], vec![]);
        expected.iter().for_each(|(lane, delta)| F::put(32, *lane, *delta, &mut words));
        F::for_each(32, 0..32, &words, |lane, delta| found.push((lane, delta)));
        assert_eq!((found, F::check_deltas(&words)), (expected, Ok(())));
    }

    proptest! {
        #[test]
        fn deltas_come_back(block in prop::collection::vec(any::<[i32; POSE_FLOATS]>(), 32)) {
            comes_back::<Fast>(&block);
            comes_back::<Pair>(&block);
        }
    }
}
