//! A group of a packed mesh: six components per vertex, their deltas and their layout.

use super::blocks::{BlockIndex, PoseGrid};
use super::formats::{DenseFormat, with_format};
use super::grid::{MeshSums, directions, refused};
use super::{BASE_STRIDE, DeltaFormat, POSE_FLOATS, PoseError, PoseFormat, Source, VERTEX_PADDING};
use crate::asset::streams::{Measure, StreamPlace, TRIPLES};
use crate::error::{Error, Result, ensure};
use crate::math::angle_degrees;
use crate::names::index_of;
use glam::Vec3;
use std::sync::Arc;

/// Six components per vertex, with their deltas, in the layout for upload that [`PackedMesh`](super::PackedMesh)
/// describes.
///
/// The first group of every mesh is position and normal. Further streams (tangents, morphing colours and texture
/// coordinates) fill further groups of six components, each with its own pose buffers;
/// [`PackedLayout::streams`](super::PackedLayout::streams) lists the streams of a group.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedGroup {
    pub(super) layout: PackedLayout,
    pub(super) base: Vec<f32>,
    pub(super) words: Vec<u32>,
}

impl PackedGroup {
    /// The layout.
    pub fn layout(&self) -> &PackedLayout {
        &self.layout
    }

    /// Base pose: [`POSE_FLOATS`] floats per vertex, padding included, in pose-buffer order.
    pub fn base(&self) -> &[f32] {
        &self.base
    }

    /// Delta words, in the layout of [`PackedMesh`](super::PackedMesh).
    pub fn deltas(&self) -> &[u32] {
        &self.words
    }

    /// Words of target `target` for `vertices` vertices starting at `first`, all in one chunk (dense formats).
    pub(crate) fn rows(&self, target: usize, first: usize, vertices: usize) -> &[u32] {
        let at = self.layout.word_index(target, first);
        &self.words[at..at + vertices * self.layout.format.words()]
    }

