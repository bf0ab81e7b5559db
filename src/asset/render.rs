//! Vertices as they are drawn: an index buffer has one index per corner, so a position is doubled where the texture
//! coordinates of its corners differ (a seam).
//!
//! A host that draws poses straight from an index buffer takes a source that is [`split`](MorphSource::split). One that
//! pulls vertices in its shader updates fewer of them: it keeps the source welded, and looks up the pose vertex of each of
//! the [`RenderVertices`]. Either way normals, tangents and deltas belong to a place, so that no crack opens at a seam.

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

/// Render vertices, and which of them each corner of the faces is.
struct Corners {
    pose_vertices: Vec<u32>,
    texcoords: Vec<Option<Vec2>>,
    corners: Vec<u32>,
}

impl Corners {
    fn new(faces: &Faces, vertices: usize, texcoords: &[Vec2]) -> Self {
        let mut all = Self {
            pose_vertices: (0..vertices as u32).collect(),
            texcoords: vec![None; vertices],
            corners: Vec::with_capacity(faces.corners.len()),
        };
        let mut doubled = HashMap::new();
        for corner in &faces.corners {
            let v = corner.position;
            let vertex = match (corner.texcoord.map(|t| texcoords[t as usize]), all.texcoords[v as usize]) {
                // Whatever is there fits a corner that states nothing.
                (None, _) => v,
                (Some(texcoord), None) => {
                    all.texcoords[v as usize] = Some(texcoord);
                    v
                }
                (Some(texcoord), Some(first)) if texcoord == first => v,
                (Some(texcoord), Some(_)) => {
                    // By value, since a file may state a value twice; 0 and -0 are one.
                    let key = (v, (texcoord + 0.0).to_array().map(f32::to_bits));
                    *doubled.entry(key).or_insert_with(|| {
                        all.pose_vertices.push(v);
                        all.texcoords.push(Some(texcoord));
                        all.pose_vertices.len() as u32 - 1
                    })
                }
            };
            all.corners.push(vertex);
        }
        all
    }
}

impl Faces {
    /// The vertices that draw these faces of `vertices` vertices, and their index buffer.
    ///
    /// # Errors
    /// A face of fewer than three corners, or an index that is out of range.
    pub fn render_vertices(&self, vertices: usize, texcoords: &[Vec2]) -> Result<RenderVertices> {
        self.check(vertices, texcoords.len())?;
        let all = Corners::new(self, vertices, texcoords);
        let mut rest = all.corners.as_slice();
        let mut indices = Vec::with_capacity(3 * self.corners.len());
        for &size in &self.sizes {
            let (face, tail) = rest.split_at(size as usize);
            rest = tail;
            indices.extend(face.windows(2).skip(1).flat_map(|edge| [face[0], edge[0], edge[1]]));
        }
        let texcoords = all.texcoords.into_iter().map(Option::unwrap_or_default).collect();
        Ok(RenderVertices { pose_vertices: all.pose_vertices, texcoords, indices })
    }
}

impl MorphSource {
    /// The source with render vertices for vertices: a vertex is doubled where its corners have different texture
    /// coordinates, and every corner of a face names the vertex to draw.
    ///
    /// The vertices of this source come first, in their order; doubled ones follow, welded to them ([`Self::welds`]), with
    /// the same normals, streams and deltas. So the first vertices of a pose are those of the file, and an OBJ with the
    /// file's vertices is written from them and from the faces of this source. Computed normals are those of the welded
    /// surface.
    ///
    /// # Errors
    /// As [`to_mesh`](Self::to_mesh).
    pub fn split(&self) -> Result<Self> {
        self.check(super::Tolerance::ZERO)?;
        let count = self.positions.len();
        let Corners { pose_vertices: of, corners, .. } = Corners::new(&self.faces, count, &self.texcoords);
        let mut split = self.clone();
        for (vectors, from) in std::iter::once((&mut split.positions, &self.positions))
            .chain(split.normals.as_mut().zip(self.normals.as_ref()))
        {
            *vectors = of.iter().map(|&v| from[v as usize]).collect();
        }
        for (StreamData { semantic, values }, from) in split.streams.iter_mut().zip(&self.streams) {
            let n = semantic.components();
            *values = of.iter().flat_map(|&v| &from.values[v as usize * n..][..n]).copied().collect();
        }
        split.faces.corners.iter_mut().zip(corners).for_each(|(corner, vertex)| corner.position = vertex);
        split.welds = of.iter().map(|&v| self.welds.get(v as usize).copied().unwrap_or(v)).collect();
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
        // 0 and -0 are one place.
        let bits = |p: Vec3| (p + 0.0).to_array().map(f32::to_bits);
        let mut at: HashMap<[u32; 3], Vec<u32>> = HashMap::new();
        let mut welds: Vec<u32> = (0..self.positions.len() as u32).collect();
        for (v, &p) in self.positions.iter().enumerate() {
            let there = at.entry(bits(p)).or_default();
            match there.iter().find(|first| self.meet(v as u32, **first)) {
                Some(first) => welds[v] = *first,
                None => there.push(v as u32),
            }
        }
        self.welds = welds;
        Ok(())
    }
}

/// Vertices that double another one, and which.
pub(super) fn copies(welds: &[u32]) -> impl Iterator<Item = (u32, u32)> {
    welds.iter().enumerate().map(|(v, &of)| (v as u32, of)).filter(|(v, of)| v != of)
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
