//! Integers of any number of bits, one after the other in 32-bit words.

/// Bits that `value` takes as a two's complement number; 0 for 0.
pub(crate) fn width(value: i32) -> u32 {
    if value == 0 { 0 } else { 33 - (if value < 0 { !value } else { value }).leading_zeros() }
}

/// Append fields bit after bit, low bits first.
#[derive(Default)]
pub(crate) struct BitWriter {
    pub words: Vec<u32>,
    used: u32,
}

impl BitWriter {
    /// Append the low `bits` bits of `value`.
    pub fn put(&mut self, value: i32, bits: u32) {
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
pub(crate) struct Field {
    at: usize,
    mask: u32,
    sign: u32,
}

impl Field {
    /// `bits` (≤ 31) bits from bit `at` of a record on.
    pub fn new(at: usize, bits: u32) -> Self {
        let values = 1u32 << bits;
        Self { at, mask: values - 1, sign: values >> 1 }
    }

    /// The integer in the record that begins at bit `record` of `words`; zeros after their end. No branch depends on
    /// the number of bits: those would be mispredicted.
    #[inline(always)]
    pub fn read(&self, words: &[u32], record: usize) -> i32 {
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
    }
}
