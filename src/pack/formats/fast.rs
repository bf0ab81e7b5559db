//! In blocks, 9 bytes per vertex. GLSL: `glsl/formats/fast.glsl`.
//!
//! ```text
//! header [shifts]                   a[size] b[size] c[size / 4]
//!   a = x:15 y:15 ny0:1 nz0:1   b = z:15 nx:9 ny8..1:8   c = nz8..1:8
//! ```

use super::shifts::{Shifted, field};
use crate::asset::streams::TRIPLES;
use crate::pack::POSE_FLOATS;
use std::ops::Range;

pub(crate) struct Fast;

impl Shifted for Fast {
    const BITS: [u32; TRIPLES] = [15, 9];

    fn entry_words(size: usize) -> usize {
        size * 9 / 4
    }

    fn put(size: usize, lane: usize, delta: [i32; POSE_FLOATS], deltas: &mut [u32]) {
        let [x, y, z, nx, ny, nz] = delta.map(|v| v as u32);
        deltas[lane] = (x & 0x7fff) | (y & 0x7fff) << 15 | (ny & 1) << 30 | (nz & 1) << 31;
        deltas[size + lane] = (z & 0x7fff) | (nx & 0x1ff) << 15 | (ny >> 1) << 24;
        deltas[2 * size + lane / 4] |= (nz >> 1 & 0xff) << (8 * (lane % 4));
    }

    #[inline(always)]
    fn for_each(size: usize, lanes: Range<usize>, deltas: &[u32], mut f: impl FnMut(usize, [i32; POSE_FLOATS])) {
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
            f(lane, [field(a, 0, 15), field(a, 15, 15), field(b, 0, 15), field(b, 15, 9), ny, nz]);
        }
    }
}
