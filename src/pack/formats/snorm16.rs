//! Dense, six signed 16-bit integers. GLSL: `glsl/formats/snorm16.glsl`.

use super::DenseFormat;
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::math::power_of_two_above;
use crate::pack::POSE_FLOATS;
use crate::pack::grid::Term;

const MAX: f64 = 32767.0;

/// Two vertices at a time: twelve values are three vectors of four.
const PAIR: usize = 2 * POSE_FLOATS;

pub(crate) struct Snorm16;

impl DenseFormat for Snorm16 {
    /// The smallest powers of two with which the largest numbers fit, so that all deltas and their sums are multiples
    /// of the finest step.
    fn steps(&self, [first, second]: [f32; TRIPLES]) -> (f32, i8) {
        // Not below the range of float32 coefficients; such a target is negligible.
        let step = |largest: f32| power_of_two_above(f64::from(largest) / MAX);
        // A target that moves only the second triple still needs a step for the first.
        let first = step(if first > 0.0 { first } else { second });
        let ratio = if second > 0.0 { step(second) / first } else { 1.0 };
        (first, ratio.log2().clamp(-100.0, 100.0) as i8)
    }

    fn encode(&self, delta: [f32; POSE_FLOATS], steps: [f32; TRIPLES], out: &mut [u32]) {
        let out: &mut [i16] = bytemuck::cast_slice_mut(out);
        for (i, (out, value)) in out.iter_mut().zip(delta).enumerate() {
            *out = (f64::from(value) / f64::from(steps[i / TRIPLE])).round().clamp(-MAX, MAX) as i16;
        }
    }

    fn decode(&self, words: &[u32], steps: [f32; TRIPLES]) -> [f64; POSE_FLOATS] {
        let integers: &[i16] = bytemuck::cast_slice(words);
        std::array::from_fn(|i| f64::from(integers[i]) * f64::from(steps[i / TRIPLE]))
    }

    #[inline(always)]
    fn add<const N: usize>(&self, factors: [[f32; TRIPLES]; N], rows: [&[u32]; N], sums: &mut [f32]) {
        let patterns = factors.map(|f| std::array::from_fn::<f32, PAIR, _>(|i| f[i / TRIPLE % TRIPLES]));
        let rows: [&[[i16; PAIR]]; N] =
            rows.map(|row| bytemuck::cast_slice::<_, i16>(row)[..sums.len()].as_chunks::<PAIR>().0);
        // Runs end at multiples of the vertex padding: an even number of vertices.
        for (i, sum) in sums.as_chunks_mut::<PAIR>().0.iter_mut().enumerate() {
            let mut s = *sum;
            for (row, pattern) in rows.iter().zip(&patterns) {
                for ((s, d), p) in s.iter_mut().zip(&row[i]).zip(pattern) {
                    *s += p * f32::from(*d);
                }
            }
            *sum = s;
        }
    }

    #[inline(always)]
    fn add_terms(&self, terms: [Term; TRIPLES], row: &[u32], sums: &mut [i32]) {
        // From the base pose no weight is applied: one product is enough.
        match terms.iter().all(|term| term.old == 0) {
            true => add_rounded(terms, row, sums, |Term { new, dropped, .. }, delta| rounded(new, delta, dropped)),
            false => add_rounded(terms, row, sums, |Term { new, old, dropped }, delta| {
                rounded(new, delta, dropped) - rounded(old, delta, dropped)
            }),
        }
    }
}

#[inline(always)]
fn rounded(weight: i32, delta: i32, dropped: u32) -> i32 {
    (weight * delta + (1u32 << dropped >> 1) as i32) >> dropped
}

#[inline(always)]
fn add_rounded(terms: [Term; TRIPLES], row: &[u32], sums: &mut [i32], rounded: impl Fn(Term, i32) -> i32) {
    let pattern = std::array::from_fn::<Term, PAIR, _>(|i| terms[i / TRIPLE % TRIPLES]);
    let row = bytemuck::cast_slice::<_, i16>(row)[..sums.len()].as_chunks::<PAIR>().0;
    for (sums, deltas) in sums.as_chunks_mut::<PAIR>().0.iter_mut().zip(row) {
        for ((sum, delta), term) in sums.iter_mut().zip(deltas).zip(pattern) {
            *sum = sum.wrapping_add(rounded(term, i32::from(*delta)));
        }
    }
}
