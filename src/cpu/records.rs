//! Sums of a format with a record for each vertex that an entry moves: rows of eight lanes, six of them a vertex's
//! components.

use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::formats::small::{BYTES, LANES, Records};
use crate::pack::poses::sums::{Rounded, Sum, half};
use fearless_simd::prelude::*;
use fearless_simd::{f32x8, i32x8, u8x16, u8x32, u32x8, u64x4};

const ROW: usize = 8;

/// Records that take whole bytes, as many as one takes bits.
const EIGHT: usize = 8;
/// Numbers in memory, from where one instruction fills a vector.
static NUMBERS: [u32; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Sums of a vertex, in one cache line; the last two mean nothing.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
pub(super) struct Row<T>(pub [T; ROW]);

/// [`Sum::add`] for a row.
pub(super) trait RowSum: Sum {
    type Factors<V: Simd>: Copy;

    fn factors<V: Simd>(simd: V, factors: [Self::Factor; TRIPLES], dropped: [u32; TRIPLES]) -> Self::Factors<V>;

    fn add_row<V: Simd, const NEW: bool>(row: &mut Row<Self>, factors: Self::Factors<V>, delta: i32x8<V>);
}

#[inline(always)]
fn by_lane<T: Copy>(triples: [T; TRIPLES]) -> [T; ROW] {
    std::array::from_fn(|lane| triples[lane / TRIPLE % TRIPLES])
}

impl RowSum for f32 {
    type Factors<V: Simd> = f32x8<V>;

    #[inline(always)]
    fn factors<V: Simd>(simd: V, factors: [f32; TRIPLES], _: [u32; TRIPLES]) -> f32x8<V> {
        by_lane(factors).simd_into(simd)
    }

    #[inline(always)]
    fn add_row<V: Simd, const NEW: bool>(row: &mut Row<f32>, factors: f32x8<V>, delta: i32x8<V>) {
        let sum = f32x8::load_array(factors.token(), row.0) + factors * f32x8::float_from(delta);
        sum.store_array(&mut row.0);
    }
}

impl RowSum for i32 {
    type Factors<V: Simd> = i32x8<V>;

    #[inline(always)]
    fn factors<V: Simd>(simd: V, factors: [i32; TRIPLES], _: [u32; TRIPLES]) -> i32x8<V> {
        by_lane(factors).simd_into(simd)
    }

    #[inline(always)]
    fn add_row<V: Simd, const NEW: bool>(row: &mut Row<i32>, factors: i32x8<V>, delta: i32x8<V>) {
        let sum = i32x8::load_array(factors.token(), row.0) + factors * delta;
        sum.store_array(&mut row.0);
    }
}

impl RowSum for Rounded {
    /// New and applied weight, half a unit, and low bits dropped.
    type Factors<V: Simd> = [i32x8<V>; 4];

    #[inline(always)]
    fn factors<V: Simd>(simd: V, factors: [[i32; 2]; TRIPLES], dropped: [u32; TRIPLES]) -> Self::Factors<V> {
        let [new, old] = [0, 1].map(|weight| factors.map(|of| of[weight]));
        let half = dropped.map(half);
        [new, old, half, dropped.map(|dropped| dropped as i32)].map(|triples| by_lane(triples).simd_into(simd))
    }

    #[inline(always)]
    fn add_row<V: Simd, const NEW: bool>(row: &mut Row<Self>, factors: Self::Factors<V>, delta: i32x8<V>) {
        let [new, old, half, dropped] = factors;
        let row = bytemuck::cast_mut::<_, [i32; ROW]>(&mut row.0);
        let sum = i32x8::load_array(new.token(), *row) + ((new * delta + half) >> dropped);
        let sum = if NEW { sum } else { sum - ((old * delta + half) >> dropped) };
        sum.store_array(row);
    }
}

/// Adds an entry to the rows of the block's vertices.
///
/// Records follow each other bit after bit, so one begins anywhere in a byte. Eight of them take as many bytes as one
/// takes bits, which is why all eights of a word of the mask begin at the same bit of a byte:
///
/// ```text
/// window    |·· record 0 | record 1 | … | record 7 ·|·· record 8 | …     `··`: `from % 8` bits of what is before
/// byte      0                                       bits
///
/// record i of an eight      begins at bit   from % 8 + i · bits of the eight's bytes
///   starts[i]               the byte of that bit
///   shifts[i]               the bits before it in that byte, for each component added to those of the component
/// component c of a record   (the four bytes from that of its first bit on >> shift) & largest[c], + least[c]
/// ```
#[inline(always)]
pub(super) fn add<V: Simd, T: RowSum, const NEW: bool>(
    simd: V,
    records: &Records<'_>,
    factors: [T::Factor; TRIPLES],
    dropped: [u32; TRIPLES],
    rows: &mut [Row<T>],
) {
    let factors = T::factors(simd, factors, dropped);
    let bits = (records.begins >> 56) as u32;
    // Of each component the four bytes from its first one on: at most 7 bits before it, 7 before the record, 18 of it.
    let each: u8x32<V> = (u32x8::simd_from(simd, NUMBERS) * 0x0101_0101).bitcast();
    let begins: u8x32<V> = u64x4::splat(simd, records.begins).bitcast();
    let begins: u32x8<V> = begins.swizzle_dyn_within_blocks(each).bitcast();
    let bytes: u8x32<V> = (((begins >> 3) & 0x1f1f_1f1f) + 0x0302_0100).bitcast();
    let begins = begins & 7;
    let (largest, least) = records.fields(simd);
    let add = |row: &mut Row<T>, record: &[u8; 16], begins: u32x8<V>| {
        let record = u8x32::block_splat(u8x16::load_array(simd, *record));
        let words: u32x8<V> = record.swizzle_dyn_within_blocks(bytes).bitcast();
        let integers: i32x8<V> = ((words >> begins) & largest).bitcast();
        T::add_row::<V, NEW>(row, factors, integers + least);
    };
    let mut from = 0;
    for (word, rows) in rows.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let mut mask = records.mask(word);
        let last = &mut None;
        let mut at = from % 8;
        let window = records.window(from, last);
        from += mask.count_ones() * bits;
        if mask == u32::MAX {
            let mut starts = [0; EIGHT];
            let mut shifts = [begins; EIGHT];
            for i in 0..EIGHT {
                starts[i] = at as usize / 8;
                shifts[i] = begins + NUMBERS[at as usize % 8];
                at += bits;
            }
            for (eight, rows) in rows.as_chunks_mut::<EIGHT>().0.iter_mut().enumerate() {
                // Remainders and `unwrap_or` change nothing: they tell the compiler that all is within bounds.
                let bytes = window[eight * bits as usize % BYTES..].first_chunk().unwrap_or(&[0; 128 + 16]);
                for (i, row) in rows.iter_mut().enumerate() {
                    add(row, bytes[starts[i] % 128..].first_chunk().unwrap_or(&[0; 16]), shifts[i]);
                }
            }
            continue;
        }
        while mask != 0 {
            let row = &mut rows[mask.trailing_zeros() as usize % LANES];
            add(row, window[at as usize / 8 % BYTES..].first_chunk().unwrap_or(&[0; 16]), begins + at % 8);
            mask &= mask - 1;
            at += bits;
        }
    }
}
