//! In blocks, as few bits as an entry needs. The same in `glsl/formats/small.glsl`.
//!
//! ```text
//! header [first word][widths][mask × size/32]   records of the vertices in the mask, bit after bit
//!   widths = 5 bits for each component; a record = six signed integers, 96 bits at most
//! ```

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

    fn is_sparse(&self) -> bool {
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

/// Bits that `value` takes as a two's complement number; 0 for 0.
fn width(value: i32) -> u32 {
    if value == 0 { 0 } else { 33 - (if value < 0 { !value } else { value }).leading_zeros() }
}

/// Append fields bit after bit, low bits first.
#[derive(Default)]
struct BitWriter {
    words: Vec<u32>,
    used: u32,
}

impl BitWriter {
    /// Append the low `bits` bits of `value`.
    fn put(&mut self, value: i32, bits: u32) {
        for i in 0..bits {
            if self.used.is_multiple_of(32) {
                self.words.push(0);
            }
            let last = self.words.len() - 1;
            self.words[last] |= ((value as u32 >> i) & 1) << (self.used % 32);
            self.used += 1;
        }
    }
}

/// A signed integer of a record: which of its bits.
struct Field {
    at: usize,
    mask: u32,
    sign: u32,
}

impl Field {
    /// `bits` (≤ 31) bits from bit `at` of a record on.
    fn new(at: usize, bits: u32) -> Self {
        let values = 1u32 << bits;
        Self { at, mask: values - 1, sign: values >> 1 }
    }

    /// The integer in the record that begins at bit `record` of `words`; zeros after their end. No branch depends on
    /// the number of bits: those would be mispredicted.
    #[inline(always)]
    fn read(&self, words: &[u32], record: usize) -> i32 {
        let at = record + self.at;
        let word = at / 32;
        let two = match words.get(word..word + 2) {
            Some(&[low, high]) => u64::from(low) | u64::from(high) << 32,
            _ => words.get(word).map_or(0, |last| u64::from(*last)),
        };
        let bits = (two >> (at % 32)) as u32 & self.mask;
        (bits ^ self.sign).wrapping_sub(self.sign) as i32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bits_come_back(values in prop::collection::vec(-100_000i32..100_000, 0..50)) {
            let mut writer = BitWriter::default();
            values.iter().for_each(|v| writer.put(*v, width(*v)));
            let mut at = 0;
            for v in &values {
                prop_assert_eq!(Field::new(7, width(*v)).read(&[&[0][..], &writer.words].concat(), at + 25), *v);
                at += width(*v) as usize;
            }
        }
    }

    #[test]
    fn widths() {
        assert_eq!([0, 1, -1, 2, -2, -3, 127, -128].map(width), [0, 2, 1, 3, 2, 3, 8, 8]);
        let widths = [0, 18, 3, 14, 1, 31];
        assert_eq!(unpack_widths(pack_widths(widths)), widths);
    }
}
