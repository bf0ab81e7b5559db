//! A mesh ready to pack: what is kept of a source.

use super::{Faces, StreamData, StreamDeltas};
use crate::setters::setters;
use glam::{Vec2, Vec3};

/// Below which size a delta is rounding noise and is dropped.
///
/// Other streams are compared with `normal` where they are directions (tangents), else with `position`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Tolerance {
    /// Length of a position delta, as a fraction of the bounding-box diagonal (≥ 0).
    pub position: f32,
    /// Length of a normal delta (≥ 0; 0.001 is about 0.06°).
    pub normal: f32,
}

setters!(Tolerance { position: f32, normal: f32 });

impl Tolerance {
    /// Keep every delta that is not exactly zero.
    pub const ZERO: Self = Self { position: 0.0, normal: 0.0 };
}

impl Default for Tolerance {
    /// 1e-6 of the diagonal for positions, 1e-3 (0.06°) for normals: both below what can be seen. With 43 targets active
    /// at once, as in captured clips, dropped position deltas add up to 4.3e-5 of the diagonal at the very most, and 99.9%
    /// of the normals are within 0.08° of those with nothing dropped.
    ///
    /// Normals computed for a mesh written with six digits (ICT FaceKit) have rounding noise: 1e-3 keeps 30.6% of the
    /// vertices in the mean over the targets, 1e-4 31.7%, 1e-2 30.3%, and positions alone 30.2%.
    fn default() -> Self {
        Self { position: 1e-6, normal: 1e-3 }
    }
}

/// One morph target: the vertices it moves and their deltas.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MorphTarget {
    /// Name, unique within the mesh.
    pub name: String,
    /// Vertices with a delta, ascending, without repeats.
    pub vertices: Vec<u32>,
    /// Position delta (target − base) of each of `vertices`.
    pub positions: Vec<Vec3>,
    /// Normal delta of each of `vertices`.
    pub normals: Vec<Vec3>,
    /// Deltas of each of the mesh's [`streams`](MorphMesh::streams).
    pub streams: Vec<StreamDeltas>,
}

/// Base pose and morph targets, ready to pack: normals present, noise dropped, everything finite.
#[derive(Clone, Debug, Default)]
pub struct MorphMesh {
    /// Name for messages and reports.
    pub name: String,
    /// Base positions, in the user's vertex order.
    pub positions: Vec<Vec3>,
    /// Base normals, unit length.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, indexed by [`Corner::texcoord`](super::Corner::texcoord).
    pub texcoords: Vec<Vec2>,
    /// The face list.
    pub faces: Faces,
    /// Other vertex attributes: tangents, colours, texture coordinates that morph.
    pub streams: Vec<StreamData>,
    /// For each vertex the first one at its position, or empty: see [`MorphSource::welds`](super::MorphSource::welds).
    pub welds: Vec<u32>,
    /// The targets, in the order of the source.
    pub targets: Vec<MorphTarget>,
    /// Length of the bounding-box diagonal of the base pose, in input units.
    pub diagonal: f32,
    /// The tolerance that was applied.
    pub tolerance: Tolerance,
    /// Remarks of the importer that a person should see.
    pub notes: Vec<String>,
}

impl MorphMesh {
    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Index of the target called `name`.
    pub fn target_index(&self, name: &str) -> Option<usize> {
        self.targets.iter().position(|t| t.name == name)
    }
}
