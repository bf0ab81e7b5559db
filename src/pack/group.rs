//! A group of a packed mesh: six numbers a vertex, their deltas, and where all of it is.

use super::blocks::{BlockIndex, PoseGrid};
use super::formats::{DenseFormat, with_format};
use super::grid::{Sums, refused};
use super::{BASE_STRIDE, DeltaFormat, POSE_FLOATS, PoseError, PoseFormat, Source, VERTEX_PADDING, stream_errors};
use crate::asset::streams::{Measure, StreamPlace, TRIPLES};
use crate::asset::{Faces, RenderVertices};
use crate::error::{Error, Result};
use crate::math::angle_degrees;
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// Six numbers of each vertex, with their deltas, laid out for upload. [`PackedMesh`](super::PackedMesh) has the
/// layouts.
///
/// A pose buffer holds six numbers a vertex: position and normal, the first group of every mesh and the only one of
/// most. A mesh with further streams (tangents, colours, texture coordinates that morph) has a group for each six
/// numbers of those, with pose buffers of its own; [`PackedLayout::streams`](field@super::PackedLayout::streams) says
/// which streams are in a group.
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
    pub fn for_each_delta(&self, target: usize, mut f: impl FnMut(usize, [f64; POSE_FLOATS])) {
        let layout = &self.layout;
        if target >= layout.targets.len() {
            return;
        }
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

/// A target of a [`PackedGroup`].
#[derive(Clone, Debug, PartialEq)]
pub struct PackedTarget {
    /// Its name.
    pub name: String,
    /// Input units per integer step of a delta in the first triple of the group (positions); 1 for float32. In block
    /// formats the same for all targets.
    pub position_step: f32,
    /// The step of the second triple (normals) is `position_step × 2^normal_exponent`; 0 for float32.
    pub normal_exponent: i8,
}

impl PackedTarget {
    /// Factor from the coefficient of the first triple to that of the second: `2^normal_exponent`.
    pub fn normal_ratio(&self) -> f32 {
        f32::from_bits(((i32::from(self.normal_exponent) + 127) as u32) << 23)
    }

    /// Input units per integer step of a delta in the second triple.
    pub fn normal_step(&self) -> f32 {
        self.position_step * self.normal_ratio()
    }

    /// The steps of both triples.
    pub(crate) fn steps(&self) -> [f32; TRIPLES] {
        [self.position_step, self.normal_step()]
    }
}

/// Where everything is in a [`PackedGroup`]; what the GPU side keeps of it after upload.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedLayout {
    /// Name of the mesh.
    pub name: String,
    /// Storage of the deltas.
    pub format: DeltaFormat,
    /// The streams of the group.
    pub streams: Vec<StreamPlace>,
    /// Number of vertices, without padding.
    pub vertex_count: usize,
    /// Dense formats: vertices of every chunk but the last, which has the rest. A multiple of 64.
    pub chunk_vertices: usize,
    /// Length of the base pose's bounding-box diagonal, in input units.
    pub diagonal: f32,
    /// What positions are relative to, in input units: 0, unless the mesh was [recentred](crate::MorphMesh::recentre).
    ///
    /// A host multiplies its model matrix, or each matrix of a skin, by a translation by it from the right. Base pose,
    /// pose buffers, readbacks, bounds, what skinning reads and the reference are all relative to it.
    pub origin: Vec3,
    /// The targets.
    pub targets: Vec<PackedTarget>,
    /// Block formats: the blocks.
    pub blocks: Option<Arc<BlockIndex>>,
    /// Dense formats of integers: how large sums may become.
    pub(crate) sums: Option<Sums>,
}

impl PackedLayout {
    /// Number of vertices with padding: a multiple of 64, or of the block size.
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

    /// The grid for poses of integers and weights up to `weight_max`, either sign; `None`: up to 1 in 16 bits, up to
    /// what the mesh was packed with ([`BlockDesc::weight_max`](super::blocks::BlockDesc::weight_max)) in 32.
    ///
    /// # Errors
    /// Deltas that are no integers, float32 poses; a largest weight that is not above 0, or too large; in blocks as
    /// [`BlockIndex::grid`].
    pub fn grid(&self, pose: PoseFormat, weight_max: Option<f32>) -> Result<PoseGrid> {
        match (&self.blocks, &self.sums) {
            (Some(index), _) => index.grid(pose, weight_max),
            (None, Some(sums)) => sums.grid(pose, weight_max),
            (None, None) => Err(refused(self.format, pose)),
        }
    }

    /// Most targets that any vertex may be moved by: those of its block, or of the mesh's vertex that most targets move
    /// (`snorm16`). 0 in formats without integers.
    pub fn most_targets(&self) -> usize {
        let sums = self.blocks.as_ref().map(|index| &index.sums).or(self.sums.as_ref());
        sums.map_or(0, |sums| sums.targets)
    }

    /// Whether errors of some stream are lengths: what error budgets and bounds on drift speak of.
    pub(crate) fn has_lengths(&self) -> bool {
        self.streams.iter().any(|stream| stream.semantic.measure() == Measure::Length)
    }

