//! What the kernels of block formats add up, in planes (all x of a block, all y, …) whose loops become SIMD: float32, or
//! integers that wrap.

use super::simd::widest;
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::POSE_FLOATS;
use crate::pack::formats::BlockFormat;

/// Numbers of a block of `S` vertices, component after component.
pub(super) type Planes<T, const S: usize> = [[T; S]; POSE_FLOATS];

/// Numbers of a plane that are added up in registers. Any block has a multiple of it.
const LANES: usize = 32;

/// Entries that are decoded side by side: those of a block of 64 take 12 KiB, and stay in the first-level cache.
pub(super) const BATCH: usize = 8;

/// A number of a delta, as its format has it.
pub(super) trait Number: Copy {
    /// It, in steps where it is an integer.
    fn float(self) -> f32;
    /// It; never called for float32 deltas, which have no grid.
    fn integer(self) -> i32;
}

impl Number for f32 {
    #[inline(always)]
    fn float(self) -> f32 {
        self
    }

    #[inline(always)]
    fn integer(self) -> i32 {
        self as i32
    }
}

impl Number for i32 {
    #[inline(always)]
    fn float(self) -> f32 {
        self as f32
    }

    #[inline(always)]
    fn integer(self) -> i32 {
        self
    }
}

/// What a kernel adds up of the deltas of a component.
pub(super) trait Sum: Copy + Default + Send {
    /// What is multiplied: a number of a delta.
    type Delta: Copy + Default;
    /// What it is multiplied by.
    type Factor: Copy + Default;

    fn delta(number: impl Number) -> Self::Delta;

    /// From the coefficient as the work list has it, of an entry's triple that has this `step`; deltas are to be shifted by
    /// `shift`.
    fn factor(bits: u32, step: f32, shift: u32) -> Self::Factor;

    /// Whether the pose holds nothing of an entry with these factors, where that saves work.
    fn is_new(factors: &[Self::Factor; TRIPLES]) -> bool;

    /// Add a product; where products are rounded, without its lowest bits, so many. `NEW`: the factor is new.
    fn add<const NEW: bool>(self, factor: Self::Factor, delta: Self::Delta, dropped: u32) -> Self;
}

impl Sum for f32 {
    type Delta = f32;
    type Factor = f32;

    #[inline(always)]
    fn delta(number: impl Number) -> f32 {
        number.float()
    }

    #[inline(always)]
    fn factor(bits: u32, step: f32, shift: u32) -> f32 {
        // Both factors are powers of two.
        f32::from_bits(bits) * (step * (1u32 << shift) as f32)
    }

    #[inline(always)]
    fn is_new(_: &[f32; TRIPLES]) -> bool {
        false
    }

    #[inline(always)]
    fn add<const NEW: bool>(self, factor: f32, delta: f32, _: u32) -> Self {
        self + factor * delta
    }
}

impl Sum for i32 {
    type Delta = i32;
    type Factor = i32;

    #[inline(always)]
    fn delta(number: impl Number) -> i32 {
        number.integer()
    }

    #[inline(always)]
    fn factor(bits: u32, _: f32, shift: u32) -> i32 {
        (bits as i32).wrapping_shl(shift)
    }

    #[inline(always)]
    fn is_new(_: &[i32; TRIPLES]) -> bool {
        false
    }

    #[inline(always)]
    fn add<const NEW: bool>(self, factor: i32, delta: i32, _: u32) -> Self {
        self.wrapping_add(factor.wrapping_mul(delta))
    }
}

/// A sum of products that are rounded, each as a function of a weight.
#[derive(Clone, Copy, Default)]
pub(super) struct Rounded(pub i32);

impl Sum for Rounded {
    type Delta = i32;
    /// The new weight, and the one that the pose holds.
    type Factor = [i32; 2];

    #[inline(always)]
    fn delta(number: impl Number) -> i32 {
        number.integer()
    }

    #[inline(always)]
    fn factor(bits: u32, _: f32, shift: u32) -> Self::Factor {
        [i32::from(bits as i16) << shift, (bits as i32 >> 16) << shift]
    }

    #[inline(always)]
    fn is_new(factors: &[Self::Factor; TRIPLES]) -> bool {
        factors.iter().all(|[_, old]| *old == 0)
    }

