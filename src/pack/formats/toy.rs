//! In blocks, 12 bytes per vertex: three words. GLSL: `glsl/formats/toy.glsl`.
//!
//! ```text
//! header [shifts]                   [vertex][a b c]
//!   a = x:16 y:16                     b = z:16 nx:16                    c = ny:16 nz:16
//! ```

use super::shifts::{Shifted, field};
use crate::asset::streams::TRIPLES;
use crate::pack::POSE_FLOATS;

pub(crate) struct Toy;

impl Shifted for Toy {
    const BITS: [u32; TRIPLES] = [16, 16];

    fn entry_words(size: usize) -> usize {
        size * 3
    }

    fn put(_: usize, lane: usize, delta: [i32; POSE_FLOATS], deltas: &mut [u32]) {
        for (word, two) in deltas[3 * lane..].iter_mut().zip(delta.as_chunks::<2>().0) {
            *word = (two[0] as u32 & 0xffff) | (two[1] as u32) << 16;
        }
    }

    #[inline(always)]
    fn for_each(size: usize, deltas: &[u32], mut f: impl FnMut(usize, [i32; POSE_FLOATS])) {
        for (lane, words) in deltas.as_chunks::<3>().0[..size].iter().enumerate() {
            f(lane, std::array::from_fn(|i| field(words[i / 2], i as u32 % 2 * 16, 16)));
        }
    }
}
