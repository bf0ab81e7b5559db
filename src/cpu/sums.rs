//! Sums of block formats, in planes (all x of a block, all y, …) so that loops vectorize.

use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::POSE_FLOATS;
use crate::pack::formats::BlockFormat;
use crate::pack::poses::sums::Sum;
use crate::simd::widest;
use std::ops::Range;

/// Numbers of a block of `S` vertices, by component.
pub(super) type Planes<T, const S: usize> = [[T; S]; POSE_FLOATS];

/// Numbers of a plane summed in registers; divides every block size.
const LANES: usize = 32;

/// Entries decoded at a time: in blocks of 64 they take 12 KiB and stay in the first-level cache.
pub(super) const BATCH: usize = 8;

/// An entry to add: index of its decoded deltas, and factors.
pub(super) type Added<T> = (usize, [<T as Sum>::Factor; TRIPLES]);

/// Decodes the deltas of an entry; 0 for omitted vertices.
pub(super) fn decode<T: Sum, F: BlockFormat, const S: usize>(
    format: &F,
    header: &[u32],
    deltas: &[u32],
    out: &mut Planes<T::Delta, S>,
) {
    widest!(_simd => format.decode(
        S,
        0..S,
        header,
        deltas,
        #[inline(always)]
        |lane, c, number| out[c][lane] = T::delta(number),
    ));
}

/// Adds an entry to `sums` while decoding it: the deltas of `lanes`, which are all that it moves.
#[inline(always)]
pub(super) fn add_decoded<T: Sum, F: BlockFormat, const S: usize, const NEW: bool>(
    format: &F,
    (header, deltas, lanes): (&[u32], &[u32], Range<usize>),
    factors: [T::Factor; TRIPLES],
    sums: &mut Planes<T, S>,
) {
    format.decode(
        S,
        // A limit that the compiler knows.
        lanes.start..lanes.end.min(S),
        header,
        deltas,
        #[inline(always)]
        |lane, c, number| {
            let triple = c / TRIPLE;
            sums[c][lane] = sums[c][lane].add::<NEW>(factors[triple], T::delta(number));
        },
    );
}

pub(super) fn add<T: Sum, const S: usize>(
    sums: &mut Planes<T, S>,
    entries: &[Added<T>],
    decoded: &[Planes<T::Delta, S>; BATCH],
) {
    match entries.iter().all(|(_, factors)| T::is_new(factors)) {
        true => widest!(_simd => add_planes::<T, S, true>(sums, entries, decoded)),
        false => widest!(_simd => add_planes::<T, S, false>(sums, entries, decoded)),
    }
}

#[inline(always)]
fn add_planes<T: Sum, const S: usize, const NEW: bool>(
    sums: &mut Planes<T, S>,
    entries: &[Added<T>],
    decoded: &[Planes<T::Delta, S>; BATCH],
) {
    for (c, plane) in sums.iter_mut().enumerate() {
        let triple = c / TRIPLE;
        for (at, lanes) in plane.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            let mut sums = *lanes;
            for (place, factors) in entries {
                let deltas = &decoded[*place][c].as_chunks::<LANES>().0[at];
                for (sum, delta) in sums.iter_mut().zip(deltas) {
                    *sum = sum.add::<NEW>(factors[triple], *delta);
                }
            }
            *lanes = sums;
        }
    }
}
