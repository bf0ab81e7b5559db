//! The CPU twin of the dense kernels (`glsl/dense.comp`, `glsl/feedback.vert`): the same sum, over a run of
//! vertices, in loops that the compiler turns into SIMD.
//!
//! A run is cut into pieces whose sum stays in the first-level cache. Deltas are read once, as streams of
//! several targets at a time, so that the piece is loaded and stored once for all of them.

use crate::pack::{DeltaFormat, POSE_FLOATS, PackedMesh};
use crate::weights::delta::Coefficient;

/// Vertices of a piece: 6 KiB of sums.
const PIECE: usize = 256;
/// Targets read side by side.
const STREAMS: usize = 8;

/// `destination = source + Σ coefficient · delta` over the vertices of one chunk that start at `first`
/// (counted in the mesh, all within one chunk); `source` = `None` works in place.
pub fn dense(
    mesh: &PackedMesh,
    coefficients: &[Coefficient],
    first: usize,
    source: Option<&[f32]>,
    destination: &mut [f32],
) {
    let mut sums = [0.0f32; PIECE * POSE_FLOATS];
    for (piece, out) in destination.chunks_mut(PIECE * POSE_FLOATS).enumerate() {
        let vertex = first + piece * PIECE;
        let sums = &mut sums[..out.len()];
        sums.fill(0.0);
        for group in coefficients.chunks(STREAMS) {
            match group.len() {
                8 => add::<8>(mesh, group, vertex, sums),
                4..8 => {
                    add::<4>(mesh, &group[..4], vertex, sums);
                    group[4..].iter().for_each(|c| add::<1>(mesh, std::slice::from_ref(c), vertex, sums));
                }
                _ => group.iter().for_each(|c| add::<1>(mesh, std::slice::from_ref(c), vertex, sums)),
            }
        }
        match source {
            None => out.iter_mut().zip(&*sums).for_each(|(o, s)| *o += s),
            Some(source) => {
                let from = &source[piece * PIECE * POSE_FLOATS..][..out.len()];
                out.iter_mut().zip(from).zip(&*sums).for_each(|((o, f), s)| *o = f + s);
            }
        }
    }
}

fn add<const N: usize>(mesh: &PackedMesh, group: &[Coefficient], vertex: usize, sums: &mut [f32]) {
    let vertices = sums.len() / POSE_FLOATS;
    let rows: [&[u32]; N] = std::array::from_fn(|i| mesh.rows(group[i].target as usize, vertex, vertices));
    match mesh.layout().format {
        DeltaFormat::Snorm16 => {
            let factors = std::array::from_fn(|i| {
                let target = &mesh.layout().targets[group[i].target as usize];
                let position = group[i].value * target.position_step;
                [position, position * target.normal_ratio()]
            });
            add_snorm16(factors, rows.map(bytemuck::cast_slice), sums);
        }
        _ => {
            let factors: [f32; N] = std::array::from_fn(|i| group[i].value);
            add_float32(factors, rows.map(bytemuck::cast_slice), sums);
        }
    }
}

fn add_float32<const N: usize>(factors: [f32; N], rows: [&[f32]; N], sums: &mut [f32]) {
    let rows = rows.map(|row| &row[..sums.len()]);
    for (i, sum) in sums.iter_mut().enumerate() {
        let mut s = *sum;
        for k in 0..N {
            s += factors[k] * rows[k][i];
        }
        *sum = s;
    }
}

/// Two vertices at a time: twelve values are three vectors of four.
const PAIR: usize = 2 * POSE_FLOATS;

fn add_snorm16<const N: usize>(factors: [[f32; 2]; N], rows: [&[i16]; N], sums: &mut [f32]) {
    let patterns = factors.map(|f| std::array::from_fn::<f32, PAIR, _>(|i| f[i / 3 % 2]));
    let rows = rows.map(|row| row[..sums.len()].as_chunks::<PAIR>().0);
    // Runs are cut at multiples of the vertex padding: an even number of vertices.
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
