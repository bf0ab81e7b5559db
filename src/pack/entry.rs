//! Entries of block formats: the deltas of one target in one block, as integers in units of the mesh's steps.
//!
//! The same arithmetic is in `glsl/entry.glsl`.
//!
//! ```text
//! fast    header [shifts]                   a[size] b[size] c[size / 4]
//!           a = x:15 y:15 ny0:1 nz0:1   b = z:15 nx:9 ny8..1:8   c = nz8..1:8
//!         positions × 2^shift (bits 0..8 of the header), normals × 2^shift (bits 8..16)
//! small   header [first word][widths][mask × size/32]   records of the vertices in the mask, bit after bit
//!           widths = 5 bits for each component; a record = x y z nx ny nz, signed
//! float32 no header                         px[size] py[size] pz[size] nx[size] ny[size] nz[size]
//! ```

use super::POSE_FLOATS;

/// Bits of a fast position component and of a fast normal component.
pub(crate) const FAST_BITS: [u32; 2] = [15, 9];
/// Most bits of a small position component and of a small normal component: a record has 96 at most.
pub(crate) const SMALL_BITS: [u32; 2] = [18, 14];

/// Bits that `value` takes as a two's complement number; 0 for 0.
pub(crate) fn width(value: i32) -> u32 {
    if value == 0 { 0 } else { 33 - (if value < 0 { !value } else { value }).leading_zeros() }
}

/// `value`'s low `bits` bits as a signed number.
fn sign_extend(value: u32, bits: u32) -> i32 {
    if bits == 0 { 0 } else { ((value << (32 - bits)) as i32) >> (32 - bits) }
}

/// The words a and b and the byte c of a fast delta.
pub(crate) fn fast_encode(q: [i32; POSE_FLOATS]) -> (u32, u32, u8) {
    let [x, y, z, nx, ny, nz] = q.map(|v| v as u32);
    let a = (x & 0x7fff) | (y & 0x7fff) << 15 | (ny & 1) << 30 | (nz & 1) << 31;
    let b = (z & 0x7fff) | (nx & 0x1ff) << 15 | (ny >> 1) << 24;
    (a, b, (nz >> 1) as u8)
}

/// The reverse of [`fast_encode`].
#[inline(always)]
pub(crate) fn fast_decode(a: u32, b: u32, c: i8) -> [i32; POSE_FLOATS] {
    let field = |word: u32, at: u32, bits: u32| ((word << (32 - at - bits)) as i32) >> (32 - bits);
    [
        field(a, 0, 15),
        field(a, 15, 15),
        field(b, 0, 15),
        field(b, 15, 9),
        ((b as i32) >> 24) << 1 | ((a >> 30) & 1) as i32,
        i32::from(c) << 1 | (a >> 31) as i32,
    ]
}

/// Bit widths of the components of a small record, in one word.
pub(crate) fn pack_widths(widths: [u32; POSE_FLOATS]) -> u32 {
    widths.iter().enumerate().fold(0, |word, (i, w)| word | w << (5 * i))
}

/// The reverse of [`pack_widths`].
pub(crate) fn unpack_widths(word: u32) -> [u32; POSE_FLOATS] {
    std::array::from_fn(|i| word >> (5 * i) & 31)
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
        fn fast_deltas_come_back(p in prop::array::uniform3(-16384i32..16384), n in prop::array::uniform3(-256i32..256)) {
            let q = [p[0], p[1], p[2], n[0], n[1], n[2]];
            let (a, b, c) = fast_encode(q);
            prop_assert_eq!(fast_decode(a, b, c as i8), q);
        }

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
        let widths = [0, 18, 3, 14, 1, 31];
        assert_eq!(unpack_widths(pack_widths(widths)), widths);
    }
}
