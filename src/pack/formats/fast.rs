//! In blocks, 9 bytes per vertex. GLSL: `glsl/formats/fast.glsl`.
//!
//! ```text
//! header [shifts]                   a[size] b[size] c[size / 4]
//!   a = x:15 y:15 ny0:1 nz0:1   b = z:15 nx:9 ny8..1:8   c = nz8..1:8
//!   shifts: the first triple's in bits 0..8, the second's in bits 8..16
//! ```

use super::{BlockFormat, Lane, quantise};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::error::ensure;
use crate::pack::POSE_FLOATS;
use crate::pack::source::largest;
use std::ops::Range;

/// Bits of an integer, by triple.
const BITS: [u32; TRIPLES] = [15, 9];

pub(crate) struct Fast;

/// Delta words per entry in blocks of `size` vertices.
fn entry_words(size: usize) -> usize {
    size * 9 / 4
}

/// Writes the integers of a vertex into zeroed words of an entry.
fn put(size: usize, lane: usize, delta: [i32; POSE_FLOATS], deltas: &mut [u32]) {
    let [x, y, z, nx, ny, nz] = delta.map(|v| v as u32);
    deltas[lane] = (x & 0x7fff) | (y & 0x7fff) << 15 | (ny & 1) << 30 | (nz & 1) << 31;
    deltas[size + lane] = (z & 0x7fff) | (nx & 0x1ff) << 15 | (ny >> 1) << 24;
    deltas[2 * size + lane / 4] |= (nz >> 1 & 0xff) << (8 * (lane % 4));
}

/// Bits `at..at + bits` of `word`, sign-extended.
#[inline(always)]
fn field(word: u32, at: u32, bits: u32) -> i32 {
    ((word << (32 - at - bits)) as i32) >> (32 - bits)
}

impl BlockFormat for Fast {
    fn header_words(&self) -> usize {
        1
    }

    fn words(&self, entry: usize, _: &[u32], _: &[u32], size: usize) -> Range<usize> {
        let length = entry_words(size);
        entry * length..(entry + 1) * length
    }

    /// Uses the smallest shift with which the integers fit.
    fn encode(&self, size: usize, steps: [f32; TRIPLES], lanes: &[Lane], [headers, deltas]: [&mut Vec<u32>; 2]) {
        let step = |triple: usize, shift: u32| f64::from(steps[triple]) * f64::from(1u32 << shift);
        let largest = largest(lanes);
        let fits = |triple: usize, shift: u32| quantise(largest[triple], step(triple, shift)) < 1 << (BITS[triple] - 1);
        let shifts = [0, 1].map(|triple| (0..31).find(|&s| fits(triple, s)).unwrap_or(31));
        headers.push(shifts[0] | shifts[1] << 8);
        let at = deltas.len();
        deltas.resize(at + entry_words(size), 0);
        for (lane, delta) in lanes {
            let quantised = |i: usize| quantise(delta[i], step(i / TRIPLE, shifts[i / TRIPLE]));
            put(size, *lane as usize, std::array::from_fn(quantised), &mut deltas[at..]);
        }
    }

    fn check_header(&self, header: &[u32]) -> Result<[u32; TRIPLES], String> {
        let shifts = self.shifts(header);
        let bits: [u32; TRIPLES] = std::array::from_fn(|triple| BITS[triple] + shifts[triple]);
        // A shifted component must fit the 32 bits it is decoded into.
        let fits = header[0] >> 16 == 0 && bits.iter().all(|bits| *bits <= 32);
        ensure!(fits, format!("shifts of {:#x}", header[0]));
        Ok(bits)
    }

    #[inline(always)]
    fn shifts(&self, header: &[u32]) -> [u32; TRIPLES] {
        [header[0] & 0xff, header[0] >> 8 & 0xff]
    }

    #[inline(always)]
    fn decode(
        &self,
        size: usize,
        lanes: Range<usize>,
        _: &[u32],
        deltas: &[u32],
        mut f: impl FnMut(usize, usize, i32),
    ) {
        let (a, rest) = deltas.split_at(size);
        let (b, c) = rest.split_at(size);
        let c: &[i8] = bytemuck::cast_slice(c);
        let a = &a[..lanes.end];
        let b = &b[..lanes.end];
        let c = &c[..lanes.end];
        for lane in lanes {
            let a = a[lane];
            let b = b[lane];
            let ny = ((b as i32) >> 24) << 1 | ((a >> 30) & 1) as i32;
            let nz = i32::from(c[lane]) << 1 | (a >> 31) as i32;
            let delta = [field(a, 0, 15), field(a, 15, 15), field(b, 0, 15), field(b, 15, 9), ny, nz];
            for (component, number) in delta.into_iter().enumerate() {
                f(lane, component, number);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Random blocks of 32 vertices, integers truncated to the format's width.
        #[test]
        fn deltas_come_back(block in prop::collection::vec(any::<[i32; POSE_FLOATS]>(), 32)) {
            let cut = |delta: &[i32; POSE_FLOATS]| std::array::from_fn(|i| delta[i] >> (32 - BITS[i / TRIPLE]));
            let expected: Vec<[i32; POSE_FLOATS]> = block.iter().map(cut).collect();
            let mut words = vec![0; entry_words(32)];
            for (lane, delta) in expected.iter().enumerate() {
                put(32, lane, *delta, &mut words);
            }
            let mut found = vec![[0; POSE_FLOATS]; 32];
            Fast.decode(32, 0..32, &[0], &words, |lane, component, number| found[lane][component] = number);
            prop_assert_eq!(found, expected);
        }
    }
}
