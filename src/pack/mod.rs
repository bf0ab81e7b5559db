//! Packing: base pose and deltas in the 32-bit words that kernels read.

mod alike;
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

use crate::asset::streams::GROUP_COMPONENTS;
use crate::asset::{Faces, KeptMesh, Mesh, RenderVertices, Tolerance};
use crate::error::{Result, ensure};
use crate::math::far_middle;
use crate::weights::WeightClip;
use blocks::BlockDesc;
pub use error::PoseError;
pub use formats::DeltaFormat;
use formats::with_format;
use glam::{Vec2, Vec3};
use grid::{MeshSums, Sums};
pub use group::{PackedGroup, PackedLayout, PackedTarget};
pub use poses::PoseFormat;
pub(crate) use source::Source;
use std::sync::Arc;

/// Dense formats pad vertices to a multiple of this: the workgroup size of dense kernels, even (feedback passes draw
/// lines), and a multiple of every device's buffer-offset alignment (64 × 12 bytes).
pub const VERTEX_PADDING: usize = 64;

/// Components per vertex of a group's pose.
pub const POSE_FLOATS: usize = GROUP_COMPONENTS;

/// Bytes per vertex of the base pose, which is float32 with every pose format.
pub const BASE_STRIDE: usize = POSE_FLOATS * size_of::<f32>();

/// Describes how a mesh is packed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PackDesc {
    /// The delta format.
    pub format: DeltaFormat,
    /// The deltas that are dropped as rounding noise.
    pub tolerance: Tolerance,
    /// Dense formats: largest bytes of deltas per chunk, `maxStorageBufferRange` of the device.
    #[doc(hidden)]
    pub max_chunk_bytes: u64,
    /// Dense formats: largest number of vertices per chunk, 64 × workgroups per dispatch of the device.
    #[doc(hidden)]
    pub max_chunk_vertices: u64,
    /// Block formats: block size and error limits.
    pub blocks: BlockDesc,
}

impl PackDesc {
    /// For any device of Khronos' Android baseline: chunks of at most 128 MiB and 65,535 workgroups.
    pub fn new(format: DeltaFormat) -> Self {
        Self { format, ..Self::default() }
    }
}

impl Default for PackDesc {
    /// Float32, for any device of Khronos' Android baseline: chunks of at most 128 MiB and 65,535 workgroups.
    fn default() -> Self {
        Self {
            format: DeltaFormat::Float32,
            tolerance: Tolerance::default(),
            max_chunk_bytes: 128 << 20,
            max_chunk_vertices: 65_535 * VERTEX_PADDING as u64,
            blocks: BlockDesc::default(),
        }
    }
}

/// A mesh laid out for upload as 32-bit words, in one of two layouts.
///
/// *Dense* formats hold every vertex of every target, in the user's vertex order:
///
/// ```text
/// base    [vertex][px py pz nx ny nz]                      24 bytes a vertex (a float32 pose, too)
/// deltas  [chunk][target][vertex in chunk][words]          24 bytes (float32) or 12 bytes (snorm16)
/// ```
///
/// The six components of a vertex are a *group* of streams ([`Semantic`](crate::Semantic)): position and normal;
/// further groups of the same layout hold further streams. All groups of a mesh share the vertex order and the blocks;
/// each has its own base pose and deltas.
///
/// Vertices are padded with zeros to a multiple of 64, so that kernels need no bounds checks. A mesh has one chunk,
/// unless its deltas exceed the device's storage-buffer range or its vertices the workgroups of a dispatch
/// ([`PackDesc`]).
///
/// *Block* formats reorder the vertices so that each target covers few runs of consecutive vertices, and store only
/// those (docs/notes/blocks.md). A mesh in such a format [reads](Self::read) and [writes](Self::write) itself as a file
/// (`*.dmorph`).
#[derive(Clone, Debug, PartialEq)]
pub struct PackedMesh {
    /// At least one; the first is position and normal.
    groups: Vec<PackedGroup>,
    /// Faces, which index the user's vertices.
    pub faces: Faces,
    /// Texture coordinates, indexed by the faces.
    pub texcoords: Vec<Vec2>,
    /// For each vertex the first vertex at the same position, or empty: [`Mesh::welds`].
    pub welds: Vec<u32>,
    /// The tolerance that it was packed with.
    pub tolerance: Tolerance,
    /// Weight clips that a file holds beside the mesh; packing makes none.
    pub clips: Vec<WeightClip>,
    /// What reading a file left out, for a person to see.
    pub notes: Vec<String>,
}

