//! In blocks, 8 bytes per vertex: a pair of words. GLSL: `glsl/formats/pair.glsl`.
//!
//! ```text
//! header [shifts]                   [vertex][a b]
//!   a = x:13 y:13 nz4..0:5 zero:1   b = z:13 nx:8 ny:8 nz7..5:3
//! ```

use super::shifts::{Shifted, field};
use crate::asset::streams::TRIPLES;
use crate::pack::POSE_FLOATS;
use std::ops::Range;

pub(crate) struct Pair;

impl Shifted for Pair {
    const BITS: [u32; TRIPLES] = [13, 8];

    fn entry_words(size: usize) -> usize {
        size * 2
    }

    fn put(_: usize, lane: usize, delta: [i32; POSE_FLOATS], deltas: &mut [u32]) {
        let [x, y, z, nx, ny, nz] = delta.map(|v| v as u32);
        deltas[2 * lane] = (x & 0x1fff) | (y & 0x1fff) << 13 | (nz & 0x1f) << 26;
        deltas[2 * lane + 1] = (z & 0x1fff) | (nx & 0xff) << 13 | (ny & 0xff) << 21 | (nz >> 5) << 29;
    }

    fn check_deltas(deltas: &[u32]) -> Result<(), String> {
        let bad = deltas.iter().enumerate().step_by(2).find(|(_, a)| *a >> 31 != 0);
        bad.map_or(Ok(()), |(at, word)| Err(format!("word {at} of the deltas is {word:#x}")))
    }

    #[inline(always)]
    fn for_each(_: usize, lanes: Range<usize>, deltas: &[u32], mut f: impl FnMut(usize, [i32; POSE_FLOATS])) {
        let pairs = &deltas.as_chunks().0[..lanes.end];
        for lane in lanes {
            let [a, b] = pairs[lane];
            let nz = field(b, 29, 3) << 5 | (a >> 26) as i32;
            f(lane, [field(a, 0, 13), field(a, 13, 13), field(b, 0, 13), field(b, 13, 8), field(b, 21, 8), nz]);
        }
    }
}
