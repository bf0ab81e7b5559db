//! In blocks, as few bits as an entry needs. The same in `glsl/formats/small.glsl`.
//!
//! ```text
//! header [first word][widths][mask × size/32]   records of the vertices in the mask, bit after bit
//!   widths = 5 bits for each component; a record = six signed integers, 96 bits at most
//! ```

use super::bits::{BitWriter, Field, width};
use super::{BlockFormat, INTEGER_BITS, Lane, quantise};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::POSE_FLOATS;
use std::ops::Range;

pub(crate) struct Small;

/// Bit widths of the components of a record, in one word.
fn pack_widths(widths: [u32; POSE_FLOATS]) -> u32 {
    widths.iter().enumerate().fold(0, |word, (i, w)| word | w << (5 * i))
}

/// The reverse of [`pack_widths`].
fn unpack_widths(word: u32) -> [u32; POSE_FLOATS] {
    std::array::from_fn(|i| word >> (5 * i) & 31)
}

impl BlockFormat for Small {
    fn default_size(&self) -> u32 {
        32
    }

    fn refines(&self) -> bool {
        true
    }

    fn header_words(&self, size: usize) -> usize {
        2 + size / 32
    }

    fn words(&self, _: usize, header: &[u32], _: usize) -> Range<usize> {
        let record: u32 = unpack_widths(header[1]).iter().sum();
        let vertices: u32 = header[2..].iter().map(|m| m.count_ones()).sum();
        let first = header[0] as usize;
        first..first.saturating_add((record * vertices).div_ceil(32) as usize)
    }

    fn encode(&self, size: usize, steps: [f32; TRIPLES], lanes: &[Lane], [headers, deltas]: [&mut Vec<u32>; 2]) {
        let mut mask = vec![0u32; size / 32];
        let mut widths = [0u32; POSE_FLOATS];
        let mut kept = vec![];
        for (lane, delta) in lanes {
            let q: [i32; POSE_FLOATS] = std::array::from_fn(|i| quantise(delta[i], f64::from(steps[i / TRIPLE])));
            if q != [0; POSE_FLOATS] {
                mask[*lane as usize / 32] |= 1 << (lane % 32);
                widths = std::array::from_fn(|i| widths[i].max(width(q[i])));
                kept.push(q);
            }
        }
        headers.extend([deltas.len() as u32, pack_widths(widths)]);
        headers.append(&mut mask);
        let mut bits = BitWriter::default();
        for q in kept {
            q.iter().zip(widths).for_each(|(v, w)| bits.put(*v, w));
        }
        deltas.append(&mut bits.words);
    }

    fn check_header(&self, header: &[u32]) -> Result<[u32; TRIPLES], String> {
        let widths = unpack_widths(header[1]);
        if header[1] >> 30 != 0 || widths.iter().enumerate().any(|(i, w)| *w > INTEGER_BITS[i / TRIPLE]) {
            return Err(format!("components of {widths:?} bits"));
        }
        Ok(INTEGER_BITS)
    }

    type Component = i32;

    #[inline(always)]
    fn decode(&self, _: usize, header: &[u32], deltas: &[u32], mut f: impl FnMut(usize, usize, i32)) {
        let mut record = 0;
        let fields = unpack_widths(header[1]).map(|width| {
            record += width as usize;
            Field::new(record - width as usize, width)
        });
        let mut at = 0;
        for (word, &mask) in header[2..].iter().enumerate() {
            let mut rest = mask;
            while rest != 0 {
                let lane = 32 * word + rest.trailing_zeros() as usize;
                rest &= rest - 1;
                for (c, field) in fields.iter().enumerate() {
                    f(lane, c, field.read(deltas, at));
                }
                at += record;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_come_back() {
        let widths = [0, 18, 3, 14, 1, 31];
        assert_eq!(unpack_widths(pack_widths(widths)), widths);
    }
}
