//! The CPU twin of the dense kernels (`glsl/dense.comp`, `glsl/feedback.vert`): the same sum over a run of vertices, in
//! loops that vectorize.
//!
//! A run is cut into pieces whose sums fit the first-level cache. Deltas of several targets are read at a time, so that
//! a piece is loaded and stored once for all of them.

use crate::pack::formats::{DenseFormat, with_format};
use crate::pack::{POSE_FLOATS, PackedGroup};
use crate::simd::widest;
use crate::weights::delta::Coefficient;

/// Vertices of a piece: 6 KiB of sums.
const PIECE: usize = 256;
/// Targets read at a time.
const STREAMS: usize = 8;

/// `destination = source + Σ coefficient · delta` for consecutive vertices from `first` on (index in the mesh), all in
/// one chunk; in place if `source` is `None`.
pub fn dense(
    packed: &PackedGroup,
    coefficients: &[Coefficient],
    first: usize,
    source: Option<&[f32]>,
    destination: &mut [f32],
) {
    widest!(_simd => {
        let mut sums = [0.0f32; PIECE * POSE_FLOATS];
        for (piece, out) in destination.chunks_mut(PIECE * POSE_FLOATS).enumerate() {
            let vertex = first + piece * PIECE;
            let sums = &mut sums[..out.len()];
            sums.fill(0.0);
            for group in coefficients.chunks(STREAMS) {
                match group.len() {
                    8 => add::<8>(packed, group, vertex, sums),
                    4..8 => {
                        add::<4>(packed, &group[..4], vertex, sums);
                        group[4..].iter().for_each(|c| add::<1>(packed, std::slice::from_ref(c), vertex, sums));
                    }
                    _ => group.iter().for_each(|c| add::<1>(packed, std::slice::from_ref(c), vertex, sums)),
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
    });
}

#[inline(always)]
fn add<const N: usize>(packed: &PackedGroup, group: &[Coefficient], vertex: usize, sums: &mut [f32]) {
    let vertices = sums.len() / POSE_FLOATS;
    let rows: [&[u32]; N] = std::array::from_fn(|i| packed.rows(group[i].target as usize, vertex, vertices));
    let factors = std::array::from_fn(|i| {
        let target = &packed.layout().targets[group[i].target as usize];
        let first = group[i].value * target.position_step;
        [first, first * target.normal_ratio()]
    });
    with_format!(packed.layout().format, dense format => format.add(factors, rows, sums), blocks _f => {});
}
