//! A group of a packed mesh: six numbers a vertex, their deltas, and where all of it is.

use super::formats::{DenseFormat, with_format};
use super::{POSE_FLOATS, PackedLayout, PoseError, Source, stream_errors};
use crate::asset::streams::Measure;
use crate::math::angle_degrees;

/// A group of streams, laid out for upload. [`PackedMesh`](super::PackedMesh) has the layouts.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedGroup {
    pub(super) layout: PackedLayout,
    pub(super) base: Vec<f32>,
    pub(super) words: Vec<u32>,
}

impl PackedGroup {
    /// Where everything is.
    pub fn layout(&self) -> &PackedLayout {
        &self.layout
    }

    /// Base pose: [`POSE_FLOATS`] floats for each padded vertex, in the order of pose buffers.
    pub fn base(&self) -> &[f32] {
        &self.base
    }

    /// The deltas as words, in the layout that [`PackedMesh`](super::PackedMesh) states.
    pub fn deltas(&self) -> &[u32] {
        &self.words
    }

    /// The words of target `target` for `vertices` vertices from `first` on, all of one chunk (dense formats).
    pub(crate) fn rows(&self, target: usize, first: usize, vertices: usize) -> &[u32] {
        let at = self.layout.word_index(target, first);
        &self.words[at..at + vertices * self.layout.format.words()]
    }

    /// Call `f` with every vertex that target `target` holds a delta for, in the user's order of vertices, and the
    /// delta that the kernels see, decoded in double precision. Vertices come in no particular order; some deltas may
    /// be zero.
    ///
    /// # Panics
    /// When `target` is out of range.
    pub fn for_each_delta(&self, target: usize, mut f: impl FnMut(usize, [f64; POSE_FLOATS])) {
        let layout = &self.layout;
        if let Some(blocks) = &layout.blocks {
            for incidence in blocks.incidence(target) {
                let first = incidence.block as usize * blocks.size();
                blocks.for_each_lane(&self.words, incidence.entry as usize, |lane, delta| {
                    if let Some(&user) = blocks.order().get(first + lane) {
                        f(user as usize, delta);
                    }
                });
            }
            return;
        }
        let steps = layout.targets[target].steps();
        with_format!(layout.format, dense format => {
            for vertex in 0..layout.vertex_count {
                f(vertex, format.decode(self.rows(target, vertex, 1), steps));
            }
        }, blocks _format => {});
    }

    /// What packing lost of `source`, which this was packed from.
    pub(super) fn measure_error(&self, source: &Source<'_>) -> PoseError {
        let streams = &self.layout.streams;
        // Directions are compared as they come out, all else by the deltas alone.
        let directions = streams.iter().filter(|s| s.semantic.measure() == Measure::Angle);
        let directions: Vec<usize> = directions.flat_map(|s| s.morphing_components()).collect();
        let mut worst = PoseError::default();
        let mut decoded = vec![[0.0; POSE_FLOATS]; source.mesh.vertex_count()];
        for (t, target) in source.mesh.targets.iter().enumerate() {
            decoded.fill([0.0; POSE_FLOATS]);
            self.for_each_delta(t, |vertex, delta| decoded[vertex] = delta);
            for (vertex, delta) in source.deltas(target) {
                let base = source.base(vertex as usize);
                let (mut exact, mut found) = (delta.map(f64::from), decoded[vertex as usize]);
                for &c in &directions {
                    exact[c] += f64::from(base[c]);
                    found[c] += f64::from(base[c]);
                }
                worst = stream_errors(streams, &found, &exact, |found, exact| angle_degrees(exact, found)).max(worst);
            }
        }
        worst
    }
}

/// The base pose as pose buffers hold it, `padded` vertices, in `order` (packed → user) where there is one.
pub(super) fn base_pose(source: &Source<'_>, padded: usize, order: Option<&[u32]>) -> Vec<f32> {
    let mut base = vec![0.0; padded * POSE_FLOATS];
    for (packed, out) in base.chunks_exact_mut(POSE_FLOATS).take(source.mesh.vertex_count()).enumerate() {
        out.copy_from_slice(&source.base(order.map_or(packed, |o| o[packed] as usize)));
    }
    base
}
