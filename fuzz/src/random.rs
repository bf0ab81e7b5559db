//! Random numbers for mutations, and special values for numbers in files.

use deltamorph_head::Rng;

pub struct Random(Rng);

impl Random {
    pub fn new(seed: u32) -> Self {
        Self(Rng::new(seed.into(), 0))
    }

    /// Returns a number below `end`, which is not 0.
    pub fn below(&mut self, end: usize) -> usize {
        self.0.below(end)
    }

    pub fn choose<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }

    /// Replaces one of the words of `bytes` by a value that often causes errors.
    pub fn change_word(&mut self, bytes: &mut [u8]) {
        let words = bytes.as_chunks_mut::<4>().0;
        if words.is_empty() {
            return;
        }
        let (at, other) = (self.below(words.len()), self.below(words.len()));
        let (old, other) = (u32::from_le_bytes(words[at]), u32::from_le_bytes(words[other]));
        let bit = 1u32 << self.below(32);
        let float = *self.choose(&[0.0, 1.0, 65536.0, f32::NAN, f32::INFINITY, f32::MAX, f32::MIN_POSITIVE, 1e-45]);
        let new = *self.choose(&[0, 1, u32::MAX, bit, other, !old, old ^ bit, float.to_bits()]);
        let near = *self.choose(&[old.wrapping_add(1), old.wrapping_sub(1), old.wrapping_mul(2), old / 2]);
        words[at] = (*self.choose(&[new, near])).to_le_bytes();
    }
}
