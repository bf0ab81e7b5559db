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

    /// From the coefficient as the work list has it. `unit`: the step of the entry's triple, and the bits of products that
    /// are dropped; deltas are to be shifted by `shift`.
    fn factor(bits: u32, unit: (f32, u32), shift: u32) -> Self::Factor;

    fn add(self, factor: Self::Factor, delta: Self::Delta) -> Self;
}

impl Sum for f32 {
    type Delta = f32;
    type Factor = f32;

    #[inline(always)]
    fn delta(number: impl Number) -> f32 {
        number.float()
    }

    #[inline(always)]
    fn factor(bits: u32, (step, _): (f32, u32), shift: u32) -> f32 {
        // Both factors are powers of two.
        f32::from_bits(bits) * (step * (1u32 << shift) as f32)
    }

    #[inline(always)]
    fn add(self, factor: f32, delta: f32) -> Self {
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
    fn factor(bits: u32, _: (f32, u32), shift: u32) -> i32 {
        (bits as i32).wrapping_shl(shift)
    }

    #[inline(always)]
    fn add(self, factor: i32, delta: i32) -> Self {
        self.wrapping_add(factor.wrapping_mul(delta))
    }
}

/// A sum of products that are rounded, each as a function of a weight.
#[derive(Clone, Copy, Default)]
pub(super) struct Rounded(pub i32);

impl Sum for Rounded {
    type Delta = i32;
    /// The new weight, the one that the pose holds, and the bits that are dropped.
    type Factor = (i32, i32, u32);

    #[inline(always)]
    fn delta(number: impl Number) -> i32 {
        number.integer()
    }

    #[inline(always)]
    fn factor(bits: u32, (_, dropped): (f32, u32), shift: u32) -> Self::Factor {
        (i32::from(bits as i16) << shift, (bits as i32 >> 16) << shift, dropped)
    }

    #[inline(always)]
    fn add(self, (new, old, dropped): Self::Factor, delta: i32) -> Self {
        let half = 1i32 << dropped >> 1;
        let rounded = |weight: i32| weight.wrapping_mul(delta).wrapping_add(half) >> dropped;
        Self(self.0.wrapping_add(rounded(new)).wrapping_sub(rounded(old)))
    }
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
    sums: &mut Planes<T, S>,
) {
    match format.is_sparse() {
        // Vertex after vertex: nothing becomes SIMD.
        true => add_numbers(format, header, deltas, factors, sums),
        false => widest(
            #[inline(always)]
            || add_numbers(format, header, deltas, factors, sums),
        ),
    }
}

#[inline(always)]
fn add_numbers<T: Sum, F: BlockFormat<Component: Number>, const S: usize>(
    format: &F,
    header: &[u32],
    deltas: &[u32],
    factors: [T::Factor; TRIPLES],
    sums: &mut Planes<T, S>,
) {
    format.decode(
        S,
        header,
        deltas,
        #[inline(always)]
        |lane, c, number| sums[c][lane] = sums[c][lane].add(factors[c / TRIPLE], T::delta(number)),
    );
}

/// Add entries to `sums`, in order.
pub(super) fn add<T: Sum, const S: usize>(
    sums: &mut Planes<T, S>,
    entries: &[Added<T>],
    decoded: &[Planes<T::Delta, S>; BATCH],
) {
    widest(
        #[inline(always)]
        || {
            for (c, plane) in sums.iter_mut().enumerate() {
                for (at, lanes) in plane.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                    let mut sums = *lanes;
                    for (place, factors) in entries {
                        let deltas = &decoded[*place][c].as_chunks::<LANES>().0[at];
                        for (sum, delta) in sums.iter_mut().zip(deltas) {
                            *sum = sum.add(factors[c / TRIPLE], *delta);
                        }
                    }
                    *lanes = sums;
                }
            }
        },
    );
}
