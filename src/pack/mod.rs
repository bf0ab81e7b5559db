//! What the update paths read: base pose and deltas in words of 32 bits, in one of two layouts.
//!
//! *Dense* formats hold every vertex of every target, in the user's vertex order:
//!
//! ```text
//! base    [vertex][px py pz nx ny nz]                      24 bytes a vertex (the layout of a pose, too)
//! deltas  [chunk][target][vertex in chunk][words]          24 bytes (float32) or 12 bytes (snorm16)
//! ```
//!
//! Vertices are padded with zeros to a multiple of [`VERTEX_PADDING`], so that no kernel needs a bounds check.
//! A mesh has one chunk unless its deltas exceed the storage-buffer range of the device, or its vertices the
//! workgroups of a dispatch ([`PackDesc`]); then its vertices are cut into chunks that fit.
//!
//! *Block* formats reorder the vertices so that a target covers few runs of consecutive vertices, and hold only those:
//! see [`blocks`].

pub mod blocks;
mod dense;
pub mod file;
pub(crate) mod formats;
mod order;

use crate::asset::{Faces, RenderVertices};
use crate::error::{Error, Result};
use crate::math::angle_degrees;
use crate::mesh::MorphMesh;
use blocks::{BlockDesc, BlockIndex};
pub use formats::DeltaFormat;
use formats::{DenseFormat, with_format};
use glam::{DVec3, Vec2};
use std::sync::Arc;

/// Dense formats pad vertices to a multiple of this: the workgroup size of every dense kernel, an even number (the
/// feedback passes draw lines), and a multiple of every device's buffer-offset alignment (64 × 12 bytes).
pub const VERTEX_PADDING: usize = 64;

/// Floats of one vertex of a pose: position, then normal.
pub const POSE_FLOATS: usize = 6;

/// Bytes of one vertex of a pose.
pub const POSE_STRIDE: usize = POSE_FLOATS * 4;

/// How to pack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PackDesc {
    /// Storage of the deltas.
    pub format: DeltaFormat,
    /// Dense formats: most bytes of deltas that one descriptor may cover: the device's `maxStorageBufferRange`.
    pub max_chunk_bytes: u64,
    /// Dense formats: most vertices of a chunk: the device's workgroups per dispatch × [`VERTEX_PADDING`].
    pub max_chunk_vertices: u64,
    /// Block formats: size of a block, and how much may be lost.
    pub blocks: BlockDesc,
}

impl PackDesc {
    /// Any device of Khronos' Android baseline: chunks of 128 MiB and 65,535 workgroups.
    pub fn new(format: DeltaFormat) -> Self {
        Self { format, ..Self::default() }
    }
}

impl Default for PackDesc {
    /// float32, in chunks of 128 MiB and 65,535 workgroups (the least that Khronos' Android profiles promise).
    fn default() -> Self {
        Self {
            format: DeltaFormat::Float32,
            max_chunk_bytes: 128 << 20,
            max_chunk_vertices: 65_535 * VERTEX_PADDING as u64,
            blocks: BlockDesc::default(),
        }
    }
}

/// A target of a [`PackedMesh`].
#[derive(Clone, Debug, PartialEq)]
pub struct PackedTarget {
    /// Its name.
    pub name: String,
    /// Length units per integer step of a position delta; 1 for float32. The same for all targets in block formats.
    pub position_step: f32,
    /// The step of normals is `position_step × 2^normal_exponent`; 0 for float32.
    pub normal_exponent: i8,
}

impl PackedTarget {
    /// Factor from the coefficient of positions to that of normals: `2^normal_exponent`.
    pub fn normal_ratio(&self) -> f32 {
        f32::from_bits(((i32::from(self.normal_exponent) + 127) as u32) << 23)
    }

    /// Normal units per integer step of a normal delta.
    pub fn normal_step(&self) -> f32 {
        self.position_step * self.normal_ratio()
    }
}

/// What packing lost, measured: each target at weight 1, against the mesh that was packed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PackError {
    /// Largest error of a position delta, in input units.
    pub position: f64,
    /// Largest angle between the exact and the decoded normal, in degrees.
    pub normal_degrees: f64,
}

/// Where everything is in a [`PackedMesh`]; what the GPU side keeps of it after upload.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedLayout {
    /// Name of the mesh.
    pub name: String,
    /// Storage of the deltas.
    pub format: DeltaFormat,
    /// Number of vertices, without padding.
    pub vertex_count: usize,
    /// Dense formats: vertices of every chunk but the last, which has the rest. A multiple of [`VERTEX_PADDING`].
    pub chunk_vertices: usize,
    /// Length of the base pose's bounding-box diagonal, in input units.
    pub diagonal: f32,
    /// The targets.
    pub targets: Vec<PackedTarget>,
    /// Block formats: the blocks.
    pub blocks: Option<Arc<BlockIndex>>,
}

impl PackedLayout {
    /// Number of vertices with padding: a multiple of [`VERTEX_PADDING`], or of the block size.
    pub fn padded_vertices(&self) -> usize {
        let padding = self.blocks.as_ref().map_or(VERTEX_PADDING, |b| b.size().max(VERTEX_PADDING));
        self.vertex_count.next_multiple_of(padding)
    }

    /// The chunks of a dense format: `(first vertex, vertices)`.
    pub fn chunks(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (all, step) = (self.padded_vertices(), self.chunk_vertices.max(1));
        (0..all).step_by(step).map(move |first| (first, step.min(all - first)))
    }

