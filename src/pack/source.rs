//! The numbers of a group, as a mesh has them.

use super::POSE_FLOATS;
use super::formats::Lane;
use crate::asset::streams::{Semantic, StreamPlace, TRIPLE, TRIPLES, group_streams};
use crate::asset::{MorphMesh, MorphTarget, check_welds};
use crate::error::{Error, Result};

/// A group of the streams of a mesh.
pub(crate) struct Source<'a> {
    pub mesh: &'a MorphMesh,
    pub streams: Vec<StreamPlace>,
    /// For each of `streams` its index in the mesh's; positions and normals are in fields of their own.
    at: Vec<usize>,
}

impl<'a> Source<'a> {
    /// The groups of a mesh.
    ///
    /// # Errors
    /// Streams that do not fit the vertices.
    pub fn groups(mesh: &'a MorphMesh) -> Result<Vec<Self>> {
        check(mesh).map_err(|what| {
            Error::invalid(format!("mesh '{}': {what}", mesh.name), "make the mesh with MorphSource::to_mesh")
        })?;
        let semantics = mesh.streams.iter().map(|stream| stream.semantic);
        Ok(group_streams(semantics).iter().map(|streams| Self::new(mesh, streams)).collect())
    }

    /// The group of these streams; those that the mesh does not have are zero.
    pub fn new(mesh: &'a MorphMesh, streams: &[StreamPlace]) -> Self {
        let at = |place: &StreamPlace| mesh.streams.iter().position(|s| s.semantic == place.semantic);
        let at = streams.iter().map(|place| at(place).unwrap_or(usize::MAX)).collect();
        Self { mesh, streams: streams.to_vec(), at }
    }

    /// The base pose of a vertex.
    pub fn base(&self, vertex: usize) -> [f32; POSE_FLOATS] {
        let mut out = [0.0; POSE_FLOATS];
        for (place, &at) in self.streams.iter().zip(&self.at) {
            let to = &mut out[place.components()];
            match place.semantic {
                Semantic::Position => to.copy_from_slice(&self.mesh.positions[vertex].to_array()),
                Semantic::Normal => to.copy_from_slice(&self.mesh.normals[vertex].to_array()),
                Semantic::Tangent | Semantic::TexCoord(_) | Semantic::Color(_) => {
                    if let Some(stream) = self.mesh.streams.get(at) {
                        to.copy_from_slice(&stream.values[vertex * to.len()..][..to.len()]);
                    }
                }
            }
        }
        out
    }

    /// The deltas of a target, ascending by vertex.
    pub fn deltas(&self, target: &MorphTarget) -> Vec<Lane> {
        let mut out: Vec<Lane> = vec![];
        let mut surface = false;
        for (place, &at) in self.streams.iter().zip(&self.at) {
            let numbers = place.morphing_components();
            match place.semantic {
                // Both are of the same vertices.
                Semantic::Position | Semantic::Normal => {
                    let deltas = if place.semantic == Semantic::Position { &target.positions } else { &target.normals };
                    if !surface {
                        out.extend(target.vertices.iter().map(|&v| (v, [0.0; POSE_FLOATS])));
                    }
                    surface = true;
                    for ((_, lane), delta) in out.iter_mut().zip(deltas) {
                        lane[numbers.clone()].copy_from_slice(&delta.to_array());
                    }
                }
                Semantic::Tangent | Semantic::TexCoord(_) | Semantic::Color(_) => {
                    if let Some(stream) = target.streams.get(at) {
                        let deltas = stream.deltas.chunks_exact(numbers.len());
                        out.extend(stream.vertices.iter().zip(deltas).map(|(&vertex, delta)| {
                            let mut lane = [0.0; POSE_FLOATS];
                            lane[numbers.clone()].copy_from_slice(delta);
                            (vertex, lane)
                        }));
                    }
                }
            }
        }
        // Streams of the same vertex come together; each has numbers of its own.
        out.sort_by_key(|(vertex, _)| *vertex);
        out.dedup_by(|later, kept| {
            let same = later.0 == kept.0;
            if same {
                kept.1.iter_mut().zip(later.1).filter(|(_, d)| *d != 0.0).for_each(|(k, d)| *k = d);
            }
            same
        });
        out
    }
}

/// The largest number of each triple.
pub(crate) fn largest(deltas: &[Lane]) -> [f32; TRIPLES] {
    let mut largest = [0.0f32; TRIPLES];
    for (_, delta) in deltas {
        for (c, number) in delta.iter().enumerate() {
            largest[c / TRIPLE] = largest[c / TRIPLE].max(number.abs());
        }
    }
    largest
}

/// Whether streams have as many numbers as they should, and welds are of this mesh, so that nothing is out of range.
fn check(mesh: &MorphMesh) -> Result<(), String> {
    let vertices = mesh.vertex_count();
    check_welds(&mesh.welds, vertices)?;
    for (i, stream) in mesh.streams.iter().enumerate() {
        let semantic = stream.semantic;
        let own = matches!(semantic, Semantic::Position | Semantic::Normal);
        if own || mesh.streams[..i].iter().any(|s| s.semantic == semantic) {
            return Err(format!("two streams '{semantic}'"));
        }
        let (has, expected) = (stream.values.len(), vertices * semantic.components());
        if has != expected {
            return Err(format!("stream '{semantic}' has {has} numbers; {vertices} vertices take {expected}"));
        }
        for target in &mesh.targets {
            let Some(deltas) = target.streams.get(i) else { continue };
            let fits = deltas.deltas.len() == deltas.vertices.len() * semantic.morphing_components();
            if !fits || deltas.vertices.iter().any(|&v| v as usize >= vertices) {
                return Err(format!("the deltas of stream '{semantic}' in target '{}' do not fit", target.name));
            }
        }
    }
    Ok(())
}