impl Mesh {
    /// Checks the mesh, drops deltas within `desc.tolerance`, computes missing normals, and packs the rest. Names of
    /// targets get Unicode's composed form (NFC), in which they are compared.
    ///
    /// A vertex stays in a target if its position delta is longer than `tolerance.position × diagonal`
    /// ([`PackedLayout::diagonal`]) or its normal delta longer than `tolerance.normal`. A position delta within the
    /// tolerance becomes exactly zero even if the vertex stays for its normal.
    ///
    /// A missing normal is computed as the normalised sum of the area vectors of the faces around the vertex. A polygon
    /// counts with its whole area vector (the sum over its triangle fan) at each of its corners, so the result differs
    /// from that of its triangles. If the sum is zero (no face, or faces without area), the normal is (0, 0, 1). The
    /// normal delta of a target is the difference of two such normals. They are computed on the welded surface from the
    /// position deltas that are kept: they are smooth across doubled vertices, and dropped noise does not come back. A
    /// vertex whose deformed surface has no normal (faces folded to nothing) keeps the base normal.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) for: no vertex or more than 2³² − 1; an index out of range; deltas
    /// that are not ascending by vertex; a value that is not finite; a face of fewer than three corners; a base normal
    /// or tangent that is not of unit length (within 1%); a tangent whose w is not 1 or -1; a stream that comes twice
    /// or with a wrong number of values; welded vertices that are not at one position; two targets of one name, or more
    /// than 65,536; a tolerance that is negative or not finite. Dense formats: `desc.max_chunk_bytes` does not fit all
    /// targets of 64 vertices. Block formats: invalid values of [`BlockDesc`].
    pub fn pack(&self, desc: &PackDesc) -> Result<PackedMesh> {
        PackedMesh::pack(&self.kept(desc.tolerance)?, desc)
    }
}

/// Most targets of a mesh: kernels use 16-bit target indices.
pub const TARGETS_MAX: usize = 1 << 16;

impl PackedMesh {
    /// Packs `mesh`, which was checked when it was made, whatever `desc.tolerance` is.
    ///
    /// # Errors
    /// Too many targets, and those of `desc`.
    #[doc(hidden)]
    pub fn pack(mesh: &KeptMesh, desc: &PackDesc) -> Result<Self> {
        let targets = mesh.targets.len();
        let what = format!("mesh '{}' has {targets} targets; the kernels name at most {TARGETS_MAX}", mesh.name);
        ensure!(targets <= TARGETS_MAX, what, "split the targets over several meshes");
        let sources = Source::groups(mesh);
        let groups = with_format!(desc.format,
            dense format => sources.iter().map(|source| dense::pack(source, desc, format)).collect::<Result<Vec<_>>>(),
            blocks format => blocks::pack(&sources, desc, format)
        )?;
        let packed = Self {
            groups,
            faces: mesh.faces.clone(),
            texcoords: mesh.texcoords.clone(),
            welds: mesh.welds.clone(),
            tolerance: mesh.tolerance,
            clips: vec![],
            notes: vec![],
        };
        packed.complete()
    }

    /// A mesh of at least one group, with what follows from all of them and the faces.
    fn complete(mut self) -> Result<Self> {
        Self::share_sums(&mut self.groups);
        let mut indices = self.faces.triangles(&self.positions()).into_flattened();
        let layout = &mut self.groups[0].layout;
        layout.remap_indices(&mut indices)?;
        layout.indices = indices.into();
        Ok(self)
    }

    /// Tells each group the bounds on the integer sums of all: they share the grid of weights, on which no sum of any
    /// group may overflow.
    fn share_sums(groups: &mut [PackedGroup]) {
        let own = |group: &PackedGroup| group.layout.sums.as_ref().map(|sums| sums.all[sums.group].clone());
        let all: Option<Arc<[Sums]>> = groups.iter().map(own).collect();
        for (group, PackedGroup { layout, .. }) in groups.iter_mut().enumerate() {
            layout.sums = all.clone().map(|all| MeshSums { all, group });
        }
    }

