//! Integers of any number of bits, one after the other in 32-bit words.

/// Bits that `value` takes as a two's complement number; 0 for 0.
pub(crate) fn width(value: i32) -> u32 {
    if value == 0 { 0 } else { 33 - (if value < 0 { !value } else { value }).leading_zeros() }
}

/// `value`'s low `bits` bits as a signed number.
fn sign_extend(value: u32, bits: u32) -> i32 {
    if bits == 0 { 0 } else { ((value << (32 - bits)) as i32) >> (32 - bits) }
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

/// Reads fields bit after bit, each word once.
pub(crate) struct BitReader<'a> {
    words: std::slice::Iter<'a, u32>,
    held: u64,
    bits: u32,
}

impl<'a> BitReader<'a> {
    pub fn new(words: &'a [u32]) -> Self {
        Self { words: words.iter(), held: 0, bits: 0 }
    }

    /// The next `bits` (≤ 31) bits as a signed number; zeros after the end.
    #[inline(always)]
    pub fn take(&mut self, bits: u32) -> i32 {
        if self.bits < bits {
            self.held |= u64::from(self.words.next().copied().unwrap_or(0)) << self.bits;
            self.bits += 32;
        }
        let value = sign_extend(self.held as u32, bits);
        self.held >>= bits;
        self.bits -= bits;
        value
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
            let mut reader = BitReader::new(&writer.words);
            for v in &values {
                prop_assert_eq!(reader.take(width(*v)), *v);
            }
        }
    }

    #[test]
    fn widths() {
        assert_eq!([0, 1, -1, 2, -2, -3, 127, -128].map(width), [0, 2, 1, 3, 2, 3, 8, 8]);
    }
}
