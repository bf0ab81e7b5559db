//! From what a file says to what is kept of it: [`MorphSource::to_mesh`].

use super::normals::{Adjacency, Deformer, vertex_normals};
use super::{MorphMesh, MorphSource, MorphTarget, SourceTarget, Tolerance};
use crate::error::{Error, Result};
use crate::math::diagonal;
use glam::Vec3;
use std::collections::HashMap;

impl MorphSource {
    /// Check the source, drop deltas within `tolerance`, and compute what normals are missing.
    ///
    /// A vertex stays in a target when its position delta is longer than `tolerance.position × diagonal`
    /// or its normal delta longer than `tolerance.normal`. A position delta within the tolerance becomes
    /// exactly zero even where the vertex stays for its normal. Where the input has no normals, each target's
    /// normal deltas come from its own surface (base plus kept position deltas), so that dropped noise
    /// does not come back as noise in the normals. A vertex whose deformed surface has no normal (faces folded
    /// to nothing) keeps the base normal.
    ///
    /// # Errors
    /// No vertex or more than 2³², an index out of range, deltas that are not ascending by vertex, a value that
    /// is not finite, a face of fewer than three corners, a base normal that is not of unit length (within 1%),
    /// two targets of one name, or a tolerance that is negative or not a number.
    pub fn to_mesh(&self, tolerance: Tolerance) -> Result<MorphMesh> {
        self.check(tolerance)?;
        let adjacency = Adjacency::new(&self.faces, self.positions.len());
        // Computed even beside stated normals where a target has none: its delta is between two computed ones.
        let computed = (self.normals.is_none() || self.targets.iter().any(|t| t.normals.is_none()))
            .then(|| vertex_normals(&adjacency, &self.positions));
        let diagonal = diagonal(&self.positions);
        if !diagonal.is_finite() {
            return Err(Error::invalid(
                format!("{}: the bounding box is larger than a single-precision number", self.name),
                "scale the mesh down",
            ));
        }
        let shortest = f64::from(tolerance.position) * f64::from(diagonal);

        let keep = |deformer: &mut Deformer<'_>, target: &SourceTarget| {
            let positions: Vec<(u32, Vec3)> =
                target.positions.iter().copied().filter(|(_, d)| d.as_dvec3().length() > shortest).collect();
            let normals: Vec<(u32, Vec3)> = match (&target.normals, &computed) {
                (Some(stated), _) => stated.clone(),
                (None, Some(base)) => deformer
                    .normals(&positions)
                    .into_iter()
                    .map(|(v, n)| (v, n.map_or(Vec3::ZERO, |n| n - base[v as usize])))
                    .collect(),
                (None, None) => Vec::new(),
            };
            merge(target.name.clone(), &positions, &normals, tolerance.normal)
        };
        let deformer = Deformer::new(&adjacency, &self.positions);
        #[cfg(feature = "threads")]
        let targets = {
            use rayon::prelude::*;
            self.targets.par_iter().map_init(|| deformer.clone(), keep).collect()
        };
        #[cfg(not(feature = "threads"))]
        let targets = {
            let mut deformer = deformer;
            self.targets.iter().map(|t| keep(&mut deformer, t)).collect()
        };

        let normals = self.normals.clone().or(computed).unwrap_or_default();
        Ok(MorphMesh {
            name: self.name.clone(),
            positions: self.positions.clone(),
            normals,
            texcoords: self.texcoords.clone(),
            faces: self.faces.clone(),
            targets,
            diagonal,
            tolerance,
            notes: self.notes.clone(),
        })
    }

    fn check(&self, tolerance: Tolerance) -> Result<()> {
        let refuse = |what: String, remedy: &str| Err(Error::invalid(format!("{}: {what}", self.name), remedy));
        for (kind, value) in [("position", tolerance.position), ("normal", tolerance.normal)] {
            if !(value >= 0.0 && value.is_finite()) {
                return refuse(format!("the {kind} tolerance is {value}"), "give a tolerance of 0 or more");
            }
        }
        let count = self.positions.len();
        if count == 0 {
            return refuse("the base pose has no vertex".into(), "give a mesh with at least one vertex");
        }
        // Corners as well, since adjacency counts them in 32 bits.
        if u32::try_from(count).is_err() || u32::try_from(self.faces.corners.len()).is_err() {
            return refuse("more than 4,294,967,295 vertices or face corners".into(), "split the mesh");
        }
        let finite = "replace values that are not a number or infinite";
        if let Some(v) = self.positions.iter().position(|p| !p.is_finite()) {
            return refuse(format!("vertex {v} is {}", self.positions[v]), finite);
        }
        if let Some(t) = self.texcoords.iter().position(|t| !t.is_finite()) {
            return refuse(format!("texture coordinate {t} is {}", self.texcoords[t]), finite);
        }
        if let Some(normals) = &self.normals {
            if normals.len() != count {
                return refuse(format!("{} normals for {count} vertices", normals.len()), "give one per vertex");
            }
            // Written so that a NaN is refused too.
            if let Some(v) = normals.iter().position(|n| !(0.99..=1.01).contains(&n.length())) {
                let what = format!("the normal of vertex {v} is {}, unit length expected", normals[v]);
                return refuse(what, "normalise the base normals");
            }
        }
        self.faces.check(count, self.texcoords.len())?;
        let mut names = HashMap::new();
        for (i, target) in self.targets.iter().enumerate() {
            if let Some(first) = names.insert(target.name.as_str(), i) {
                let what = format!("targets {first} and {i} are both called '{}'", target.name);
                return refuse(what, "rename one of them");
            }
            for (kind, deltas) in [("position", Some(&target.positions)), ("normal", target.normals.as_ref())] {
                let deltas = deltas.map_or(&[][..], Vec::as_slice);
                if let Some((v, d)) = deltas.iter().find(|(_, d)| !d.is_finite()) {
                    let what = format!("target '{}': the {kind} delta of vertex {v} is {d}", target.name);
                    return refuse(what, finite);
                }
                if let Some(w) = deltas.windows(2).find(|w| w[0].0 >= w[1].0) {
                    let what = format!("target '{}': vertex {} comes after vertex {}", target.name, w[1].0, w[0].0);
                    return refuse(what, "list each vertex once, ascending");
                }
                if let Some((v, _)) = deltas.last().filter(|(v, _)| *v as usize >= count) {
                    let what = format!("target '{}' moves vertex {v}, there are {count}", target.name);
                    return refuse(what, "give targets of the same vertices as the base pose");
                }
                // The deformed surface has to be finite as well, or its normals are not.
                if kind == "position"
                    && let Some((v, d)) = deltas.iter().find(|(v, d)| !(self.positions[*v as usize] + *d).is_finite())
                {
                    let what = format!("target '{}' moves vertex {v} by {d}, to infinity", target.name);
                    return refuse(what, finite);
                }
            }
        }
        Ok(())
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
