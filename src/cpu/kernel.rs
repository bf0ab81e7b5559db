//! The CPU twin of the dense kernels (`glsl/dense.comp`, `glsl/feedback.vert`): the same sum over a run of vertices, in
//! loops that vectorize.
//!
//! A run is cut into pieces whose sums fit the first-level cache. Deltas of several targets are read at a time, so that
//! a piece is loaded and stored once for all of them.

use super::simd::widest;
use crate::asset::streams::{TRIPLE, TRIPLES};
use crate::pack::blocks::PoseGrid;
use crate::pack::formats::{DenseFormat, with_format};
use crate::pack::grid::Term;
use crate::pack::poses::PoseStorage;
use crate::pack::{POSE_FLOATS, PackedGroup};
use crate::weights::delta::Coefficient;
use fearless_simd::prelude::*;
use fearless_simd::{i16x16, i32x8};

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

/// A dense pass over fixed-point poses on `grid`: adds the rounded terms of `coefficients` to `source`, or in place.
pub(super) fn rounded<P: PoseStorage>(
    packed: &PackedGroup,
    coefficients: &[Coefficient],
    grid: PoseGrid,
    first: usize,
    source: Option<&[P::Number]>,
    destination: &mut [P::Number],
) {
    let layout = packed.layout();
    let terms = coefficients.iter().flat_map(|c| {
        let target = c.target as usize;
        let steps = layout.targets[target].steps();
        // By way of 0, where weights of both signs would not leave room for their difference.
        let new = c.held + c.value;
        let [first, second] =
            if c.held * new < 0.0 { [(c.held, 0.0), (0.0, new)] } else { [(c.held, new), (0.0, 0.0)] };
        [first, second]
            .into_iter()
            .filter(|(old, new)| old != new)
            .map(move |(old, new)| (target, grid.term(old, new, steps)))
    });
    widest!(simd => {
        let terms: Vec<_> = terms.map(|(target, term)| (target, Lanes::new(simd, term))).collect();
        let mut sums = [0; PIECE * POSE_FLOATS];
        for (piece, out) in destination.chunks_mut(PIECE * POSE_FLOATS).enumerate() {
            let sums = &mut sums[..out.len()];
            sums.fill(0);
            for (target, lanes) in &terms {
                let row = packed.rows(*target, first + piece * PIECE, out.len() / POSE_FLOATS);
                let row = with_format!(layout.format, dense format => format.integers(row), blocks _f => &[]);
                match lanes.new {
                    true => add_rounded::<_, true>(simd, lanes, row, sums),
                    false => add_rounded::<_, false>(simd, lanes, row, sums),
                }
            }
            if let Some(source) = source {
                out.copy_from_slice(&source[piece * PIECE * POSE_FLOATS..][..out.len()]);
            }
            out.iter_mut().zip(&*sums).for_each(|(o, s)| *o = P::plus_integer(*o, *s));
        }
    });
}

/// Numbers of eight vertices: six vectors, the last three with the components of the first three in their lanes.
const EIGHT: usize = 8 * POSE_FLOATS;

/// A target's terms in the lanes of three vectors: four vertices.
struct Lanes<V: Simd> {
    /// No weight is applied.
    new: bool,
    old: i32x8<V>,
    change: i32x8<V>,
    half: [i32x8<V>; 3],
    /// The bits that are dropped.
    low: [i32x8<V>; 3],
    dropped: [i32x8<V>; 3],
}

impl<V: Simd> Lanes<V> {
    #[inline(always)]
    fn new(simd: V, Term { old, new, dropped }: Term) -> Self {
        let lanes = |number: fn(u32) -> i32| {
            std::array::from_fn(|v| i32x8::from_fn(simd, |lane| number(dropped[(8 * v + lane) / TRIPLE % TRIPLES])))
        };
        Self {
            new: old == 0,
            old: i32x8::splat(simd, old),
            change: i32x8::splat(simd, new - old),
            half: lanes(|dropped| (1u32 << dropped >> 1) as i32),
            low: lanes(|dropped| ((1u32 << dropped) - 1) as i32),
            dropped: lanes(|dropped| dropped as i32),
        }
    }
}

/// Adds q(new) - q(old) = (change · d + what q(old) drops) >> dropped.
#[inline(always)]
fn add_rounded<V: Simd, const NEW: bool>(simd: V, lanes: &Lanes<V>, row: &[i16], sums: &mut [i32]) {
    for (sums, row) in sums.as_chunks_mut::<EIGHT>().0.iter_mut().zip(row.as_chunks::<EIGHT>().0) {
        for (i, row) in row.as_chunks::<16>().0.iter().enumerate() {
            let (low, high) = i16x16::simd_from(simd, *row).widen();
            for (at, delta) in [(2 * i, low), (2 * i + 1, high)] {
                let sum = &mut sums[8 * at..][..8];
                let of = at % 3;
                let left = if NEW { lanes.half[of] } else { (delta * lanes.old + lanes.half[of]) & lanes.low[of] };
                (i32x8::from_slice(simd, sum) + ((delta * lanes.change + left) >> lanes.dropped[of])).store_slice(sum);
            }
        }
    }
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
