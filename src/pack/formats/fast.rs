//! In blocks, 9 bytes a vertex. The same in `glsl/formats/fast.glsl`.
//!
//! ```text
//! header [shifts]                   a[size] b[size] c[size / 4]
//!   a = x:15 y:15 ny0:1 nz0:1   b = z:15 nx:9 ny8..1:8   c = nz8..1:8
//! ```

use super::shifts::{Shifted, field};
use crate::asset::streams::TRIPLES;
use crate::pack::POSE_FLOATS;

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
    [
        field(a, 0, 15),
        field(a, 15, 15),
        field(b, 0, 15),
        field(b, 15, 9),
        ((b as i32) >> 24) << 1 | ((a >> 30) & 1) as i32,
        i32::from(c) << 1 | (a >> 31) as i32,
    ]
}

impl Shifted for Fast {
    const BITS: [u32; TRIPLES] = [15, 9];

    fn entry_words(size: usize) -> usize {
        size * 9 / 4
    }

    fn put(size: usize, lane: usize, delta: [i32; POSE_FLOATS], deltas: &mut [u32]) {
        let (a, b, c) = pack_vertex(delta);
        deltas[lane] = a;
        deltas[size + lane] = b;
        deltas[2 * size + lane / 4] |= u32::from(c) << (8 * (lane % 4));
    }

    #[inline(always)]
    fn for_each(size: usize, deltas: &[u32], mut f: impl FnMut(usize, [i32; POSE_FLOATS])) {
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
