//! Dense, six signed 16-bit integers. GLSL: `glsl/formats/snorm16.glsl`.

use super::DenseFormat;
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::math::power_of_two_above;
use crate::pack::POSE_FLOATS;

const MAX: f64 = 32767.0;

/// Vertices at a time, so many that the compiler keeps a loop of them, which it makes vectors of; it unrolls loops of a
/// few, and then finds none. What is left at the end of a run is added by vertex.
const WIDE: usize = 16 * POSE_FLOATS;

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
        let rows: [&[i16]; N] = rows.map(bytemuck::cast_slice);
        let (wide, rest) = sums.as_chunks_mut::<WIDE>();
        let after = wide.len() * WIDE;
        add_chunks(factors, rows, wide);
        add_chunks(factors, rows.map(|row| &row[after..]), rest.as_chunks_mut::<POSE_FLOATS>().0);
    }
}

#[inline(always)]
fn add_chunks<const N: usize, const C: usize>(factors: [[f32; TRIPLES]; N], rows: [&[i16]; N], sums: &mut [[f32; C]]) {
    let patterns = factors.map(|f| std::array::from_fn::<f32, C, _>(|i| f[i / TRIPLE % TRIPLES]));
    let rows = rows.map(|row| &row.as_chunks::<C>().0[..sums.len()]);
    for (i, sum) in sums.iter_mut().enumerate() {
        // A copy, which nothing else can alias.
        let mut s = *sum;
        for (row, pattern) in rows.iter().zip(&patterns) {
            let deltas = &row[i];
            for j in 0..C {
                s[j] += pattern[j] * f32::from(deltas[j]);
            }
        }
        *sum = s;
    }
}
