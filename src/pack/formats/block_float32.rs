//! In blocks, six float32. GLSL: `glsl/formats/block_float32.glsl`.
//!
//! ```text
//! no header    px[size] py[size] pz[size] nx[size] ny[size] nz[size]
//! ```

use super::{BlockFormat, Lane, fixed};
use crate::asset::streams::TRIPLES;
use crate::pack::POSE_FLOATS;
use std::ops::Range;

pub(crate) struct BlockFloat32;

impl BlockFormat for BlockFloat32 {
    fn steps(&self, _: [f64; TRIPLES], _: [f64; TRIPLES]) -> [f32; TRIPLES] {
        [1.0; TRIPLES]
    }

    fn header_words(&self) -> usize {
        0
    }

    fn words(&self, entry: usize, _: &[u32], _: &[u32], size: usize) -> Range<usize> {
        fixed(entry, size * POSE_FLOATS)
    }

    fn encode(&self, size: usize, _: [f32; TRIPLES], lanes: &[Lane], [_, deltas]: [&mut Vec<u32>; 2]) {
        let at = deltas.len();
        deltas.resize(at + size * POSE_FLOATS, 0);
        for (lane, delta) in lanes {
            for (c, value) in delta.iter().enumerate() {
                deltas[at + c * size + *lane as usize] = value.to_bits();
            }
        }
    }

    fn check_header(&self, _: &[u32]) -> Result<[u32; TRIPLES], String> {
        Ok([0; TRIPLES])
    }

    fn check_deltas(&self, deltas: &[u32]) -> Result<(), String> {
        let bad = deltas.iter().map(|word| f32::from_bits(*word)).enumerate().find(|(_, delta)| !delta.is_finite());
        bad.map_or(Ok(()), |(at, delta)| Err(format!("word {at} of the deltas is {delta}")))
    }

    type Component = f32;

    // Plane by plane, in memory order: vertex by vertex takes 1.4 times as long when few targets change.
    #[inline(always)]
    fn decode(
        &self,
        size: usize,
        lanes: Range<usize>,
        _: &[u32],
        deltas: &[u32],
        mut f: impl FnMut(usize, usize, f32),
    ) {
        for (c, plane) in deltas.chunks_exact(size).enumerate().take(POSE_FLOATS) {
            let plane = &plane[..lanes.end];
            for lane in lanes.clone() {
                f(lane, c, f32::from_bits(plane[lane]));
            }
        }
    }
}