    /// Render vertices in pose-buffer order, and their index buffer.
    ///
    /// If the mesh is [split](crate::asset::Mesh::split), `pose_vertices` is 0, 1, 2 …: pose buffers and
    /// `texcoords` can be drawn directly with one index buffer. Otherwise duplicated vertices follow the mesh's own,
    /// for hosts that fetch the pose in the vertex shader.
    ///
    /// # Errors
    /// Faces or texture coordinates that do not match the mesh.
    pub fn render_vertices(&self) -> Result<RenderVertices> {
        let layout = self.layout();
        let mut render = self.faces.render_vertices(&self.positions(), &self.texcoords)?;
        layout.remap_indices(&mut render.pose_vertices)?;
        let packed = render.pose_vertices[..layout.vertex_count].to_vec();
        let by_user = render.texcoords[..layout.vertex_count].to_vec();
        for (user, &at) in packed.iter().enumerate() {
            render.texcoords[at as usize] = by_user[user];
            render.pose_vertices[user] = user as u32;
        }
        for index in render.indices.iter_mut().filter(|index| (**index as usize) < layout.vertex_count) {
            *index = packed[*index as usize];
        }
        Ok(render)
    }

    /// Positions of the base pose in the user's order.
    fn positions(&self) -> Vec<Vec3> {
        let base = self.layout().to_user_order(self.base());
        base.chunks_exact(POSE_FLOATS).map(Vec3::from_slice).collect()
    }

    /// Makes positions relative to the middle of the mesh if it is far from 0. Poses gain precision, since the rounding
    /// of float32 grows with a coordinate. On each axis whose largest coordinate is at least twice the diagonal,
    /// the origin becomes the middle of the bounding box and is subtracted from positions, without rounding. Other axes
    /// stay as they are.
    ///
    /// The renderer adds [`PackedLayout::origin`] back in the model matrix.
    pub fn recentre(&mut self) {
        let PackedGroup { layout, base, .. } = &mut self.groups[0];
        let vertices = &mut base.as_chunks_mut::<POSE_FLOATS>().0[..layout.vertex_count];
        let middle = far_middle(vertices.iter().map(|vertex| Vec3::from_slice(vertex)));
        for vertex in vertices {
            vertex.iter_mut().zip(middle.to_array()).for_each(|(number, of)| *number -= of);
        }
        layout.take_base(base);
        self.groups.iter_mut().for_each(|group| group.layout.origin += middle);
        Self::share_sums(&mut self.groups);
    }

    /// The layout of position and normal, then those of groups of further streams.
    pub fn layouts(&self) -> impl Iterator<Item = &PackedLayout> + Clone {
        self.groups.iter().map(PackedGroup::layout)
    }

    /// Position and normal, then groups of further streams.
    #[doc(hidden)]
    pub fn groups(&self) -> &[PackedGroup] {
        &self.groups
    }

    /// The group of position and normal.
    #[doc(hidden)]
    pub fn surface(&self) -> &PackedGroup {
        &self.groups[0]
    }

    /// The layout of position and normal.
    pub fn layout(&self) -> &PackedLayout {
        self.surface().layout()
    }

    /// [`PackedGroup::base`] of the first group.
    #[doc(hidden)]
    pub fn base(&self) -> &[f32] {
        self.surface().base()
    }

    /// [`PackedGroup::for_each_delta`] of the first group.
    #[doc(hidden)]
    pub fn for_each_delta(&self, target: usize, f: impl FnMut(usize, [f64; POSE_FLOATS])) {
        self.surface().for_each_delta(target, f);
    }

    /// The packing error against `mesh`, which this was packed from; NaN if `mesh` has other targets or vertices.
    #[doc(hidden)]
    pub fn measure_error(&self, mesh: &KeptMesh) -> PoseError {
        let vertices = self.layout().vertex_count;
        let targets = self.layout().targets.len();
        if mesh.vertex_count() != vertices || mesh.targets.len() != targets {
            return PoseError::NAN;
        }
        let each = self.groups.iter().map(|group| group.measure_error(&Source::new(mesh, &group.layout().streams)));
        each.fold(PoseError::default(), PoseError::max)
    }
}

#[cfg(test)]
mod tests;
