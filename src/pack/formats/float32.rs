//! Dense, six float32. GLSL: `glsl/formats/float32.glsl`.

use super::DenseFormat;
use crate::asset::streams::TRIPLES;
use crate::pack::POSE_FLOATS;

pub(crate) struct Float32;

impl DenseFormat for Float32 {
    fn steps(&self, _: [f32; TRIPLES]) -> (f32, i8) {
        (1.0, 0)
    }

    fn encode(&self, delta: [f32; POSE_FLOATS], _: [f32; TRIPLES], out: &mut [u32]) {
        out.copy_from_slice(&delta.map(f32::to_bits));
    }

    fn decode(&self, words: &[u32], _: [f32; TRIPLES]) -> [f64; POSE_FLOATS] {
        std::array::from_fn(|i| f64::from(f32::from_bits(words[i])))
    }

    #[inline(always)]
    fn add<const N: usize>(&self, factors: [[f32; TRIPLES]; N], rows: [&[u32]; N], sums: &mut [f32]) {
        let rows: [&[f32]; N] = rows.map(|row| &bytemuck::cast_slice(row)[..sums.len()]);
        for (i, sum) in sums.iter_mut().enumerate() {
            let mut s = *sum;
            for k in 0..N {
                s += factors[k][0] * rows[k][i];
            }
            *sum = s;
        }
    }
}