    #[inline(always)]
    fn add<const NEW: bool>(self, [new, old]: Self::Factor, delta: i32, dropped: u32) -> Self {
        let sum = self.0.wrapping_add(rounded(new, delta, dropped));
        Self(if NEW { sum } else { sum.wrapping_sub(rounded(old, delta, dropped)) })
    }
}

/// What a target contributes that has this weight.
#[inline(always)]
fn rounded(weight: i32, delta: i32, dropped: u32) -> i32 {
    weight.wrapping_mul(delta).wrapping_add((1u32 << dropped >> 1) as i32) >> dropped
}

/// An entry that is added: where it is decoded, and what it is multiplied by.
pub(super) type Added<T> = (usize, [<T as Sum>::Factor; TRIPLES]);

/// The deltas of an entry; 0 where it has none.
pub(super) fn decode<T: Sum, F: BlockFormat<Component: Number>, const S: usize>(
    format: &F,
    header: &[u32],
    deltas: &[u32],
    out: &mut Planes<T::Delta, S>,
) {
    widest(
        #[inline(always)]
        || {
            if format.is_sparse() {
                *out = [[T::Delta::default(); S]; POSE_FLOATS];
            }
            format.decode(
                S,
                header,
                deltas,
                #[inline(always)]
                |lane, c, number| out[c][lane] = T::delta(number),
            );
        },
    );
}

/// Add an entry to `sums` while it is decoded.
pub(super) fn add_decoded<T: Sum, F: BlockFormat<Component: Number>, const S: usize>(
    format: &F,
    header: &[u32],
    deltas: &[u32],
    factors: [T::Factor; TRIPLES],
    dropped: [u32; TRIPLES],
    sums: &mut Planes<T, S>,
) {
    let entry = (header, deltas, factors);
    match (format.is_sparse(), T::is_new(&factors)) {
        // Vertex after vertex: nothing becomes SIMD.
        (true, true) => add_numbers::<T, F, S, true>(format, entry, dropped, sums),
        (true, false) => add_numbers::<T, F, S, false>(format, entry, dropped, sums),
        (false, true) => widest(
            #[inline(always)]
            || add_numbers::<T, F, S, true>(format, entry, dropped, sums),
        ),
        (false, false) => widest(
            #[inline(always)]
            || add_numbers::<T, F, S, false>(format, entry, dropped, sums),
        ),
    }
}

#[inline(always)]
fn add_numbers<T: Sum, F: BlockFormat<Component: Number>, const S: usize, const NEW: bool>(
    format: &F,
    (header, deltas, factors): (&[u32], &[u32], [T::Factor; TRIPLES]),
    dropped: [u32; TRIPLES],
    sums: &mut Planes<T, S>,
) {
    format.decode(
        S,
        header,
        deltas,
        #[inline(always)]
        |lane, c, number| {
            let triple = c / TRIPLE;
            sums[c][lane] = sums[c][lane].add::<NEW>(factors[triple], T::delta(number), dropped[triple]);
        },
    );
}

/// Add entries to `sums`, in order.
pub(super) fn add<T: Sum, const S: usize>(
    sums: &mut Planes<T, S>,
    entries: &[Added<T>],
    decoded: &[Planes<T::Delta, S>; BATCH],
    dropped: [u32; TRIPLES],
) {
    match entries.iter().all(|(_, factors)| T::is_new(factors)) {
        true => widest(
            #[inline(always)]
            || add_planes::<T, S, true>(sums, entries, decoded, dropped),
        ),
        false => widest(
            #[inline(always)]
            || add_planes::<T, S, false>(sums, entries, decoded, dropped),
        ),
    }
}

#[inline(always)]
fn add_planes<T: Sum, const S: usize, const NEW: bool>(
    sums: &mut Planes<T, S>,
    entries: &[Added<T>],
    decoded: &[Planes<T::Delta, S>; BATCH],
    dropped: [u32; TRIPLES],
) {
    for (c, plane) in sums.iter_mut().enumerate() {
        let (triple, dropped) = (c / TRIPLE, dropped[c / TRIPLE]);
        for (at, lanes) in plane.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            let mut sums = *lanes;
            for (place, factors) in entries {
                let deltas = &decoded[*place][c].as_chunks::<LANES>().0[at];
                for (sum, delta) in sums.iter_mut().zip(deltas) {
                    *sum = sum.add::<NEW>(factors[triple], *delta, dropped);
                }
            }
            *lanes = sums;
        }
    }
}
