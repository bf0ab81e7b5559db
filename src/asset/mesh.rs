//! A mesh as its files state it, and the checked mesh that is packed.

use super::{Semantic, StreamData, StreamDeltas};
use crate::error::{Error, Result, ensure};
use crate::math::far_middle;
use crate::names::index_of;
use glam::{Vec2, Vec3};

/// One corner of a face: indices into positions and texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corner {
    /// Index into the positions.
    pub position: u32,
    /// Index into the texture coordinates; `None` if the corner has none.
    pub texcoord: Option<u32>,
}

/// The face list: polygons of any size, as the file has them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Faces {
    /// Number of corners of each face (≥ 3).
    pub sizes: Vec<u32>,
    /// The corners of all faces, one after the other.
    pub corners: Vec<Corner>,
}

impl Faces {
    /// Iterates over the faces, each as its corners.
    pub fn iter(&self) -> impl Iterator<Item = &[Corner]> {
        let mut rest = self.corners.as_slice();
        self.sizes.iter().map(move |&n| rest.split_off(..n as usize).unwrap_or_default())
    }

    /// Checks that every face has three corners or more, and every index is within `positions` and `texcoords`.
    pub(crate) fn check(&self, positions: usize, texcoords: usize) -> Result<()> {
        let refuse = |what: String| Error::invalid(what, "repair the face list");
        let total: u64 = self.sizes.iter().map(|&n| u64::from(n)).sum();
        let listed = self.corners.len() as u64;
        ensure!(total == listed, refuse(format!("the faces have {total} corners, the corner list has {listed}")));
        for (i, n) in self.sizes.iter().enumerate() {
            ensure!(*n >= 3, refuse(format!("face {i} has {n} corners, at least 3 expected")));
        }
        for Corner { position: v, texcoord } in &self.corners {
            ensure!((*v as usize) < positions, refuse(format!("a face names vertex {v}, there are {positions}")));
            if let Some(t) = texcoord.filter(|&t| t as usize >= texcoords) {
                return Err(refuse(format!("a face names texture coordinate {t}, there are {texcoords}")));
            }
        }
        Ok(())
    }
}

/// A morph target as a file states it.
#[derive(Clone, Debug, Default)]
pub struct MorphTarget {
    /// Name, unique within the source.
    pub name: String,
    /// `(vertex, target − base)` for every vertex whose position differs at all, ascending by vertex.
    pub positions: Vec<(u32, Vec3)>,
    /// `(vertex, target normal − base normal)`, ascending by vertex, as stated by the file (not re-normalised). `None`
    /// if the file states none: they are computed from the deformed surface.
    pub normals: Option<Vec<(u32, Vec3)>>,
    /// Deltas of the source's [`streams`](Mesh::streams), in their order; streams beyond the end do not change.
    pub streams: Vec<StreamDeltas>,
}

/// A base pose and its targets exactly as the input states them: no tolerance applied, no normal computed.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Name for messages and reports (a folder's or file's stem).
    pub name: String,
    /// Base positions, in the user's vertex order.
    pub positions: Vec<Vec3>,
    /// The offset that was subtracted from positions, in input units: 0 unless single precision cannot hold them.
    pub origin: Vec3,
    /// Base normals per position, unit length. `None` if the input has none: [`pack`](Self::pack) computes them.
    pub normals: Option<Vec<Vec3>>,
    /// Texture coordinates, indexed by [`Corner::texcoord`](super::Corner::texcoord).
    pub texcoords: Vec<Vec2>,
    /// The face list.
    pub faces: Faces,
    /// Other vertex attributes: tangents, colours, texture coordinates that morph.
    pub streams: Vec<StreamData>,
    /// For each vertex the first one at its position, which may be itself; empty if no vertices are doubled. Welded
    /// vertices share the computed normal, and the streams that they share stay equal bit for bit in every pose. See
    /// [`split`](Self::split) and [`weld`](Self::weld).
    pub welds: Vec<u32>,
    /// The targets; an empty target keeps its index.
    pub targets: Vec<MorphTarget>,
    /// Warnings of the importer (such as hard edges that were averaged).
    pub notes: Vec<String>,
}

/// Size up to which a delta counts as rounding noise and is dropped.
///
/// Deltas of other streams are compared with `normal` if they are directions (tangents), otherwise with `position`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Length of a position delta, as a fraction of [`PackedLayout::diagonal`](crate::PackedLayout::diagonal) (≥ 0).
    pub position: f32,
    /// Length of a normal delta (≥ 0; 0.001 is about 0.06°).
    pub normal: f32,
}

impl Tolerance {
    /// Keep every delta that is not exactly zero.
    pub const ZERO: Self = Self { position: 0.0, normal: 0.0 };
}

impl Default for Tolerance {
    /// 1e-6 of the diagonal for positions, 1e-3 (0.06°) for normals: neither is visible. With 43 targets active at
    /// once, as in captured clips, dropped position deltas add up to at most 4.3e-5 of the diagonal, and 99.9% of the
    /// normals are within 0.08° of those with nothing dropped.
    ///
    /// Normals computed for a mesh written with six digits (ICT FaceKit) have rounding noise: 1e-3 keeps 30.6% of the
    /// vertices in the mean over the targets, 1e-4 31.7%, 1e-2 30.3%, and positions alone 30.2%.
    fn default() -> Self {
        Self { position: 1e-6, normal: 1e-3 }
    }
}

