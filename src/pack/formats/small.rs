//! In blocks, with the fewest bits that an entry needs. GLSL: `glsl/formats/small.glsl`.
//!
//! ```text
//! header [first word][a word for each triple]   deltas [mask × size/32, if any][records, bit after bit]
//!   a word = 5 bits of width for each component, then 5 bits of offset for each; the highest bit of the first triple's
//!   word says that there is a mask of the vertices with a record; otherwise all have one
//!   a record = six unsigned integers, 96 bits at most
//! component = (offset · 2^width) / 8, rounded down, + integer
//! ```
//!
//! A target mostly moves the vertices of a block alike; the offset keeps their common part out of the records. Offsets
//! in eighths of an integer's range cost no more integer bits than exact minima would.

use super::{BlockFormat, INTEGER_BITS, Integers, Lane, quantise};
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::error::ensure;
use crate::pack::POSE_FLOATS;
use bytemuck::cast_slice;
use fearless_simd::prelude::*;
use fearless_simd::{i32x8, u32x8};
use std::ops::Range;

pub(crate) struct Small;

/// Bit of the first triple's word: only vertices in the mask have a record.
const MASKED: u32 = 1 << 31;

/// Vertices decoded at a time, those of a word of the mask.
pub(crate) const LANES: usize = u32::BITS as usize;
/// Where their records begin at most, or more: a power of two costs one instruction to check.
pub(crate) const BYTES: usize = 512;
/// Their bytes, and those that are read with the last record.
const WINDOW: usize = BYTES + 16;

/// Bits of a width and of an offset.
const BITS: u32 = 5;

/// Encoding of a component in an entry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Field {
    width: u32,
    /// Component value of integer 0.
    least: i32,
}

impl Field {
    fn new(width: u32, offset: i32) -> Self {
        Self { width, least: offset << width >> 3 }
    }

    /// Reads the field of a component from its triple's word.
    #[inline(always)]
    fn of(word: u32, component: usize) -> Self {
        let at = BITS * component as u32;
        let offset = (word << (32 - 4 * BITS - at)) as i32 >> (32 - BITS);
        Self::new(word >> at & ((1 << BITS) - 1), offset)
    }

    /// The fewest bits for components from `low` to `high`, and the offset.
    fn fitting(low: i32, high: i32) -> (u32, i32) {
        let most = (1 << (BITS - 1)) - 1;
        let fits = |width: u32| {
            // The largest offset not above `low`.
            let offset = ((((low + 1) << 3) - 1) >> width).min(most);
            let reached = Self::new(width, offset).least + (1 << width);
            (offset >= -most - 1 && high < reached).then_some((width, offset))
        };
        // At full width, every valid component fits.
        let least = 32 - (high - low).max(0).leading_zeros();
        (least..INTEGER_BITS[0]).find_map(fits).unwrap_or((INTEGER_BITS[0], low >> (INTEGER_BITS[0] - 3)))
    }
}

/// The fewest bits of an entry of `vertices` records, with components from `low` to `high`.
pub(crate) fn entry_bits(size: usize, vertices: usize, low: &[i32], high: &[i32]) -> usize {
    let record: u32 = low.iter().zip(high).map(|(low, high)| Field::fitting(*low, *high).0).sum();
    let mask = if vertices < size { size / LANES } else { 0 };
    32 * (Small.header_words() + mask + (record as usize * vertices).div_ceil(32))
}

/// Rounds the deltas of an entry to steps, not always to the nearest: where records then have fewer bits, and no delta
/// is off by more than its `slack`, by triple. Zero stays zero.
pub(crate) fn narrow(steps: [f32; TRIPLES], lanes: &mut [Lane], slack: &[[f64; TRIPLES]]) {
    for (triple, step) in steps.map(f64::from).into_iter().enumerate() {
        let exact = |(_, delta): &Lane| -> [f64; TRIPLE] {
            std::array::from_fn(|i| f64::from(delta[TRIPLE * triple + i]) / step)
        };
        let nearest = |(_, delta): &Lane| std::array::from_fn(|i| quantise(delta[TRIPLE * triple + i], step));
        let mut rounded: Vec<[i32; TRIPLE]> = lanes.iter().map(nearest).collect();
        for c in 0..TRIPLE {
            let bounds = lanes.iter().zip(slack).zip(&rounded).map(|((lane, slack), rounded)| {
                let exact = exact(lane);
                let nearest = rounded[c];
                let off = |i: usize| (exact[i] - f64::from(rounded[i])).powi(2);
                let others: f64 = (0..TRIPLE).filter(|i| *i != c).map(off).sum();
                let reach = ((slack[triple] / step).powi(2) - others).max(0.0).sqrt();
                let [low, high] = [(exact[c] - reach).ceil() as i32, (exact[c] + reach).floor() as i32];
                if exact[c] == 0.0 { (0, 0) } else { (low.min(nearest), high.max(nearest)) }
            });
            // From where the last one may begin to where the first one has to end.
            let (low, high) = bounds.fold((i32::MAX, i32::MIN), |(a, b), (low, high)| (a.min(high), b.max(low)));
            let components = || rounded.iter().map(|q| q[c]);
            let widest = Field::fitting(components().min().unwrap_or(0), components().max().unwrap_or(0)).0;
            let (width, offset) = Field::fitting(low, high);
            if width < widest {
                let least = Field::new(width, offset).least;
                rounded.iter_mut().for_each(|q| q[c] = q[c].clamp(least, least + (1 << width) - 1));
            }
        }
        for ((_, delta), rounded) in lanes.iter_mut().zip(rounded) {
            let delta = delta[TRIPLE * triple..].iter_mut();
            delta.zip(rounded).for_each(|(delta, rounded)| *delta = (f64::from(rounded) * step) as f32);
        }
    }
}

