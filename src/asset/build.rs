//! From what a file says to what is kept of it: [`MorphSource::to_mesh`].

use super::normals::{Deformer, Surface};
use super::render::{copies, copy_deltas};
use super::streams::Measure;
use super::{MorphMesh, MorphSource, MorphTarget, Semantic, SourceTarget, StreamData, StreamDeltas, Tolerance};
use crate::error::{Error, Result};
use crate::math::{diagonal, map_all};
use glam::Vec3;
use std::borrow::Cow;

impl MorphSource {
    /// Check the source, drop deltas within `tolerance`, and compute what normals are missing.
    ///
    /// A vertex stays in a target when its position delta is longer than `tolerance.position × diagonal` or its normal
    /// delta longer than `tolerance.normal`. A position delta within the tolerance becomes exactly zero even where the
    /// vertex stays for its normal. Normals that are missing are computed of the welded surface and of kept position
    /// deltas, so that they are smooth across doubled vertices and dropped noise does not come back. A vertex whose deformed
    /// surface has no normal (faces folded to nothing) keeps the base normal.
    ///
    /// # Errors
    /// No vertex or more than 2³², an index out of range, deltas that are not ascending by vertex, a value that
    /// is not finite, a face of fewer than three corners, a base normal or tangent that is not of unit length (within
    /// 1%), a tangent whose w is not 1 or -1, a stream that comes twice or with a wrong number of values, welded vertices
    /// that are not at one place, two targets of one name, or a tolerance that is negative or not a number.
    pub fn to_mesh(&self, tolerance: Tolerance) -> Result<MorphMesh> {
        self.check(tolerance)?;
        // Faces of the welded surface: copies have none, and take over the normals of the vertex that they double.
        let copies: Vec<(u32, u32)> = copies(&self.welds).collect();
        let mut faces = Cow::Borrowed(&self.faces);
        if !copies.is_empty() {
            faces.to_mut().corners.iter_mut().for_each(|c| c.position = self.welds[c.position as usize]);
        }
        // Computed even beside stated normals where a target has none: its delta is between two computed ones.
        let incomplete = self.normals.is_none() || self.targets.iter().any(|t| t.normals.is_none());
        let surface = incomplete.then(|| Surface::new(&faces, &self.positions));
        let diagonal = diagonal(&self.positions);
        if !diagonal.is_finite() {
            let what = format!("{}: the bounding box is larger than a single-precision number", self.name);
            return Err(Error::invalid(what, "scale the mesh down"));
        }
        let shortest = f64::from(tolerance.position) * f64::from(diagonal);

        let still = StreamDeltas::default();
        let keep = |deformer: &mut Option<Deformer<'_>>, target: &SourceTarget| {
            let positions: Vec<(u32, Vec3)> =
                target.positions.iter().copied().filter(|(_, d)| d.as_dvec3().length() > shortest).collect();
            let normals = target.normals.clone().unwrap_or_else(|| {
                let mut computed = deformer.as_mut().map(|d| d.normal_deltas(&positions)).unwrap_or_default();
                copy_deltas(&mut computed, &copies);
                computed
            });
            let stated = target.streams.iter().chain(std::iter::repeat(&still));
            let kept = |(data, deltas): (&StreamData, _)| keep_stream(data.semantic, deltas, tolerance);
            let streams = self.streams.iter().zip(stated).map(kept).collect();
            MorphTarget { streams, ..merge(target.name.clone(), &positions, &normals, tolerance.normal) }
        };
        let targets = map_all(&self.targets, surface.as_ref().map(Deformer::new), keep);
        let normals = self.normals.clone().unwrap_or_else(|| {
            let mut computed = surface.map(|surface| surface.normals).unwrap_or_default();
            copies.iter().for_each(|&(copy, of)| computed[copy as usize] = computed[of as usize]);
            computed
        });
        Ok(MorphMesh {
            name: self.name.clone(),
            positions: self.positions.clone(),
            normals,
            texcoords: self.texcoords.clone(),
            faces: self.faces.clone(),
            streams: self.streams.clone(),
            welds: self.welds.clone(),
            targets,
            diagonal,
            tolerance,
            notes: self.notes.clone(),
        })
    }
}

/// Join position deltas (all of them kept) with those normal deltas that are kept: every one at a vertex that
/// stays for its position, and elsewhere those longer than `shortest`.
fn merge(name: String, positions: &[(u32, Vec3)], normals: &[(u32, Vec3)], shortest: f32) -> MorphTarget {
    let mut target = MorphTarget { name, ..Default::default() };
    let (mut p, mut n) = (positions.iter().peekable(), normals.iter().peekable());
    while let Some(v) = p.peek().into_iter().chain(n.peek()).map(|e| e.0).min() {
        let position = p.next_if(|e| e.0 == v).map(|e| e.1);
        let normal = n.next_if(|e| e.0 == v).map_or(Vec3::ZERO, |e| e.1);
        if position.is_some() || normal.as_dvec3().length() > f64::from(shortest) {
            target.vertices.push(v);
            target.positions.push(position.unwrap_or_default());
            target.normals.push(normal);
        }
    }
    target
}

/// The deltas of a further stream that are above the tolerance.
fn keep_stream(semantic: Semantic, stated: &StreamDeltas, tolerance: Tolerance) -> StreamDeltas {
    let shortest = if semantic.measure() == Measure::Angle { tolerance.normal } else { tolerance.position };
    let mut kept = StreamDeltas::default();
    for (&v, delta) in stated.vertices.iter().zip(stated.deltas.chunks_exact(semantic.morphing_components())) {
        if delta.iter().map(|d| f64::from(*d).powi(2)).sum::<f64>().sqrt() > f64::from(shortest) {
            kept.vertices.push(v);
            kept.deltas.extend_from_slice(delta);
        }
    }
    kept
}
