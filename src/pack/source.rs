//! The components of a group, read from a mesh.

use super::POSE_FLOATS;
use super::formats::Lane;
use crate::asset::streams::{StreamPlace, TRIPLE, TRIPLES, group_streams};
use crate::asset::{KeptMesh, KeptTarget};

/// A group of streams of a mesh.
pub(crate) struct Source<'a> {
    pub mesh: &'a KeptMesh,
    pub streams: Vec<StreamPlace>,
}

impl<'a> Source<'a> {
    /// Groups the streams of `mesh`.
    pub fn groups(mesh: &'a KeptMesh) -> Vec<Self> {
        let semantics = mesh.streams.iter().map(|stream| stream.semantic);
        group_streams(semantics).iter().map(|streams| Self::new(mesh, streams)).collect()
    }

    /// The group of these streams; streams that the mesh lacks are zero.
    pub fn new(mesh: &'a KeptMesh, streams: &[StreamPlace]) -> Self {
        Self { mesh, streams: streams.to_vec() }
    }

    /// The base pose of a vertex.
    pub fn base(&self, vertex: usize) -> [f32; POSE_FLOATS] {
        let mut out = [0.0; POSE_FLOATS];
        for place in &self.streams {
            let values = self.mesh.values(place.semantic);
            let to = &mut out[place.components()];
            if !values.is_empty() {
                to.copy_from_slice(&values[vertex * to.len()..][..to.len()]);
            }
        }
        out
    }

    /// The base pose in pose-buffer layout: `padded` vertices in `order` (packed → user), if given.
    pub fn base_pose(&self, padded: usize, order: Option<&[u32]>) -> Vec<f32> {
        let packed = (0..self.mesh.vertex_count()).map(|packed| order.map_or(packed, |order| order[packed] as usize));
        let mut base: Vec<f32> = packed.flat_map(|vertex| self.base(vertex)).collect();
        base.resize(padded * POSE_FLOATS, 0.0);
        base
    }

    /// The deltas of a target, ascending by vertex.
    pub fn deltas(&self, target: &KeptTarget) -> Vec<Lane> {
        let mut out: Vec<Lane> = vec![];
        let mut lane_of = vec![None; self.mesh.vertex_count()];
        for place in &self.streams {
            let numbers = place.morphing_components();
            let (vertices, deltas) = self.mesh.deltas(target, place.semantic);
            for (&vertex, delta) in vertices.iter().zip(deltas.chunks_exact(numbers.len())) {
                let at = *lane_of[vertex as usize].get_or_insert_with(|| {
                    out.push((vertex, [0.0; POSE_FLOATS]));
                    out.len() - 1
                });
                out[at].1[numbers.clone()].copy_from_slice(delta);
            }
        }
        sort(&mut out);
        out
    }
}

// Not inlined at call sites: each instantiation of the sort takes 4 kB of code.
pub(crate) fn sort(lanes: &mut [Lane]) {
    lanes.sort_unstable_by_key(|(vertex, _)| *vertex);
}

/// The largest absolute number of each triple.
pub(crate) fn largest(deltas: &[Lane]) -> [f32; TRIPLES] {
    let mut largest = [0.0f32; TRIPLES];
    for (_, delta) in deltas {
        for (c, number) in delta.iter().enumerate() {
            largest[c / TRIPLE] = largest[c / TRIPLE].max(number.abs());
        }
    }
    largest
}
