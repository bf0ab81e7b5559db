//! Conversion of a source to a mesh ([`Mesh::pack`]), with its checks.

use super::extent::extent;
use super::normals::{Deformer, Surface};
use super::render::{check_welds, copies, copy_deltas};
use super::streams::Measure;
use super::{KeptMesh, KeptTarget, Mesh, MorphTarget, Semantic, StreamData, StreamDeltas, Tolerance};
use crate::error::{Error, Result, ensure};
use crate::math::{diagonal, map_all};
use crate::names::composed;
use glam::Vec3;
use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt::Display;

const NOT_FINITE: &str = "replace values that are not a number or infinite";
const DIRECTION: &str = "normalise x y z, and give a tangent 1 or -1 as w";
const WELD: &str = "weld each vertex to the first at its position, or leave the welds empty (Mesh::weld finds them)";

impl Mesh {
    /// The mesh that [`pack`](Self::pack) packs: checked, without deltas within `tolerance`, and with all normals.
    ///
    /// # Errors
    /// Those of [`pack`](Self::pack) that no [`PackDesc`](crate::PackDesc) avoids.
    #[doc(hidden)]
    pub fn kept(&self, tolerance: Tolerance) -> Result<KeptMesh> {
        self.check(tolerance)?;
        // Faces of the welded surface: copies have no faces, and take the normals of the vertex that they double.
        let mut copies: Vec<(u32, u32)> = copies(&self.welds).collect();
        copies.sort_by_key(|(_, of)| *of);
        let mut faces = Cow::Borrowed(&self.faces);
        if !copies.is_empty() {
            faces.to_mut().corners.iter_mut().for_each(|c| c.position = self.welds[c.position as usize]);
        }
        // Needed even if normals are stated, when a target has none: its delta is between two computed normals.
        let incomplete = self.normals.is_none() || self.targets.iter().any(|t| t.normals.is_none());
        let surface = incomplete.then(|| Surface::new(&faces, &self.positions));
        let what = "the bounding box is larger than a single-precision number";
        ensure!(diagonal(&self.positions).is_finite(), self.refuse(what, "scale the mesh down"));
        let diagonal = extent(&self.positions, &self.faces, &self.targets);
        let shortest = f64::from(tolerance.position) * f64::from(diagonal);

        let still = StreamDeltas::default();
        let keep = |deformer: &mut Option<Deformer<'_>>, target: &MorphTarget| {
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
            KeptTarget { streams, ..merge(composed(&target.name), &positions, &normals, tolerance.normal) }
        };
        let targets = map_all(&self.targets, surface.as_ref().map(Deformer::new), keep);
        let normals = self.normals.clone().unwrap_or_else(|| {
            let mut computed = surface.map(|surface| surface.normals).unwrap_or_default();
            copies.iter().for_each(|&(copy, of)| computed[copy as usize] = computed[of as usize]);
            computed
        });
        let mut notes = self.notes.clone();
        notes.extend(self.emptied(&targets, shortest));
        Ok(KeptMesh {
            name: self.name.clone(),
            positions: self.positions.clone(),
            origin: self.origin,
            normals,
            texcoords: self.texcoords.clone(),
            faces: self.faces.clone(),
            streams: self.streams.clone(),
            welds: self.welds.clone(),
            targets,
            diagonal,
            tolerance,
            notes,
        })
    }

    /// Notes that name the targets of which the tolerance, a length, left nothing, and those that state nothing.
    fn emptied(&self, kept: &[KeptTarget], shortest: f64) -> impl Iterator<Item = String> {
        let states = |target: &MorphTarget| {
            let normals = target.normals.as_ref().is_some_and(|normals| !normals.is_empty());
            normals || !target.positions.is_empty() || target.streams.iter().any(|deltas| !deltas.vertices.is_empty())
        };
        let is_empty = |target: &KeptTarget| {
            target.vertices.is_empty() && target.streams.iter().all(|deltas| deltas.vertices.is_empty())
        };
        let note = |stated: bool, why: String| {
            let is_named = |(source, kept): &(&MorphTarget, &KeptTarget)| states(source) == stated && is_empty(kept);
            let mut named = self.targets.iter().zip(kept).filter(is_named);
            let first = &named.next()?.0.name;
            let more = named.count();
            let others = if more > 0 { format!(" and {more} more") } else { String::new() };
            Some(format!("target '{first}'{others}: {why}"))
        };
        let moved = format!("positions move {shortest:.1e} at most");
        let within = note(true, format!("within the tolerance everywhere ({moved}), so left empty"));
        within.into_iter().chain(note(false, "equal to the base pose, moves nothing".to_owned()))
    }

    /// Checks everything that [`pack`](Self::pack) refuses.
    pub(super) fn check(&self, tolerance: Tolerance) -> Result<()> {
        for (kind, value) in [("position", tolerance.position), ("normal", tolerance.normal)] {
            let what = format!("the {kind} tolerance is {value}");
            ensure!(value >= 0.0 && value.is_finite(), self.refuse(what, "give a tolerance of 0 or more"));
        }
        let count = self.positions.len();
        ensure!(count > 0, self.refuse("the base pose has no vertex", "give a mesh with at least one vertex"));
        let what = format!("an origin of {}", self.origin);
        ensure!(self.origin.is_finite(), self.refuse(what, NOT_FINITE));
        // Corners as well, since adjacency counts them in 32 bits.
        let are_few = u32::try_from(count.max(self.faces.corners.len())).is_ok();
        ensure!(are_few, self.refuse("more than 4,294,967,295 vertices or face corners", "split the mesh"));
        self.check_values(None, Semantic::Position, (0..).zip(self.positions.iter().map(Vec3::to_array)))?;
        let normals = self.normals.as_deref().unwrap_or_default();
        let what = format!("{} normals for {count} vertices", normals.len());
        ensure!(self.normals.is_none() || normals.len() == count, self.refuse(what, "give one per vertex"));
        self.check_values(None, Semantic::Normal, (0..).zip(normals.iter().map(Vec3::to_array)))?;
        for (t, value) in self.texcoords.iter().enumerate() {
            ensure!(value.is_finite(), self.refuse(format!("texture coordinate {t} is {value}"), NOT_FINITE));
        }
        self.faces.check(count, self.texcoords.len())?;
        for (i, StreamData { semantic, values }) in self.streams.iter().enumerate() {
            let is_further = !matches!(semantic, Semantic::Position | Semantic::Normal);
            let remedy = "use the fields `positions` and `normals`";
            ensure!(is_further, self.refuse(format!("a further stream '{semantic}'"), remedy));
            let is_first = self.streams[..i].iter().all(|other| other.semantic != *semantic);
            ensure!(is_first, self.refuse(format!("two streams '{semantic}'"), "number them, or remove one"));
            let components = semantic.components();
            let what = format!("stream '{semantic}': {} numbers for {count} vertices", values.len());
            let remedy = format!("give {components} numbers per vertex");
            ensure!(values.len() == components * count, self.refuse(what, &remedy));
            self.check_values(None, *semantic, (0..).zip(values.chunks_exact(components)))?;
        }
        let mut names = HashMap::new();
        for (i, target) in self.targets.iter().enumerate() {
            if let Some(first) = names.insert(composed(&target.name), i) {
                let what = format!("targets {first} and {i} are both called '{}'", target.name);
                return Err(self.refuse(what, "rename one of them"));
            }
            self.check_target(target)?;
        }
        check_welds(&self.welds, count).map_err(|what| self.refuse(what, WELD))?;
        let places = if self.welds.is_empty() { vec![] } else { self.places() };
        for (v, of) in copies(&self.welds) {
            let what = || format!("vertex {v} is welded to vertex {of}, but their positions differ in some pose");
            ensure!(places[v as usize] == places[of as usize], self.refuse(what(), WELD));
        }
        Ok(())
    }

    fn refuse(&self, what: impl Display, remedy: &str) -> Error {
        Error::invalid(format!("{}: {what}", self.name), remedy)
    }

    fn check_target(&self, target: &MorphTarget) -> Result<()> {
        let refuse = |what: String, remedy: &str| self.refuse(format!("target '{}' {what}", target.name), remedy);
        let vectors = |(v, d): &(u32, Vec3)| (*v, d.to_array());
        let name = Some(target.name.as_str());
        self.check_values(name, Semantic::Position, target.positions.iter().map(vectors))?;
        self.check_values(name, Semantic::Normal, target.normals.iter().flatten().map(vectors))?;
        // The deformed surface has to be finite as well, or its normals are not.
        for (v, d) in &target.positions {
            let is_finite = (self.positions[*v as usize] + *d).is_finite();
            ensure!(is_finite, refuse(format!("moves vertex {v} by {d}, to infinity"), NOT_FINITE));
        }
        let streams = &target.streams;
        let what = format!("has deltas of {} streams", streams.len());
        let remedy = "give the base pose every stream that a target changes";
        ensure!(streams.len() <= self.streams.len(), refuse(what, remedy));
        for (semantic, StreamDeltas { vertices, deltas }) in self.streams.iter().map(|s| s.semantic).zip(streams) {
            let numbers = semantic.morphing_components();
            let [found, moved] = [deltas.len(), vertices.len()];
            let what = format!("has {found} numbers for {moved} vertices in the deltas of stream '{semantic}'");
            ensure!(found == numbers * moved, refuse(what, &format!("give {numbers} numbers per vertex")));
            self.check_values(name, semantic, vertices.iter().copied().zip(deltas.chunks_exact(numbers)))?;
        }
        Ok(())
    }

    /// Checks that values are finite and ascending by existing vertices; and that directions of the base pose (no
    /// `target`) have unit length, within 1%.
    fn check_values(
        &self,
        target: Option<&str>,
        semantic: Semantic,
        values: impl Iterator<Item = (u32, impl AsRef<[f32]>)>,
    ) -> Result<()> {
        let (of, name) = match target {
            Some(target) => (format!("target '{target}': "), format!("{semantic} delta")),
            None => (String::new(), semantic.to_string()),
        };
        let refuse = |what: String, remedy| self.refuse(format!("{of}{what}"), remedy);
        let is_unit = |v: &[f32]| (0.99..=1.01).contains(&Vec3::from_slice(v).length());
        let is_direction = |v: &[f32]| is_unit(v) && v[3..].iter().all(|handedness| handedness.abs() == 1.0);
        let directions = target.is_none() && semantic.measure() == Measure::Angle;
        let mut before = None;
        for (v, value) in values {
            let value = value.as_ref();
            let finite = value.iter().all(|x| x.is_finite());
            if !finite || directions && !is_direction(value) {
                let what = format!("the {name} of vertex {v} is {value:?}");
                return Err(refuse(what, if finite { DIRECTION } else { NOT_FINITE }));
            }
            if let Some(before) = before.filter(|before| *before >= v) {
                let what = format!("among the {name}s, vertex {v} comes after vertex {before}");
                return Err(refuse(what, "list each vertex once, ascending"));
            }
            let count = self.positions.len();
            let what = || format!("a {name} of vertex {v}, there are {count} vertices");
            ensure!((v as usize) < count, refuse(what(), "give targets of the same vertices as the base pose"));
            before = Some(v);
        }
        Ok(())
    }
}

/// Joins position deltas (all of them are kept) with the normal deltas that are kept: those of vertices that stay for
/// their position, and those longer than `shortest`.
fn merge(name: String, positions: &[(u32, Vec3)], normals: &[(u32, Vec3)], shortest: f32) -> KeptTarget {
    let mut target = KeptTarget { name, ..Default::default() };
    let mut p = positions.iter().peekable();
    let mut n = normals.iter().peekable();
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

/// Returns the deltas of another stream that are above the tolerance.
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
