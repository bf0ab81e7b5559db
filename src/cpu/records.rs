//! Sums of a format with a record for each vertex that an entry moves: rows of eight lanes, six of them a vertex's
//! components.

use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::formats::small::{BYTES, LANES, Records};
use crate::pack::grid::{DROPPED, HALF};
use crate::pack::poses::sums::{Rounded, Sum};
use fearless_simd::prelude::*;
use fearless_simd::{f32x8, i32x8, u8x16, u8x32, u32x8, u64x4};

const ROW: usize = 8;

/// Records that take whole bytes, as many as one takes bits.
const EIGHT: usize = 8;
/// Bytes of eight records of at most 128 bits, and those read from the start of the last one.
const EIGHT_BYTES: usize = 128 + RECORD_BYTES;
/// Bytes read of a record, which may begin in the middle of a byte.
const RECORD_BYTES: usize = 16;
/// Numbers in memory, from where one instruction fills a vector.
static NUMBERS: [u32; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Sums of a vertex, in one cache line; the last two mean nothing.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
pub(super) struct Row<T>(pub [T; ROW]);

/// [`Sum::add`] for a row.
pub(super) trait RowSum: Sum {
    type Factors<V: Simd>: Copy;

    fn factors<V: Simd>(simd: V, factors: [Self::Factor; TRIPLES]) -> Self::Factors<V>;

    fn add_row<V: Simd, const NEW: bool>(row: &mut Row<Self>, factors: Self::Factors<V>, delta: i32x8<V>);
}

#[inline(always)]
fn by_lane<T: Copy>(triples: [T; TRIPLES]) -> [T; ROW] {
    std::array::from_fn(|lane| triples[lane / TRIPLE % TRIPLES])
}

macro_rules! row_sums {
    ($($number:ident $vector:ident $delta:ident => $operand:expr;)*) => {
        $(impl RowSum for $number {
            type Factors<V: Simd> = $vector<V>;

            #[inline(always)]
            fn factors<V: Simd>(simd: V, factors: [Self; TRIPLES]) -> $vector<V> {
                by_lane(factors).simd_into(simd)
            }

            #[inline(always)]
            fn add_row<V: Simd, const NEW: bool>(row: &mut Row<Self>, factors: $vector<V>, $delta: i32x8<V>) {
                let sum = $vector::load_array(factors.token(), row.0) + factors * $operand;
                sum.store_array(&mut row.0);
            }
        })*
    };
}
row_sums! {
    f32 f32x8 delta => f32x8::float_from(delta);
    i32 i32x8 delta => delta;
}

impl RowSum for Rounded {
    /// New and applied weight.
    type Factors<V: Simd> = [i32x8<V>; 2];

    #[inline(always)]
    fn factors<V: Simd>(simd: V, factors: [[i32; 2]; TRIPLES]) -> Self::Factors<V> {
        [0, 1].map(|weight| by_lane(factors.map(|of| of[weight])).simd_into(simd))
    }

    #[inline(always)]
    fn add_row<V: Simd, const NEW: bool>(row: &mut Row<Self>, factors: Self::Factors<V>, delta: i32x8<V>) {
        let [new, old] = factors;
        let row = bytemuck::cast_mut::<_, [i32; ROW]>(&mut row.0);
        let sum = i32x8::load_array(new.token(), *row) + ((new * delta + HALF) >> DROPPED);
        let sum = if NEW { sum } else { sum - ((old * delta + HALF) >> DROPPED) };
        sum.store_array(row);
    }
}

/// Adds an entry to the rows of the block's vertices.
#[inline(always)]
pub(super) fn add<V: Simd, T: RowSum, const NEW: bool>(
    simd: V,
    records: &Records<'_>,
    factors: [T::Factor; TRIPLES],
    rows: &mut [Row<T>],
) {
    let factors = T::factors(simd, factors);
    let bits = (records.begins >> 56) as u32;
    // Of each component the four bytes from its first one on: at most 7 bits before it, 7 before the record, 18 of it.
    let each: u8x32<V> = (u32x8::simd_from(simd, NUMBERS) * 0x0101_0101).bitcast();
    let begins: u8x32<V> = u64x4::splat(simd, records.begins).bitcast();
    let begins: u32x8<V> = begins.swizzle_dyn_within_blocks(each).bitcast();
    let bytes: u8x32<V> = (((begins >> 3) & 0x1f1f_1f1f) + 0x0302_0100).bitcast();
    let begins = begins & 7;
    let (largest, least) = records.fields(simd);
    let add = |row: &mut Row<T>, record: &[u8; RECORD_BYTES], begins: u32x8<V>| {
        let record = u8x32::block_splat(u8x16::load_array(simd, *record));
        let words: u32x8<V> = record.swizzle_dyn_within_blocks(bytes).bitcast();
        let integers: i32x8<V> = ((words >> begins) & largest).bitcast();
        T::add_row::<V, NEW>(row, factors, integers + least);
    };
    let mut from = 0;
    for (word, rows) in rows.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let mut mask = records.mask(word);
        let (last, mut at) = (&mut None, from % 8);
        let window = records.window(from, last);
        from += mask.count_ones() * bits;
        if mask == u32::MAX {
            // Records follow each other, `bits` bits each, from bit `at` of the window on. Eight take `bits` bytes, so
            // that r8 begins at the same bit of its byte as r0:
            //
            //     window   | at | r0 | r1 | ... | r7 | r8 | r9 | ...
            //              |    |<--- `bits` bytes --->|<--- `bits` bytes ...
            //     starts   the bytes in which r0 to r7 begin, from the first byte of their group on
            //     shifts   for each, the bits by which its components lie behind the bytes that `bytes` chooses
            let mut starts = [0; EIGHT];
            let mut shifts = [begins; EIGHT];
            for i in 0..EIGHT {
                starts[i] = at as usize / 8;
                shifts[i] = begins + NUMBERS[at as usize % 8];
                at += bits;
            }
            for (eight, rows) in rows.as_chunks_mut::<EIGHT>().0.iter_mut().enumerate() {
                // The remainders are no changes: the compiler sees by them that no bound is exceeded.
                let group = &window[eight * bits as usize % BYTES..];
                let group: &[u8; EIGHT_BYTES] = group.first_chunk().unwrap_or(&[0; EIGHT_BYTES]);
                for (i, row) in rows.iter_mut().enumerate() {
                    let record = group[starts[i] % (EIGHT_BYTES - RECORD_BYTES)..].first_chunk();
                    add(row, record.unwrap_or(&[0; RECORD_BYTES]), shifts[i]);
                }
            }
            continue;
        }
        while mask != 0 {
            let row = &mut rows[mask.trailing_zeros() as usize % LANES];
            add(row, window[at as usize / 8 % BYTES..].first_chunk().unwrap_or(&[0; RECORD_BYTES]), begins + at % 8);
            mask &= mask - 1;
            at += bits;
        }
    }
}
