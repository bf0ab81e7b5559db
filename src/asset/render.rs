//! Vertices as they are drawn: an index buffer has one index per corner, so a position is doubled if the texture
//! coordinates of its corners differ (a seam).
//!
//! A host that draws poses straight from an index buffer takes a source that is [`split`](Mesh::split). A host
//! whose shader pulls vertices keeps the source, updates fewer vertices, and looks up the pose vertex of each of the
//! [`RenderVertices`]. Either way normals, tangents and deltas belong to a position: no crack opens at a seam.

use super::{Faces, Mesh, StreamData, StreamDeltas};
use crate::error::{Result, ensure};
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// Vertices with one texture coordinate each, and one index buffer over them.
///
/// Both `pose_vertices` and, for a mesh that is split, `indices` name vertices of the mesh:
/// [`remap_indices`](crate::pack::PackedLayout::remap_indices) turns either into vertices of pose buffers.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct RenderVertices {
    /// The vertex of the mesh that each render vertex takes its position and normal from. It begins with every vertex
    /// of the mesh, in order; doubled ones follow.
    pub pose_vertices: Vec<u32>,
    /// The texture coordinates of each render vertex; zero if no face states any.
    pub texcoords: Vec<Vec2>,
    /// Triangles: three render vertices each. Polygons are cut as [`Faces::triangles`] does.
    pub indices: Vec<u32>,
}

impl Faces {
    /// Returns the vertices that draw these faces over the base pose `positions`, and their index buffer.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) for a face of fewer than three corners, or an index that is out of
    /// range.
    #[doc(hidden)]
    pub fn render_vertices(&self, positions: &[Vec3], texcoords: &[Vec2]) -> Result<RenderVertices> {
        self.check(positions.len(), texcoords.len())?;
        let (render, faces) = self.split(positions.len(), texcoords);
        let positions: Vec<Vec3> = render.pose_vertices.iter().map(|&v| positions[v as usize]).collect();
        Ok(RenderVertices { indices: faces.triangles(&positions).into_flattened(), ..render })
    }