    /// Calls `f(vertex, delta)` for each stored delta of target `target`: the vertex in the user's order, and the delta
    /// that kernels use, decoded in double precision. The order of vertices is unspecified; deltas may be zero.
    pub fn for_each_delta(&self, target: usize, mut f: impl FnMut(usize, [f64; POSE_FLOATS])) {
        let layout = &self.layout;
        if target >= layout.targets.len() {
            return;
        }
        if let Some(blocks) = &layout.blocks {
            for incidence in blocks.incidence(target) {
                let first = incidence.block as usize * blocks.size();
                blocks.for_each_lane(&self.words, incidence.entry as usize, &mut |lane, delta| {
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

    /// The packing error against `source`, which this was packed from.
    pub(super) fn measure_error(&self, source: &Source<'_>) -> PoseError {
        let streams = &self.layout.streams;
        // Directions are compared with the base added, everything else by deltas alone.
        let directions = directions(streams);
        let mut worst = PoseError::default();
        let mut decoded = vec![[0.0; POSE_FLOATS]; source.mesh.vertex_count()];
        for (t, target) in source.mesh.targets.iter().enumerate() {
            decoded.fill([0.0; POSE_FLOATS]);
            self.for_each_delta(t, |vertex, delta| decoded[vertex] = delta);
            for (vertex, delta) in source.deltas(target) {
                let base = source.base(vertex as usize);
                let mut exact = delta.map(f64::from);
                let mut found = decoded[vertex as usize];
                for c in directions.iter().cloned().flatten() {
                    exact[c] += f64::from(base[c]);
                    found[c] += f64::from(base[c]);
                }
                worst.add_vertex(streams, &found, &exact, |found, exact| angle_degrees(exact, found));
            }
        }
        worst
    }
}

/// A target of a packed mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedTarget {
    /// Its name.
    pub name: String,
    /// Input units per integer step of a delta in the group's first triple (positions); 1 for float32. The same for all
    /// targets in block formats.
    #[doc(hidden)]
    pub position_step: f32,
    /// log2 of the second triple's step (normals) / `position_step`; 0 for float32.
    #[doc(hidden)]
    pub normal_exponent: i8,
}

impl PackedTarget {
    /// `2^normal_exponent`: the ratio of the second triple's step to the first's.
    #[doc(hidden)]
    pub fn normal_ratio(&self) -> f32 {
        f32::from_bits(((i32::from(self.normal_exponent) + 127) as u32) << 23)
    }

    /// Input units per integer step of a delta in the second triple (normals).
    #[doc(hidden)]
    pub fn normal_step(&self) -> f32 {
        self.position_step * self.normal_ratio()
    }

    pub(crate) fn steps(&self) -> [f32; TRIPLES] {
        [self.position_step, self.normal_step()]
    }
}

/// The layout of a group of a [`PackedMesh`](crate::PackedMesh); stays on the host after upload.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedLayout {
    /// Name of the mesh.
    pub name: String,
    /// The delta format.
    pub format: DeltaFormat,
    /// The streams of the group.
    #[doc(hidden)]
    pub streams: Vec<StreamPlace>,
    /// Number of vertices, without padding.
    pub vertex_count: usize,
    /// Dense formats: vertices per chunk, a multiple of 64. The last chunk holds the remainder.
    #[doc(hidden)]
    pub chunk_vertices: usize,
    /// The length that tolerances and errors are fractions of, in input units: the diagonal of the bounding box of what
    /// targets move (of the smallest such part, if several are far apart). A part is what faces connect, and other
    /// parts within half its size. What no target moves does not count: a floor, a vertex far off.
    pub diagonal: f32,
    /// Origin of positions, in input units: 0, unless the mesh was [recentred](crate::PackedMesh::recentre).
    ///
    /// Base pose, poses, readbacks, bounds, skinning input and reference are relative to it. The host multiplies its
    /// model matrix, or each skin matrix, from the right by a translation by `origin`.
    pub origin: Vec3,
    /// The targets.
    pub targets: Vec<PackedTarget>,
    /// The faces as triangles, three vertices of pose buffers each: an index buffer for draws. Empty in all groups but
    /// the first.
    pub indices: Arc<[u32]>,
    /// The blocks; `None` in dense formats.
    #[doc(hidden)]
    pub blocks: Option<Arc<BlockIndex>>,
    /// Bounds on integer sums; `None` in dense formats without integers.
    pub(crate) sums: Option<MeshSums>,
}

impl PackedLayout {
    /// Number of vertices with padding: a multiple of 64 and of the block size.
    pub fn padded_vertices(&self) -> usize {
        let padding = self.blocks.as_ref().map_or(VERTEX_PADDING, |b| b.size().max(VERTEX_PADDING));
        self.vertex_count.next_multiple_of(padding)
    }

    /// The blocks.
    ///
    /// # Errors
    /// A dense format.
    pub(crate) fn index(&self) -> Result<&Arc<BlockIndex>> {
        self.blocks.as_ref().ok_or_else(|| {
            let text = format!("mesh '{}' has no blocks", self.name);
            Error::invalid(text, "pack it in a block format, such as 'fast' or 'small'")
        })
    }

    /// The packing error, measured when the mesh was packed; `None` in dense formats.
    pub fn error(&self) -> Option<PoseError> {
        self.blocks.as_ref().map(|blocks| blocks.error())
    }

    /// Refuses a mesh without vertices.
    pub(crate) fn check_not_empty(&self) -> Result<()> {
        ensure!(self.vertex_count > 0, format!("mesh '{}' has no vertices", self.name), "leave it out");
        Ok(())
    }

    /// The grid of fixed-point poses for weights up to `weight_max` in absolute value. `None`: 1 for 16-bit poses, the
    /// mesh's packed value ([`BlockDesc::weight_max`](super::blocks::BlockDesc::weight_max)) for 32-bit poses. All
    /// groups of a mesh have one grid of weights, which follows from all of them, and units of their own.
    ///
    /// # Errors
    /// Float32 deltas or poses; a `weight_max` that is not positive or too large; in any group of the mesh, sums that
    /// could overflow because it, or deltas relative to their step, are too large (the message names a position error
    /// that would do).
    #[doc(hidden)]
    pub fn grid(&self, pose: PoseFormat, weight_max: Option<f32>) -> Result<PoseGrid> {
        let sums = self.sums.as_ref().ok_or_else(|| refused(self.format, pose))?;
        sums.grid(pose, weight_max)
    }

    /// Updates what depends on the base pose.
    pub(super) fn take_base(&mut self, base: &[f32]) {
        let mut size = VERTEX_PADDING;
        if let Some(index) = &mut self.blocks {
            size = index.size();
            Arc::make_mut(index).take_base(base);
        }
        if let Some(sums) = &mut self.sums {
            Arc::make_mut(&mut sums.all)[sums.group].take_base(base, self.vertex_count, size);
        }
    }

    /// Whether the group has a stream measured in lengths, to which error budgets and drift bounds apply.
    pub(crate) fn has_lengths(&self) -> bool {
        self.streams.iter().any(|stream| stream.semantic.measure() == Measure::Length)
    }

    /// Chunks of a dense format: `(first vertex, vertices)`.
    #[doc(hidden)]
    pub fn chunks(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let all = self.padded_vertices();
        let step = self.chunk_vertices.max(1);
        (0..all).step_by(step).map(move |first| (first, step.min(all - first)))
    }

    /// Bytes of one pose, padding included.
    pub fn pose_bytes(&self, format: PoseFormat) -> u64 {
        (self.padded_vertices() * format.stride()) as u64
    }

    /// Bytes of the base pose, padding included. The integer sums of an instance take as many.
    #[doc(hidden)]
    pub fn base_bytes(&self) -> u64 {
        (self.padded_vertices() * BASE_STRIDE) as u64
    }

    /// Bytes of all deltas, padding included, without index data.
    #[doc(hidden)]
    pub fn delta_bytes(&self) -> u64 {
        match &self.blocks {
            Some(blocks) => blocks.delta_bytes(),
            None => (self.padded_vertices() * self.targets.len() * self.format.stride()) as u64,
        }
    }

    /// Device bytes of index data (headers of entries); 0 in dense formats.
    #[doc(hidden)]
    pub fn index_bytes(&self) -> u64 {
        self.blocks.as_ref().map_or(0, |b| b.index_bytes())
    }

    /// The user's index of vertex `packed` of pose buffers (equal in dense formats); `None` for padding.
    #[doc(hidden)]
    pub fn user_vertex(&self, packed: usize) -> Option<usize> {
        match &self.blocks {
            Some(blocks) => blocks.order().get(packed).map(|&v| v as usize),
            None => Some(packed).filter(|&v| v < self.vertex_count),
        }
    }

    /// Converts the user's vertex indices to pose-buffer indices, for another index buffer than
    /// [`indices`](Self::indices). Unchanged in dense formats.
    ///
    /// # Errors
    /// An index out of range.
    pub fn remap_indices(&self, indices: &mut [u32]) -> Result<()> {
        let Self { name, vertex_count, .. } = self;
        for index in &*indices {
            let what = || format!("index {index} for mesh '{name}' of {vertex_count} vertices");
            ensure!((*index as usize) < *vertex_count, what(), "pass the index buffer of this mesh");
        }
        if let Some(blocks) = &self.blocks {
            let packed = blocks.packed_vertices();
            indices.iter_mut().for_each(|i| *i = packed[*i as usize]);
        }
        Ok(())
    }

    /// Index of the first target called `name`, in any Unicode form. A linear search: to set weights every frame, look
    /// it up once.
    pub fn target_index(&self, name: &str) -> Option<usize> {
        index_of(self.targets.iter().map(|target| target.name.as_str()), name)
    }

    /// Converts a pose from pose-buffer order, with padding, to the user's vertex order, without padding. Missing
    /// vertices become NaN.
    pub fn to_user_order(&self, pose: &[f32]) -> Vec<f32> {
        let mut out = vec![f32::NAN; self.vertex_count * POSE_FLOATS];
        for (packed, from) in pose.chunks_exact(POSE_FLOATS).enumerate() {
            if let Some(vertex) = self.user_vertex(packed) {
                out[vertex * POSE_FLOATS..][..POSE_FLOATS].copy_from_slice(from);
            }
        }
        out
    }

    /// First word of the deltas of target `target` in the chunk of `vertices` vertices that starts at `first` (dense
    /// formats).
    #[doc(hidden)]
    pub fn row_start(&self, target: usize, first: usize, vertices: usize) -> usize {
        (first * self.targets.len() + target * vertices) * self.format.words()
    }

    /// First word of the delta of `vertex` in target `target` (dense formats).
    pub(super) fn word_index(&self, target: usize, vertex: usize) -> usize {
        let within = vertex % self.chunk_vertices;
        let first = vertex - within;
        let rows = self.chunk_vertices.min(self.padded_vertices() - first);
        self.row_start(target, first, rows) + within * self.format.words()
    }
}
