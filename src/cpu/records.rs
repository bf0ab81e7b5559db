//! Sums of a format with a record for each vertex that an entry moves: rows of eight lanes, six of them a vertex's
//! components.

use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::POSE_FLOATS;
use crate::pack::formats::small::{BYTES, LANES, Records};
use crate::pack::poses::sums::{Rounded, Sum, half};
use fearless_simd::prelude::*;
use fearless_simd::{f32x8, i32x8, u8x16, u8x32, u32x8};

const ROW: usize = 8;

/// Sums of a vertex; the last two mean nothing.
pub(super) type Row<T> = [T; ROW];

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
        let sum = f32x8::load_array(factors.token(), *row) + factors * f32x8::float_from(delta);
        sum.store_array(row);
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
        let sum = i32x8::load_array(factors.token(), *row) + factors * delta;
        sum.store_array(row);
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
        let row = bytemuck::cast_mut::<_, [i32; ROW]>(row);
        let sum = i32x8::load_array(new.token(), *row) + ((new * delta + half) >> dropped);
        let sum = if NEW { sum } else { sum - ((old * delta + half) >> dropped) };
        sum.store_array(row);
    }
}

/// Adds an entry to the rows of the block's vertices.
#[inline(always)]
pub(super) fn add<V: Simd, T: RowSum, const NEW: bool>(
    simd: V,
    records: &Records<'_>,
    factors: [T::Factor; TRIPLES],
    dropped: [u32; TRIPLES],
    rows: &mut [Row<T>],
) {
    let factors = T::factors(simd, factors, dropped);
    let (mut begins, mut largest, mut least, mut bits) = ([0; ROW], [0; ROW], [0; ROW], 0);
    for (c, field) in records.fields.iter().enumerate().take(POSE_FLOATS) {
        (begins[c], largest[c], least[c]) = (bits, (1 << field.width) - 1, field.least);
        bits += field.width;
    }
    // Of each component the four bytes from its first one on: at most 7 bits before it, 7 before the record, 18 of it.
    let (begins, largest, least) =
        (u32x8::simd_from(simd, begins), u32x8::simd_from(simd, largest), i32x8::simd_from(simd, least));
    let bytes: u8x32<V> = ((begins >> 3) * 0x0101_0101 + 0x0302_0100).bitcast();
    let begins = begins & 7;
    let mut from = 0;
    for (word, rows) in rows.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let mut mask = records.mask(word);
        let (last, mut at) = (&mut None, from % 8);
        let window = records.window(from, last);
        from += mask.count_ones() * bits;
        while mask != 0 {
            let record = window[at as usize / 8 % BYTES..].first_chunk().unwrap_or(&[0; 16]);
            let words: u32x8<V> =
                u8x32::block_splat(u8x16::load_array(simd, *record)).swizzle_dyn_within_blocks(bytes).bitcast();
            let integers: i32x8<V> = ((words >> (at % 8) >> begins) & largest).bitcast();
            T::add_row::<V, NEW>(&mut rows[mask.trailing_zeros() as usize % LANES], factors, integers + least);
            mask &= mask - 1;
            at += bits;
        }
    }
}
