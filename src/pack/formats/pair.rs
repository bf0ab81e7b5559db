//! In blocks, 8 bytes a vertex: a pair of words. The same in `glsl/formats/pair.glsl`.
//!
//! ```text
//! header [shifts]                   [vertex][a b]
//!   a = x:13 y:13 nz4..0:5 zero:1   b = z:13 nx:8 ny:8 nz7..5:3
//! ```

use super::shifts::{Shifted, field};
use crate::asset::streams::TRIPLES;
use crate::pack::POSE_FLOATS;

pub(crate) struct Pair;

/// The words a and b of a delta.
fn pack_vertex(q: [i32; POSE_FLOATS]) -> [u32; 2] {
    let [x, y, z, nx, ny, nz] = q.map(|v| v as u32);
    let a = (x & 0x1fff) | (y & 0x1fff) << 13 | (nz & 0x1f) << 26;
    let b = (z & 0x1fff) | (nx & 0xff) << 13 | (ny & 0xff) << 21 | (nz >> 5) << 29;
    [a, b]
}

/// The reverse of [`pack_vertex`].
#[inline(always)]
fn unpack_vertex([a, b]: [u32; 2]) -> [i32; POSE_FLOATS] {
    let nz = field(b, 29, 3) << 5 | (a >> 26) as i32;
    [field(a, 0, 13), field(a, 13, 13), field(b, 0, 13), field(b, 13, 8), field(b, 21, 8), nz]
}

impl Shifted for Pair {
    const BITS: [u32; TRIPLES] = [13, 8];

    fn entry_words(size: usize) -> usize {
        size * 2
    }

    fn put(_: usize, lane: usize, delta: [i32; POSE_FLOATS], deltas: &mut [u32]) {
        deltas[2 * lane..][..2].copy_from_slice(&pack_vertex(delta));
    }

    fn check_deltas(deltas: &[u32]) -> Result<(), String> {
        match deltas.iter().step_by(2).position(|a| a >> 31 != 0) {
            Some(vertex) => Err(format!("word {} of the deltas is {:#x}", 2 * vertex, deltas[2 * vertex])),
            None => Ok(()),
        }
    }

    #[inline(always)]
    fn for_each(size: usize, deltas: &[u32], mut f: impl FnMut(usize, [i32; POSE_FLOATS])) {
        for (lane, pair) in deltas.as_chunks::<2>().0[..size].iter().enumerate() {
            f(lane, unpack_vertex(*pair));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn deltas_come_back(p in prop::array::uniform3(-4096i32..4096), n in prop::array::uniform3(-128i32..128)) {
            let q = [p[0], p[1], p[2], n[0], n[1], n[2]];
            let words = pack_vertex(q);
            prop_assert_eq!(words[0] >> 31, 0);
            prop_assert_eq!(unpack_vertex(words), q);
        }
    }
}
