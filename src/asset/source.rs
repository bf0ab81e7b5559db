//! A mesh as its files state it.

use super::{Faces, StreamData, StreamDeltas};
use glam::{Vec2, Vec3};

/// A morph target as a file states it.
#[derive(Clone, Debug, Default)]
pub struct SourceTarget {
    /// Name, unique within the source.
    pub name: String,
    /// `(vertex, target − base)` for every vertex whose position differs at all, ascending by vertex.
    pub positions: Vec<(u32, Vec3)>,
    /// `target normal − base normal` per vertex where the file has normals (as stated there, not
    /// re-normalised): `(vertex, difference)`, ascending. `None`: computed from the deformed surface.
    pub normals: Option<Vec<(u32, Vec3)>>,
    /// Deltas of the source's [`streams`](MorphSource::streams), in their order; streams beyond the last do not change.
    pub streams: Vec<StreamDeltas>,
}

/// A base pose and its targets exactly as the input states them: no tolerance applied, no normal computed.
#[derive(Clone, Debug, Default)]
pub struct MorphSource {
    /// Name for messages and reports (a folder's or file's stem).
    pub name: String,
    /// Base positions, in the user's vertex order.
    pub positions: Vec<Vec3>,
    /// Base normals per position, unit length; `None` when the input has none.
    pub normals: Option<Vec<Vec3>>,
    /// Texture coordinates, indexed by [`Corner::texcoord`](super::Corner::texcoord).
    pub texcoords: Vec<Vec2>,
    /// The face list.
    pub faces: Faces,
    /// Other vertex attributes: tangents, colours, texture coordinates that morph.
    pub streams: Vec<StreamData>,
    /// For each vertex the first one at its position, which may be itself; empty where no vertices are doubled. Welded
    /// vertices share the computed normal, and what they share stays equal bit for bit in every pose. See
    /// [`split`](Self::split) and [`weld`](Self::weld).
    pub welds: Vec<u32>,
    /// The targets; an empty target keeps its index.
    pub targets: Vec<SourceTarget>,
    /// Remarks of the importer that a person should see (e.g. hard edges averaged).
    pub notes: Vec<String>,
}
