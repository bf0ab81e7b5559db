//! In blocks, 9 bytes a vertex. The same in `glsl/formats/fast.glsl`.
//!
//! ```text
//! header [shifts]                   a[size] b[size] c[size / 4]
//!   a = x:15 y:15 ny0:1 nz0:1   b = z:15 nx:9 ny8..1:8   c = nz8..1:8
//! the first triple × 2^shift (bits 0..8 of the header), the second × 2^shift (bits 8..16)
//! ```

use super::{BlockFormat, DeltaFormat, Lane, quantise};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::POSE_FLOATS;

/// Bits of an integer, by triple.
const BITS: [u32; TRIPLES] = [15, 9];

pub(crate) struct Fast;

/// The words a and b and the byte c of a delta.
fn pack_vertex(q: [i32; POSE_FLOATS]) -> (u32, u32, u8) {
    let [x, y, z, nx, ny, nz] = q.map(|v| v as u32);
    let a = (x & 0x7fff) | (y & 0x7fff) << 15 | (ny & 1) << 30 | (nz & 1) << 31;
    let b = (z & 0x7fff) | (nx & 0x1ff) << 15 | (ny >> 1) << 24;
    (a, b, (nz >> 1) as u8)
}

/// The reverse of [`pack_vertex`].
#[inline(always)]
fn unpack_vertex(a: u32, b: u32, c: i8) -> [i32; POSE_FLOATS] {
    let field = |word: u32, at: u32, bits: u32| ((word << (32 - at - bits)) as i32) >> (32 - bits);
    [
        field(a, 0, 15),
        field(a, 15, 15),
        field(b, 0, 15),
        field(b, 15, 9),
        ((b as i32) >> 24) << 1 | ((a >> 30) & 1) as i32,
        i32::from(c) << 1 | (a >> 31) as i32,
    ]
}

impl BlockFormat for Fast {
    fn format(&self) -> DeltaFormat {
        DeltaFormat::Fast
    }

    fn header_words(&self, _: usize) -> usize {
        1
    }

    fn first_word(&self, entry: usize, header: &[u32], size: usize) -> usize {
        entry * self.entry_words(header, size)
    }

    fn entry_words(&self, _: &[u32], size: usize) -> usize {
        size * 9 / 4
    }

    fn encode(
        &self,
        size: usize,
        steps: [f32; TRIPLES],
        lanes: &[Lane],
        headers: &mut Vec<u32>,
        deltas: &mut Vec<u32>,
    ) {
        let step = |triple: usize, shift: u32| f64::from(steps[triple]) * f64::from(1u32 << shift);
        let fits = |triple: usize, shift: u32| {
            let most = f64::from((1 << (BITS[triple] - 1)) - 1);
            let mut components = lanes.iter().flat_map(|(_, d)| &d[TRIPLE * triple..TRIPLE * (triple + 1)]);
            components.all(|v| (f64::from(*v) / step(triple, shift)).round().abs() <= most)
        };
        let shifts = [0, 1].map(|triple| (0..31).find(|&s| fits(triple, s)).unwrap_or(31));
        headers.push(shifts[0] | shifts[1] << 8);
        let at = deltas.len();
        deltas.resize(at + size * 9 / 4, 0);
        for (lane, delta) in lanes {
            let lane = *lane as usize;
            let quantised = |i: usize| quantise(delta[i], step(i / TRIPLE, shifts[i / TRIPLE]));
            let (a, b, c) = pack_vertex(std::array::from_fn(quantised));
            deltas[at + lane] = a;
            deltas[at + size + lane] = b;
            deltas[at + 2 * size + lane / 4] |= u32::from(c) << (8 * (lane % 4));
        }
    }

    fn check_header(&self, header: &[u32]) -> Result<[u32; TRIPLES], String> {
        let shifts = self.shifts(header);
        // Shifted, a component still fits the 32 bits that it is decoded in.
        if header[0] >> 16 != 0 || (0..TRIPLES).any(|triple| BITS[triple] + shifts[triple] > 32) {
            return Err(format!("shifts of {:#x}", header[0]));
        }
        Ok(std::array::from_fn(|triple| BITS[triple] + shifts[triple]))
    }

    #[inline(always)]
    fn shifts(&self, header: &[u32]) -> [u32; TRIPLES] {
        [header[0] & 0xff, header[0] >> 8 & 0xff]
    }

    type Component = i32;

    #[inline(always)]
    fn decode(&self, size: usize, _: &[u32], deltas: &[u32], mut f: impl FnMut(usize, [i32; POSE_FLOATS])) {
        let (a, rest) = deltas.split_at(size);
        let (b, c) = rest.split_at(size);
        let c: &[i8] = bytemuck::cast_slice(c);
        let (a, b, c) = (&a[..size], &b[..size], &c[..size]);
        for lane in 0..size {
            f(lane, unpack_vertex(a[lane], b[lane], c[lane]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn deltas_come_back(p in prop::array::uniform3(-16384i32..16384), n in prop::array::uniform3(-256i32..256)) {
            let q = [p[0], p[1], p[2], n[0], n[1], n[2]];
            let (a, b, c) = pack_vertex(q);
            prop_assert_eq!(unpack_vertex(a, b, c as i8), q);
        }
    }
}