/// The components of a record.
#[inline(always)]
fn fields(header: &[u32]) -> [Field; POSE_FLOATS] {
    std::array::from_fn(|c| Field::of(header[1 + c / TRIPLE], c % TRIPLE))
}

/// Where the components of a record begin, and in the last two bytes where it ends, a byte each.
#[inline(always)]
fn begins(header: &[u32]) -> u64 {
    // The widths, five bits each, of a triple from bits 0 and 24 on; then from that of their byte on.
    let fives = u64::from(header[1] & 0x7fff) | u64::from(header[2]) << 24;
    let widths = fives & 0x1f_00001f | (fives & 0x3e0_0003e0) << 3 | (fives & 0x7c00_007c00) << 6;
    widths.wrapping_mul(0x0101_0101_0101_0100)
}

/// The records of an entry.
pub(crate) struct Records<'a> {
    /// A byte for each component, and two for their end.
    pub begins: u64,
    words: [u32; TRIPLES],
    /// Empty: all vertices have one.
    masks: &'a [u32],
    bytes: &'a [u8],
}

impl<'a> Records<'a> {
    #[inline(always)]
    pub fn new(size: usize, header: &[u32], deltas: &'a [u32]) -> Self {
        let (masks, records) = deltas.split_at(if header[1] & MASKED == 0 { 0 } else { size / LANES });
        Self { begins: begins(header), words: [header[1], header[2]], masks, bytes: cast_slice(records) }
    }

    /// Of each component the largest integer, and the value of integer 0: a [`Field`] in a lane, the last two of which
    /// mean nothing.
    #[inline(always)]
    pub fn fields<V: Simd>(&self, simd: V) -> (u32x8<V>, i32x8<V>) {
        let [first, second] = self.words;
        let words = u32x8::simd_from(simd, [first, first, first, second, second, second, second, second]);
        let widths = (words >> u32x8::simd_from(simd, [0, 5, 10, 0, 5, 10, 0, 0])) & ((1 << BITS) - 1);
        let offsets: i32x8<V> = (words << u32x8::simd_from(simd, [12, 7, 2, 12, 7, 2, 0, 0])).bitcast();
        let least = ((offsets >> (32 - BITS)) << widths.bitcast::<i32x8<V>>()) >> 3;
        (!(u32x8::splat(simd, u32::MAX) << widths), least)
    }

    /// Which of the vertices from `word` · 32 on have a record.
    #[inline(always)]
    pub fn mask(&self, word: usize) -> u32 {
        self.masks.get(word).copied().unwrap_or(u32::MAX)
    }

    /// The bytes from that of bit `from` on; `last` is for the last ones of a mesh, with zeros behind them.
    #[inline(always)]
    pub fn window<'b>(&'b self, from: u32, last: &'b mut Option<[u8; WINDOW]>) -> &'b [u8; WINDOW] {
        let rest = &self.bytes[from as usize / 8..];
        rest.first_chunk().unwrap_or_else(|| last.insert(at_end(rest)))
    }
}

#[cold]
#[inline(never)]
fn at_end(records: &[u8]) -> [u8; WINDOW] {
    let mut bytes = [0; WINDOW];
    bytes[..records.len()].copy_from_slice(records);
    bytes
}

impl BlockFormat for Small {
    fn default_size(&self) -> u32 {
        32
    }

    fn refines(&self) -> bool {
        true
    }

    fn header_words(&self) -> usize {
        1 + TRIPLES
    }