    /// Bytes of one pose, padding included.
    pub fn pose_bytes(&self) -> u64 {
        (self.padded_vertices() * POSE_STRIDE) as u64
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
    /// Of a mesh that is [split](crate::asset::MorphSource::split), `pose_vertices` counts up: pose buffers and a buffer of
    /// `texcoords` are drawn as they are, by one index buffer. Otherwise doubled vertices follow, for hosts that look up
    /// the pose in the vertex shader.
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

    /// A pose as pose buffers hold it (padding and all), in the user's vertex order and without padding.
    ///
    /// # Panics
    /// When the pose has fewer vertices than the mesh.
    pub fn to_user_order(&self, pose: &[f32]) -> Vec<f32> {
        match &self.blocks {
            None => pose[..self.vertex_count * POSE_FLOATS].to_vec(),
            Some(blocks) => {
                let mut out = vec![0.0; self.vertex_count * POSE_FLOATS];
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
    fn word_index(&self, target: usize, vertex: usize) -> usize {
        let within = vertex % self.chunk_vertices;
        let first = vertex - within;
        let rows = self.chunk_vertices.min(self.padded_vertices() - first);
        self.row_start(target, first, rows) + within * self.format.words()
    }
}

/// A mesh laid out for upload. See the [module](self) for the layouts.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedMesh {
    layout: PackedLayout,
    base: Vec<f32>,
    words: Vec<u32>,
}

/// Targets are named by 16 bits in the kernels.
pub(crate) const TARGETS_MAX: usize = 1 << 16;

impl PackedMesh {
    /// Lay out `mesh`.
    ///
    /// # Errors
    /// More than 65,536 targets. Dense formats: more targets than fit `desc.max_chunk_bytes` even for
    /// [`VERTEX_PADDING`] vertices. Block formats: as [`BlockDesc`].
    pub fn pack(mesh: &MorphMesh, desc: &PackDesc) -> Result<Self> {
        if mesh.targets.len() > TARGETS_MAX {
            return Err(Error::invalid(
                format!(
                    "mesh '{}' has {} targets; the kernels name at most {TARGETS_MAX}",
                    mesh.name,
                    mesh.targets.len()
                ),
                "split the targets over several meshes",
            ));
        }
        with_format!(desc.format, dense f => dense::pack(mesh, desc, f), blocks f => blocks::pack(mesh, desc, f))
    }

    /// Call `f` with every vertex that target `target` holds a delta for, in the user's order of vertices, and the
    /// delta that the kernels see, decoded in double precision: position, then normal. Vertices come in no
    /// particular order; some deltas may be zero.
    ///
    /// # Panics
    /// When `target` is out of range.
    pub fn for_each_delta(&self, target: usize, mut f: impl FnMut(usize, [f64; POSE_FLOATS])) {
        match &self.layout.blocks {
            Some(blocks) => blocks.for_each_delta(&self.words, target, f),
            None => (0..self.layout.vertex_count).for_each(|vertex| f(vertex, self.dense_delta(target, vertex))),
        }
    }

    fn dense_delta(&self, target: usize, vertex: usize) -> [f64; POSE_FLOATS] {
        let at = self.layout.word_index(target, vertex);
        let words = &self.words[at..at + self.layout.format.words()];
        let info = &self.layout.targets[target];
        let steps = [info.position_step, info.normal_step()];
        with_format!(self.layout.format, dense f => f.decode(words, steps), blocks _f => [0.0; POSE_FLOATS])
    }

    /// What packing lost of `mesh`, which this was packed from.
    ///
    /// # Panics
    /// When `mesh` has other targets or vertices.
    pub fn measure_error(&self, mesh: &MorphMesh) -> PackError {
        let mut worst = PackError::default();
        let mut decoded = vec![[0.0; POSE_FLOATS]; mesh.vertex_count()];
        for (t, target) in mesh.targets.iter().enumerate() {
            decoded.fill([0.0; POSE_FLOATS]);
            self.for_each_delta(t, |vertex, delta| decoded[vertex] = delta);
            for (&v, (p, n)) in target.vertices.iter().zip(target.positions.iter().zip(&target.normals)) {
                let d = decoded[v as usize];
                let base = mesh.normals[v as usize].as_dvec3();
                let (exact, found) = (base + n.as_dvec3(), base + DVec3::from_slice(&d[3..]));
                worst.position = worst.position.max(p.as_dvec3().distance(DVec3::from_slice(&d[..3])));
                worst.normal_degrees = worst.normal_degrees.max(angle_degrees(exact, found));
            }
        }
        worst
    }

    pub(crate) fn words(&self) -> &[u32] {
        &self.words
    }

    /// The words of target `target` for `vertices` vertices from `first` on, all of one chunk (dense formats).
    pub(crate) fn rows(&self, target: usize, first: usize, vertices: usize) -> &[u32] {
        let at = self.layout.word_index(target, first);
        &self.words[at..at + vertices * self.layout.format.words()]
    }

    /// Where everything is.
    pub fn layout(&self) -> &PackedLayout {
        &self.layout
    }

    /// Base pose: [`POSE_FLOATS`] floats for each padded vertex, in the order of pose buffers.
    pub fn base(&self) -> &[f32] {
        &self.base
    }

    /// The deltas as words; see the [module](self) for the layout.
    pub fn deltas(&self) -> &[u32] {
        &self.words
    }
}

/// The base pose as pose buffers hold it, `padded` vertices, in `order` (packed → user) where there is one.
fn base_words(mesh: &MorphMesh, padded: usize, order: Option<&[u32]>) -> Vec<f32> {
    let mut base = vec![0.0; padded * POSE_FLOATS];
    for (packed, out) in base.chunks_exact_mut(POSE_FLOATS).take(mesh.vertex_count()).enumerate() {
        let user = order.map_or(packed, |o| o[packed] as usize);
        out[..3].copy_from_slice(&mesh.positions[user].to_array());
        out[3..].copy_from_slice(&mesh.normals[user].to_array());
    }
    base
}

#[cfg(test)]
mod tests;
