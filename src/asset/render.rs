//! Vertices as they are drawn: an index buffer has one index per corner, so a position is doubled where the texture
//! coordinates of its corners differ (a seam).
//!
//! A host that draws poses straight from an index buffer takes a source that is [`split`](MorphSource::split). One that
//! pulls vertices in its shader keeps the source, updates fewer vertices, and looks up the pose vertex of each of the
//! [`RenderVertices`]. Either way normals, tangents and deltas belong to a position: no crack opens at a seam.

use super::{Faces, MorphSource, StreamData, StreamDeltas};
use crate::error::Result;
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// Vertices with one texture coordinate each, and one index buffer over them.
///
/// Both `pose_vertices` and, for a mesh that is split, `indices` name vertices of the mesh:
/// [`remap_indices`](crate::pack::PackedLayout::remap_indices) turns either into those of pose buffers.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct RenderVertices {
    /// The vertex of the mesh that a render vertex takes its position and normal from. Begins with every vertex of the
    /// mesh, in order; the rest are doubled ones.
    pub pose_vertices: Vec<u32>,
    /// The texture coordinates of each; zero where no face states any.
    pub texcoords: Vec<Vec2>,
    /// Triangles: three render vertices each. Polygons are cut into fans.
    pub indices: Vec<u32>,
}

impl Faces {
    /// The vertices that draw these faces of `vertices` vertices, and their index buffer.
    ///
    /// # Errors
    /// A face of fewer than three corners, or an index that is out of range.
    pub fn render_vertices(&self, vertices: usize, texcoords: &[Vec2]) -> Result<RenderVertices> {
        self.check(vertices, texcoords.len())?;
        let (render, faces) = self.split(vertices, texcoords);
        Ok(RenderVertices { indices: faces.triangles().into_flattened(), ..render })
    }

    /// Render vertices, still without indices, and these faces over them.
    fn split(&self, vertices: usize, texcoords: &[Vec2]) -> (RenderVertices, Self) {
        let mut pose_vertices: Vec<u32> = (0..vertices as u32).collect();
        let mut stated: Vec<Option<Vec2>> = vec![None; vertices];
        let mut doubled = HashMap::new();
        let mut faces = self.clone();
        for corner in &mut faces.corners {
            // A corner without texture coordinates is drawn with those of any other.
            let Some(texcoord) = corner.texcoord.map(|t| texcoords[t as usize]) else { continue };
            let v = corner.position;
            if *stated[v as usize].get_or_insert(texcoord) != texcoord {
                // By value, since a file may state a value twice; 0 and -0 are one.
                let key = (v, (texcoord + 0.0).to_array().map(f32::to_bits));
                corner.position = *doubled.entry(key).or_insert_with(|| {
                    pose_vertices.push(v);
                    stated.push(Some(texcoord));
                    pose_vertices.len() as u32 - 1
                });
            }
        }
        let texcoords = stated.into_iter().map(Option::unwrap_or_default).collect();
        (RenderVertices { pose_vertices, texcoords, indices: vec![] }, faces)
    }
}