    /// The chunks of a dense format: `(first vertex, vertices)`.
    pub fn chunks(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (all, step) = (self.padded_vertices(), self.chunk_vertices.max(1));
        (0..all).step_by(step).map(move |first| (first, step.min(all - first)))
    }

    /// Bytes of one pose, padding included.
    pub fn pose_bytes(&self, format: PoseFormat) -> u64 {
        (self.padded_vertices() * format.stride()) as u64
    }

    /// Bytes of the base pose, padding included; as many as the integer sums of an instance take.
    pub fn base_bytes(&self) -> u64 {
        (self.padded_vertices() * BASE_STRIDE) as u64
    }

    /// Bytes of all deltas, padding included; without what says which vertices they belong to.
    pub fn delta_bytes(&self) -> u64 {
        match &self.blocks {
            Some(blocks) => blocks.delta_bytes(),
            None => (self.padded_vertices() * self.targets.len() * self.format.stride()) as u64,
        }
    }

    /// Bytes on the device that say which vertices the deltas belong to and how they are stored; 0 in dense formats.
    pub fn index_bytes(&self) -> u64 {
        self.blocks.as_ref().map_or(0, |b| b.index_bytes())
    }

    /// The user's vertex that is at `packed` in pose buffers: the same number in dense formats. `None` for padding.
    pub fn user_vertex(&self, packed: usize) -> Option<usize> {
        match &self.blocks {
            Some(blocks) => blocks.order().get(packed).map(|&v| v as usize),
            None => Some(packed).filter(|&v| v < self.vertex_count),
        }
    }

    /// Turn the user's vertex indices (an index buffer) into those of pose buffers. Nothing changes in dense formats.
    ///
    /// # Errors
    /// An index that the mesh does not have.
    pub fn remap_indices(&self, indices: &mut [u32]) -> Result<()> {
        if let Some(bad) = indices.iter().find(|&&i| i as usize >= self.vertex_count) {
            return Err(Error::invalid(
                format!("index {bad} for mesh '{}' of {} vertices", self.name, self.vertex_count),
                "hand in the index buffer of this mesh",
            ));
        }
        if let Some(blocks) = &self.blocks {
            let packed = blocks.packed_vertices();
            indices.iter_mut().for_each(|i| *i = packed[*i as usize]);
        }
        Ok(())
    }

    /// The vertices that draw `faces` of this mesh, in the order of pose buffers, and their index buffer.
    ///
    /// Of a mesh that is [split](crate::asset::MorphSource::split), `pose_vertices` counts up: pose buffers and a
    /// buffer of `texcoords` are drawn as they are, by one index buffer. Otherwise doubled vertices follow, for hosts
    /// that look up the pose in the vertex shader.
    ///
    /// # Errors
    /// Faces or texture coordinates of another mesh.
    pub fn render_vertices(&self, faces: &Faces, texcoords: &[Vec2]) -> Result<RenderVertices> {
        let mut render = faces.render_vertices(self.vertex_count, texcoords)?;
        self.remap_indices(&mut render.pose_vertices)?;
        let packed = render.pose_vertices[..self.vertex_count].to_vec();
        let by_user = render.texcoords[..self.vertex_count].to_vec();
        for (user, &at) in packed.iter().enumerate() {
            render.texcoords[at as usize] = by_user[user];
            render.pose_vertices[user] = user as u32;
        }
        for index in render.indices.iter_mut().filter(|index| (**index as usize) < self.vertex_count) {
            *index = packed[*index as usize];
        }
        Ok(render)
    }

    /// The index of the target called `name`, of several the first. This looks through the names: where weights are set
    /// every frame, look it up once.
    pub fn target_index(&self, name: &str) -> Option<usize> {
        self.targets.iter().position(|target| target.name == name)
    }

    /// A pose as pose buffers hold it (padding and all), in the user's vertex order and without padding. Vertices that
    /// it lacks come out as NaN.
    pub fn to_user_order(&self, pose: &[f32]) -> Vec<f32> {
        let numbers = self.vertex_count * POSE_FLOATS;
        match &self.blocks {
            None => match pose.get(..numbers) {
                Some(pose) => pose.to_vec(),
                None => pose.iter().copied().chain(std::iter::repeat(f32::NAN)).take(numbers).collect(),
            },
            Some(blocks) => {
                let mut out = vec![f32::NAN; numbers];
                for (vertex, from) in blocks.order().iter().zip(pose.chunks_exact(POSE_FLOATS)) {
                    out[*vertex as usize * POSE_FLOATS..][..POSE_FLOATS].copy_from_slice(from);
                }
                out
            }
        }
    }

    /// Index of the first word of the deltas of target `target` in the chunk that starts at vertex `first` and
    /// has `vertices` (dense formats).
    pub fn row_start(&self, target: usize, first: usize, vertices: usize) -> usize {
        (first * self.targets.len() + target * vertices) * self.format.words()
    }

    /// Index of the first word of the delta of `vertex` in target `target` (dense formats).
    pub(super) fn word_index(&self, target: usize, vertex: usize) -> usize {
        let within = vertex % self.chunk_vertices;
        let first = vertex - within;
        let rows = self.chunk_vertices.min(self.padded_vertices() - first);
        self.row_start(target, first, rows) + within * self.format.words()
    }
}