    #[inline(always)]
    fn words(&self, _: usize, header: &[u32], deltas: &[u32], size: usize) -> Range<usize> {
        let first = header[0] as usize;
        let (masks, vertices) = if header[1] & MASKED == 0 {
            (0, size)
        } else {
            let masks = deltas.get(first..first + size / LANES).unwrap_or_default();
            (size / LANES, masks.iter().map(|mask| mask.count_ones() as usize).sum())
        };
        let bits = (begins(header) >> 56) as usize * vertices;
        first..first.saturating_add(masks + bits.div_ceil(32))
    }

    fn encode(&self, size: usize, steps: [f32; TRIPLES], lanes: &[Lane], [headers, deltas]: [&mut Vec<u32>; 2]) {
        let mut mask = vec![0u32; size / 32];
        let mut kept: Vec<Integers> = vec![];
        for (lane, delta) in lanes {
            let q = std::array::from_fn(|i| quantise(delta[i], f64::from(steps[i / TRIPLE])));
            if q != [0; POSE_FLOATS] {
                mask[*lane as usize / 32] |= 1 << (lane % 32);
                kept.push(q);
            }
        }
        let mut words = [0; TRIPLES];
        let fields: [Field; POSE_FLOATS] = std::array::from_fn(|c| {
            let components = || kept.iter().map(|q| q[c]);
            let (width, offset) = Field::fitting(components().min().unwrap_or(0), components().max().unwrap_or(0));
            let code = offset as u32 & ((1 << BITS) - 1);
            words[c / TRIPLE] |= (width | code << (TRIPLE as u32 * BITS)) << (BITS * (c % TRIPLE) as u32);
            Field::new(width, offset)
        });
        if kept.len() < size {
            words[0] |= MASKED;
        }
        headers.extend([&[deltas.len() as u32][..], &words].concat());
        if kept.len() < size {
            deltas.append(&mut mask);
        }
        let mut bits = BitWriter::default();
        for q in kept {
            q.iter().zip(fields).for_each(|(v, field)| bits.put((v - field.least) as u32, field.width));
        }
        deltas.append(&mut bits.words);
    }

    fn check_header(&self, header: &[u32]) -> Result<[u32; TRIPLES], String> {
        let fields = fields(header);
        let widths = fields.map(|field| field.width);
        let spare = (header[1] & !MASKED | header[2]) >> (2 * TRIPLE as u32 * BITS);
        let fits = widths.iter().enumerate().all(|(c, w)| *w <= INTEGER_BITS[c / TRIPLE]);
        ensure!(spare == 0 && fits, format!("components of {widths:?} bits"));
        let largest =
            |field: &Field| field.least.unsigned_abs().max((field.least + (1 << field.width) - 1).unsigned_abs());
        let bits = |triple: &[Field]| triple.iter().map(|field| 32 - largest(field).leading_zeros()).max();
        Ok(std::array::from_fn(|triple| bits(&fields[TRIPLE * triple..][..TRIPLE]).unwrap_or(0)))
    }

    #[inline(always)]
    fn has_records(&self) -> bool {
        true
    }

    // Of all vertices first the 32 bits in which there are the next components, then these components, in loops that
    // vectorize.
    #[inline(always)]
    fn decode(
        &self,
        size: usize,
        _: Range<usize>,
        header: &[u32],
        deltas: &[u32],
        mut f: impl FnMut(usize, usize, i32),
    ) {
        let records = Records::new(size, header, deltas);
        let fields = fields(header);
        let mut from = 0;
        let bits = (begins(header) >> 56) as u32;
        for word in 0..size / LANES {
            let mask = records.mask(word);
            let last = &mut None;
            let bytes = records.window(from, last);
            let read = |at: u32| {
                let bytes = bytes[at as usize / 8 % BYTES..].first_chunk().unwrap_or(&[0; 8]);
                (u64::from_le_bytes(*bytes) >> (at % 8)) as u32
            };
            let mut moves = [0; LANES];
            (0..LANES).for_each(|lane| moves[lane] = -((mask >> lane & 1) as i32));
            let mut windows = [0; LANES];
            let mut begin = 0;
            let mut end = 0;
            for (c, Field { width, least }) in fields.into_iter().enumerate() {
                if c == 0 || end + width - begin > u32::BITS {
                    begin = end;
                    let mut at = from % 8 + begin;
                    if mask == u32::MAX {
                        (0..LANES).for_each(|lane| windows[lane] = read(at + lane as u32 * bits));
                    } else {
                        let mut rest = mask;
                        while rest != 0 {
                            windows[rest.trailing_zeros() as usize % LANES] = read(at);
                            rest &= rest - 1;
                            at += bits;
                        }
                    }
                }
                let shift = (end - begin) % u32::BITS;
                let largest = (1 << width) - 1;
                end += width;
                for lane in 0..LANES {
                    let integer = windows[lane] >> shift & largest;
                    f(word * LANES + lane, c, (least + integer as i32) & moves[lane]);
                }
            }
            from += mask.count_ones() * bits;
        }
    }
}