/// One morph target: the vertices it moves and their deltas.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeptTarget {
    /// Name, unique within the mesh.
    pub name: String,
    /// Vertices with a delta, ascending, without repeats.
    pub vertices: Vec<u32>,
    /// Position delta (target − base) of each of `vertices`.
    pub positions: Vec<Vec3>,
    /// Normal delta of each of `vertices`.
    pub normals: Vec<Vec3>,
    /// Deltas of each of the mesh's [`streams`](KeptMesh::streams).
    pub streams: Vec<StreamDeltas>,
}

#[allow(clippy::wildcard_enum_match_arm, reason = "any other stream is kept like any other")]
impl KeptTarget {
    /// Add what is changed of a stream. Positions and normals are of the same vertices.
    pub(crate) fn push(&mut self, semantic: Semantic, vertices: Vec<u32>, deltas: Vec<f32>) {
        match semantic {
            Semantic::Position => (self.vertices, self.positions) = (vertices, vectors(&deltas)),
            Semantic::Normal => self.normals = vectors(&deltas),
            _ => self.streams.push(StreamDeltas { vertices, deltas }),
        }
    }
}

fn vectors(numbers: &[f32]) -> Vec<Vec3> {
    bytemuck::cast_slice(numbers).to_vec()
}

/// Base pose and morph targets, ready to pack: normals present, noise dropped, everything finite.
#[derive(Clone, Debug, Default)]
pub struct KeptMesh {
    /// Name for messages and reports.
    pub name: String,
    /// Base positions, in the user's vertex order, relative to `origin`.
    pub positions: Vec<Vec3>,
    /// The offset that was subtracted from positions, in input units: [`Mesh::origin`], and what
    /// [`recentre`](Self::recentre) adds.
    pub origin: Vec3,
    /// Base normals, unit length.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, indexed by [`Corner::texcoord`](super::Corner::texcoord).
    pub texcoords: Vec<Vec2>,
    /// The face list.
    pub faces: Faces,
    /// Other vertex attributes: tangents, colours, texture coordinates that morph.
    pub streams: Vec<StreamData>,
    /// For each vertex the first one at its position, or empty: see [`Mesh::welds`](super::Mesh::welds).
    pub welds: Vec<u32>,
    /// The targets, in the order of the source.
    pub targets: Vec<KeptTarget>,
    /// [`PackedLayout::diagonal`](crate::PackedLayout::diagonal).
    pub diagonal: f32,
    /// The tolerance that was applied.
    pub tolerance: Tolerance,
    /// Warnings of the importer.
    pub notes: Vec<String>,
}

#[allow(clippy::wildcard_enum_match_arm, reason = "any other stream is kept like any other")]
impl KeptMesh {
    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// The numbers of a stream, vertex after vertex; none where the mesh does not have it.
    pub(crate) fn values(&self, semantic: Semantic) -> &[f32] {
        match semantic {
            Semantic::Position => bytemuck::cast_slice(&self.positions),
            Semantic::Normal => bytemuck::cast_slice(&self.normals),
            _ => self.further(semantic).map_or(&[], |at| &self.streams[at].values),
        }
    }

    /// The deltas of a target in a stream: its vertices, and the components of each.
    pub(crate) fn deltas<'a>(&self, target: &'a KeptTarget, semantic: Semantic) -> (&'a [u32], &'a [f32]) {
        match semantic {
            Semantic::Position => (&target.vertices, bytemuck::cast_slice(&target.positions)),
            Semantic::Normal => (&target.vertices, bytemuck::cast_slice(&target.normals)),
            _ => {
                let stream = self.further(semantic).and_then(|at| target.streams.get(at));
                stream.map_or((&[], &[]), |stream| (&stream.vertices, &stream.deltas))
            }
        }
    }

    /// Add a stream.
    pub(crate) fn push(&mut self, semantic: Semantic, values: Vec<f32>) {
        match semantic {
            Semantic::Position => self.positions = vectors(&values),
            Semantic::Normal => self.normals = vectors(&values),
            _ => self.streams.push(StreamData { semantic, values }),
        }
    }

    /// The place of a stream among those beside positions and normals.
    fn further(&self, semantic: Semantic) -> Option<usize> {
        self.streams.iter().position(|stream| stream.semantic == semantic)
    }

    /// Returns the index of the target called `name`, in any Unicode form.
    pub fn target_index(&self, name: &str) -> Option<usize> {
        index_of(self.targets.iter().map(|target| target.name.as_str()), name)
    }

    /// [`PackedMesh::recentre`](crate::PackedMesh::recentre), before the mesh is packed.
    pub fn recentre(&mut self) {
        let middle = far_middle(self.positions.iter().copied());
        self.positions.iter_mut().for_each(|p| *p -= middle);
        self.origin += middle;
    }
}