    /// Returns render vertices, still without indices, and these faces over them.
    fn split(&self, vertices: usize, texcoords: &[Vec2]) -> (RenderVertices, Self) {
        let mut pose_vertices: Vec<u32> = (0..vertices as u32).collect();
        let mut stated: Vec<Option<Vec2>> = vec![None; vertices];
        let mut doubled = HashMap::new();
        let mut faces = self.clone();
        for corner in &mut faces.corners {
            // A corner without texture coordinates may take those of any other corner.
            let Some(texcoord) = corner.texcoord.map(|t| texcoords[t as usize]) else { continue };
            let v = corner.position;
            if *stated[v as usize].get_or_insert(texcoord) != texcoord {
                // Compared by value, since a file may state a value twice; 0 and -0 are equal.
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

impl Mesh {
    /// Returns the source with render vertices as vertices: a vertex is doubled if its corners have different texture
    /// coordinates, and every corner of a face names the vertex to draw.
    ///
    /// The vertices of this source come first, in their order: a pose begins with the vertices of the file. Doubled
    /// ones follow, welded to them ([`Self::welds`]), with the same normals, streams and deltas. A hard edge doubles
    /// nothing: a position has one normal, one tangent and one delta per target.
    ///
    /// Block formats keep welded vertices in one block, so they stay equal bit for bit in every pose. Only if no choice
    /// of whole positions fills a block (all positions have three vertices, or six, and blocks 32) do the vertices of
    /// one position lie in two blocks; they may then differ by the error of the block format.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) if the source is not valid; [`pack`](Self::pack) lists the
    /// cases.
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
        let mut doubled: Vec<(u32, u32)> = (count as u32..).zip(of[count..].iter().copied()).collect();
        doubled.sort_by_key(|(_, of)| *of);
        for target in &mut split.targets {
            copy_deltas(&mut target.positions, &doubled);
            target.normals.iter_mut().for_each(|normals| copy_deltas(normals, &doubled));
            for (StreamDeltas { vertices, deltas }, stream) in target.streams.iter_mut().zip(&self.streams) {
                let n = stream.semantic.morphing_components();
                for (copy, at) in copies_of(vertices.iter().copied(), &doubled) {
                    vertices.push(copy);
                    deltas.extend_from_within(at * n..(at + 1) * n);
                }
            }
        }
        Ok(split)
    }

    /// Welds vertices with the same position in the base pose and in all targets, for meshes that come with doubled
    /// vertices, as engines and glTF hold them. Only [`Self::welds`] changes.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) if the source is not valid; [`pack`](Self::pack) lists the
    /// cases.
    pub fn weld(&mut self) -> Result<()> {
        self.check(super::Tolerance::ZERO)?;
        let mut first = HashMap::new();
        let places = self.places().into_iter().enumerate();
        self.welds = places.map(|(v, place)| *first.entry(place).or_insert(v as u32)).collect();
        Ok(())
    }

    /// Numbers the vertices so that those with the same position in the base pose and in all targets get the same
    /// number.
    pub(super) fn places(&self) -> Vec<usize> {
        // 0 and -0 are the same position.
        let bits = |p: Vec3| (p + 0.0).to_array().map(f32::to_bits);
        let mut count = 0;
        let mut number = || {
            count += 1;
            count
        };
        let mut at = HashMap::new();
        let mut places: Vec<usize> =
            self.positions.iter().map(|p| *at.entry(bits(*p)).or_insert_with(&mut number)).collect();
        let mut doubled = vec![0; self.positions.len() + 1];
        places.iter().for_each(|place| doubled[*place] += 1);
        let doubled: Vec<bool> = places.iter().map(|place| doubled[*place] > 1).collect();
        // Vertices that a target moves get another number than those that it leaves, or moves differently. One that is
        // alone stays so.
        for target in &self.targets {
            let mut moved = HashMap::new();
            let together = |(v, delta): &&(u32, Vec3)| doubled[*v as usize] && *delta != Vec3::ZERO;
            for (v, delta) in target.positions.iter().filter(together) {
                let place = &mut places[*v as usize];
                *place = *moved.entry((*place, bits(*delta))).or_insert_with(&mut number);
            }
        }
        places
    }
}

/// Iterates over the vertices that double another one, with that one.
pub(super) fn copies(welds: &[u32]) -> impl Iterator<Item = (u32, u32)> {
    welds.iter().enumerate().map(|(v, &of)| (v as u32, of)).filter(|(v, of)| v != of)
}

/// Checks that each of `vertices` vertices is welded to the first at its position, or that `welds` is empty.
pub(crate) fn check_welds(welds: &[u32], vertices: usize) -> Result<(), String> {
    ensure!(welds.is_empty() || welds.len() == vertices, format!("{} welds for {vertices} vertices", welds.len()));
    for (v, of) in copies(welds) {
        let is_first = of < v && welds[of as usize] == of;
        ensure!(is_first, format!("vertex {v} is welded to vertex {of}, which is not the first at its position"));
    }
    Ok(())
}

/// Returns the copies of `vertices`, ascending, each with the index of its vertex in `vertices`. These ascend, and
/// `copies` by their vertex. The time depends on the number of `vertices`, not on that of all `copies`.
fn copies_of(vertices: impl Iterator<Item = u32>, copies: &[(u32, u32)]) -> Vec<(u32, usize)> {
    let mut found = vec![];
    for (at, v) in vertices.enumerate() {
        let first = copies.partition_point(|(_, of)| *of < v);
        let of_this = copies[first..].iter().take_while(|(_, of)| *of == v);
        found.extend(of_this.map(|(copy, _)| (*copy, at)));
    }
    found.sort_unstable();
    found
}

/// Adds the deltas of copies: those of their vertices. `copies` ascend by their vertex; `deltas` have none for copies.
pub(super) fn copy_deltas<T: Copy>(deltas: &mut Vec<(u32, T)>, copies: &[(u32, u32)]) {
    for (copy, at) in copies_of(deltas.iter().map(|(v, _)| *v), copies) {
        deltas.push((copy, deltas[at].1));
    }
    deltas.sort_unstable_by_key(|(v, _)| *v);
}

#[cfg(test)]
#[path = "render_tests.rs"]
mod tests;
