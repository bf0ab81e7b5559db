//! Packing: base pose and deltas in words of 32 bits, as the kernels read them.

pub mod blocks;
mod dense;
mod error;
pub mod file;
pub(crate) mod formats;
pub(crate) mod grid;
mod group;
mod order;
pub(crate) mod poses;
mod source;
pub(crate) mod vertex;

use crate::asset::MorphMesh;
use crate::asset::streams::GROUP_COMPONENTS;
use crate::error::{Error, Result};
use crate::math::far_middle;
use crate::setters::setters;
use blocks::BlockDesc;
pub use error::PoseError;
pub(crate) use error::stream_errors;
pub use formats::DeltaFormat;
use formats::with_format;
use glam::Vec3;
pub use group::{PackedGroup, PackedLayout, PackedTarget};
pub use poses::PoseFormat;
pub(crate) use source::Source;
use std::sync::Arc;
pub use vertex::VertexLayout;

/// Dense formats pad vertices to a multiple of this: the workgroup size of every dense kernel, an even number (the
/// feedback passes draw lines), and a multiple of every device's buffer-offset alignment (64 × 12 bytes).
pub const VERTEX_PADDING: usize = 64;

/// Floats of one vertex of a pose: a group.
pub const POSE_FLOATS: usize = GROUP_COMPONENTS;

/// Bytes of one vertex of the base pose: float32, whatever the format of poses.
pub const BASE_STRIDE: usize = POSE_FLOATS * size_of::<f32>();

/// How to pack.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PackDesc {
    /// Storage of the deltas.
    pub format: DeltaFormat,
    /// Dense formats: most bytes of deltas that one descriptor may cover: the device's `maxStorageBufferRange`.
    pub max_chunk_bytes: u64,
    /// Dense formats: most vertices of a chunk: the device's workgroups per dispatch × 64.
    pub max_chunk_vertices: u64,
    /// Block formats: size of a block, and how much may be lost.
    pub blocks: BlockDesc,
}

setters!(PackDesc { format: DeltaFormat, max_chunk_bytes: u64, max_chunk_vertices: u64, blocks: BlockDesc });

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

/// A mesh laid out for upload, in words of 32 bits and in one of two layouts.
///
/// *Dense* formats hold every vertex of every target, in the user's vertex order:
///
/// ```text
/// base    [vertex][px py pz nx ny nz]                      24 bytes a vertex (a float32 pose, too)
/// deltas  [chunk][target][vertex in chunk][words]          24 bytes (float32) or 12 bytes (snorm16)
/// ```
///
/// The six numbers of a vertex are a *group* of streams ([`Semantic`](crate::Semantic)): position and normal, and in
/// further groups of the same layout whatever else vertices have. All groups of a mesh have the same order of vertices
/// and the same blocks; base pose, deltas, and what is derived from them are each group's own.
///
/// Vertices are padded with zeros to a multiple of 64, so that no kernel needs a bounds check.
/// A mesh has one chunk unless its deltas exceed the storage-buffer range of the device, or its vertices the
/// workgroups of a dispatch ([`PackDesc`]); then its vertices are cut into chunks that fit.
///
/// *Block* formats reorder the vertices so that a target covers few runs of consecutive vertices, and hold only those:
/// see [`BlockIndex`](crate::BlockIndex).
#[derive(Clone, Debug, PartialEq)]
pub struct PackedMesh {
    /// At least one: the first is position and normal.
    groups: Vec<PackedGroup>,
}

/// Targets are named by 16 bits in the kernels.
pub const TARGETS_MAX: usize = 1 << 16;

impl PackedMesh {
    /// Lay out `mesh`.
    ///
    /// # Errors
    /// More than 65,536 targets; streams that do not fit the vertices. Dense formats: more targets than fit
    /// `desc.max_chunk_bytes` even for 64 vertices. Block formats: as [`BlockDesc`].
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
        let sources = Source::groups(mesh)?;
        let groups = with_format!(desc.format,
            dense format => sources.iter().map(|source| dense::pack(source, desc, format)).collect::<Result<Vec<_>>>(),
            blocks format => blocks::pack(&sources, desc, format)
        )?;
        Ok(Self::of_groups(groups))
    }

    /// The mesh of these groups, of which there is one at least. Weights are the mesh's, and so is their grid, on which
    /// sums of no group may overflow.
    fn of_groups(mut groups: Vec<PackedGroup>) -> Self {
        let sums = groups.iter().filter_map(|group| Some(group.layout.blocks.as_ref()?.sums.largest_of_mesh));
        let largest = sums.fold(0.0, f64::max);
        for index in groups.iter_mut().filter_map(|group| group.layout.blocks.as_mut()) {
            if index.sums.largest_of_mesh != largest {
                Arc::make_mut(index).sums.largest_of_mesh = largest;
            }
        }
        Self { groups }
    }

    /// [`MorphMesh::recentre`] of a mesh that is packed, such as one of a file, which states positions as the input has
    /// them.
    pub fn recentre(&mut self) {
        let PackedGroup { layout, base, .. } = &mut self.groups[0];
        let vertices = &mut base.as_chunks_mut::<POSE_FLOATS>().0[..layout.vertex_count];
        let middle = far_middle(vertices.iter().map(|vertex| Vec3::from_slice(vertex)));
        for vertex in vertices {
            vertex.iter_mut().zip(middle.to_array()).for_each(|(number, of)| *number -= of);
        }
        if let Some(index) = &mut layout.blocks {
            Arc::make_mut(index).take_base(base);
        }
        self.groups.iter_mut().for_each(|group| group.layout.origin += middle);
    }

    /// The groups of streams: position and normal, then whatever else the mesh has.
    pub fn groups(&self) -> &[PackedGroup] {
        &self.groups
    }

    /// Position and normal.
    pub fn surface(&self) -> &PackedGroup {
        &self.groups[0]
    }

    /// [`PackedGroup::layout`] of positions and normals.
    pub fn layout(&self) -> &PackedLayout {
        self.surface().layout()
    }

    /// [`PackedGroup::base`] of positions and normals.
    pub fn base(&self) -> &[f32] {
        self.surface().base()
    }

    /// [`PackedGroup::deltas`] of positions and normals.
    pub fn deltas(&self) -> &[u32] {
        self.surface().deltas()
    }

    /// [`PackedGroup::for_each_delta`] of positions and normals.
    pub fn for_each_delta(&self, target: usize, f: impl FnMut(usize, [f64; POSE_FLOATS])) {
        self.surface().for_each_delta(target, f);
    }

    /// What packing lost of `mesh`, which this was packed from; NaN, which is within no bound, where that has other
    /// targets or vertices, or is not right in itself.
    pub fn measure_error(&self, mesh: &MorphMesh) -> PoseError {
        let (vertices, targets) = (self.layout().vertex_count, self.layout().targets.len());
        if mesh.vertex_count() != vertices || mesh.targets.len() != targets || Source::groups(mesh).is_err() {
            return PoseError::NAN;
        }
        let each = self.groups.iter().map(|group| group.measure_error(&Source::new(mesh, &group.layout().streams)));
        each.fold(PoseError::default(), PoseError::max)
    }
}

#[cfg(test)]
mod tests;