/// Appends bit fields, low bits first.
#[derive(Default)]
struct BitWriter {
    words: Vec<u32>,
    used: u32,
}

impl BitWriter {
    fn put(&mut self, value: u32, bits: u32) {
        for i in 0..bits {
            if self.used.is_multiple_of(32) {
                self.words.push(0);
            }
            let last = self.words.len() - 1;
            self.words[last] |= ((value >> i) & 1) << (self.used % 32);
            self.used += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Ranges of components, narrow or wide, of either sign.
    fn bounds(bits: u32) -> impl Strategy<Value = (i32, i32)> {
        (0..bits, any::<i32>(), any::<i32>()).prop_map(move |(shift, a, b)| {
            let [a, b] = [a, b].map(|v| v >> (32 - bits));
            (a.min(b) >> shift, a.min(b).max(a.max(b) >> shift) >> shift)
        })
    }

    proptest! {
        #[test]
        fn deltas_come_back(
            size in prop::sample::select(vec![32usize, 64, 128]),
            bounds in [bounds(18), bounds(18), bounds(18), bounds(14), bounds(14), bounds(14)],
            all in any::<bool>(),
            picks in prop::collection::vec((any::<bool>(), any::<[u32; POSE_FLOATS]>()), 128),
        ) {
            let pick = |c: usize, pick: u32| {
                let (low, high) = bounds[c];
                (i64::from(low) + i64::from(pick) % (i64::from(high) - i64::from(low) + 1)) as f32
            };
            let lanes: Vec<Lane> = picks[..size].iter().enumerate().filter(|(_, (some, _))| all || *some)
                .map(|(lane, (_, picks))| (lane as u32, std::array::from_fn(|c| pick(c, picks[c]))))
                .filter(|(_, delta)| *delta != [0.0; POSE_FLOATS]).collect();
            // After another entry's words, and before others.
            let (mut headers, mut deltas) = (vec![], vec![7; 3]);
            Small.encode(size, [1.0; TRIPLES], &lanes, [&mut headers, &mut deltas]);
            let end = deltas.len();
            deltas.extend([u32::MAX; 2]);
            prop_assert_eq!(headers.len(), Small.header_words());
            prop_assert_eq!(headers[1] & MASKED == 0, lanes.len() == size);
            let range = Small.words(0, &headers, &deltas, size);
            prop_assert_eq!(range.clone(), 3..end);
            let bits = Small.check_header(&headers).unwrap();
            let mut found = vec![];
            Small.decode(size, 0..size, &headers, &deltas[range], |lane, c, component| {
                assert!(component.unsigned_abs() < 1 << bits[c / TRIPLE]);
                found.push((lane, c, component));
            });
            // Vertices without a record do not move.
            let mut expected: Vec<_> = (0..size * POSE_FLOATS).map(|i| (i / POSE_FLOATS, i % POSE_FLOATS, 0)).collect();
            for (lane, delta) in &lanes {
                delta.iter().enumerate().for_each(|(c, n)| expected[*lane as usize * POSE_FLOATS + c].2 = *n as i32);
            }
            found.sort_unstable();
            prop_assert_eq!(found, expected);
        }
    }

    #[test]
    fn integers_have_as_few_bits_as_offsets_leave() {
        // A common value takes no bits; a common sign takes none.
        let widths = |ranges: &[(i32, i32)]| ranges.iter().map(|(a, b)| Field::fitting(*a, *b).0).collect::<Vec<_>>();
        assert_eq!(widths(&[(0, 0), (1, 1), (-2, -2), (5, 5), (-9, -9)]), [0, 0, 0, 2, 3]);
        assert_eq!(widths(&[(0, 1), (-1, 0), (0, 7), (8, 15), (-8, -1), (-1, 6), (1000, 1100)]), [1, 1, 3, 3, 3, 3, 9]);
        assert_eq!(widths(&[(-(1 << 17), (1 << 17) - 1), (-(1 << 17) + 1, (1 << 17) - 1)]), [18, 18]);
        assert_eq!(widths(&[(-(1 << 13), (1 << 13) - 1), (1 - (1 << 13), (1 << 13) - 1)]), [14, 14]);
    }
}