impl MorphSource {
    /// The source with render vertices for vertices: a vertex is doubled where its corners have different texture
    /// coordinates, and every corner of a face names the vertex to draw.
    ///
    /// The vertices of this source come first, in their order: the first vertices of a pose are those of the file. Doubled
    /// ones follow, welded to them ([`Self::welds`]), with the same normals, streams and deltas. A hard edge doubles
    /// nothing: a position has one normal, one tangent and one delta per target.
    ///
    /// Block formats keep welded vertices in one block, which keeps them equal bit for bit in every pose. Only where no
    /// choice of whole positions fills a block (nothing but positions of three vertices, or of six, in blocks of 32), the
    /// vertices of one position lie in two blocks, and may differ by what blocks may lose.
    ///
    /// # Errors
    /// As [`to_mesh`](Self::to_mesh).
    pub fn split(&self) -> Result<Self> {
        self.check(super::Tolerance::ZERO)?;
        let count = self.positions.len();
        let (RenderVertices { pose_vertices: of, .. }, faces) = self.faces.split(count, &self.texcoords);
        let vectors = |from: &Vec<Vec3>| of.iter().map(|&v| from[v as usize]).collect();
        let mut split = Self {
            positions: vectors(&self.positions),
            normals: self.normals.as_ref().map(vectors),
            faces,
            welds: of.iter().map(|&v| self.welds.get(v as usize).copied().unwrap_or(v)).collect(),
            ..self.clone()
        };
        for (StreamData { semantic, values }, from) in split.streams.iter_mut().zip(&self.streams) {
            let n = semantic.components();
            *values = of.iter().flat_map(|&v| &from.values[v as usize * n..][..n]).copied().collect();
        }
        let doubled: Vec<(u32, u32)> = (count as u32..).zip(of[count..].iter().copied()).collect();
        for target in &mut split.targets {
            copy_deltas(&mut target.positions, &doubled);
            target.normals.iter_mut().for_each(|normals| copy_deltas(normals, &doubled));
            for (StreamDeltas { vertices, deltas }, stream) in target.streams.iter_mut().zip(&self.streams) {
                let n = stream.semantic.morphing_components();
                for (copy, of) in &doubled {
                    if let Ok(at) = vertices[..].binary_search(of) {
                        vertices.push(*copy);
                        deltas.extend_from_within(at * n..(at + 1) * n);
                    }
                }
            }
        }
        Ok(split)
    }

    /// Weld vertices that are at one place in the base pose and in all targets: for meshes that come with doubled
    /// vertices, as engines and glTF hold them. Only [`Self::welds`] changes.
    ///
    /// # Errors
    /// As [`to_mesh`](Self::to_mesh).
    pub fn weld(&mut self) -> Result<()> {
        self.check(super::Tolerance::ZERO)?;
        let mut first = HashMap::new();
        let places = self.places().into_iter().enumerate();
        self.welds = places.map(|(v, place)| *first.entry(place).or_insert(v as u32)).collect();
        Ok(())
    }

    /// A number for each vertex: the same for those that are at one place in the base pose and in all targets.
    pub(super) fn places(&self) -> Vec<usize> {
        // 0 and -0 are one place.
        let bits = |p: Vec3| (p + 0.0).to_array().map(f32::to_bits);
        let mut count = 0;
        let mut number = || {
            count += 1;
            count
        };
        let mut at = HashMap::new();
        let mut places: Vec<usize> =
            self.positions.iter().map(|p| *at.entry(bits(*p)).or_insert_with(&mut number)).collect();
        // Those that a target moves part from those that it leaves, and from those that it moves elsewhere.
        for target in &self.targets {
            let mut moved = HashMap::new();
            for (v, delta) in target.positions.iter().filter(|(_, delta)| *delta != Vec3::ZERO) {
                let place = &mut places[*v as usize];
                *place = *moved.entry((*place, bits(*delta))).or_insert_with(&mut number);
            }
        }
        places
    }
}

/// Vertices that double another one, and which.
pub(super) fn copies(welds: &[u32]) -> impl Iterator<Item = (u32, u32)> {
    welds.iter().enumerate().map(|(v, &of)| (v as u32, of)).filter(|(v, of)| v != of)
}

/// Whether each of `vertices` vertices is welded to the first of its place, or none at all.
pub(crate) fn check_welds(welds: &[u32], vertices: usize) -> Result<(), String> {
    if !welds.is_empty() && welds.len() != vertices {
        return Err(format!("{} welds for {vertices} vertices", welds.len()));
    }
    match copies(welds).find(|&(v, of)| of > v || welds[of as usize] != of) {
        Some((v, of)) => Err(format!("vertex {v} is welded to vertex {of}, which is not the first of its place")),
        None => Ok(()),
    }
}

/// Give each of `copies` the delta of the vertex that it doubles. `deltas` are ascending, and have none for copies.
pub(super) fn copy_deltas<T: Copy>(deltas: &mut Vec<(u32, T)>, copies: &[(u32, u32)]) {
    let stated = deltas.len();
    for &(copy, of) in copies {
        if let Ok(at) = deltas[..stated].binary_search_by_key(&of, |(v, _)| *v) {
            deltas.push((copy, deltas[at].1));
        }
    }
    deltas.sort_unstable_by_key(|(v, _)| *v);
}

#[cfg(test)]
#[path = "render_tests.rs"]
mod tests;
