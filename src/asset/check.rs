//! Whether a [`MorphSource`] can be used.

use super::render::{check_welds, copies};
use super::streams::Measure;
use super::{MorphSource, Semantic, SourceTarget, StreamData, StreamDeltas, Tolerance};
use crate::error::{Error, Result};
use glam::Vec3;
use std::collections::HashMap;
use std::fmt::Display;

const NOT_FINITE: &str = "replace values that are not a number or infinite";
const DIRECTION: &str = "normalise x y z, and give a tangent 1 or -1 as w";
const WELD: &str = "weld vertices of one place, each to the first of them, or none (MorphSource::weld finds them)";

impl MorphSource {
    /// Everything that [`to_mesh`](Self::to_mesh) refuses.
    pub(super) fn check(&self, tolerance: Tolerance) -> Result<()> {
        for (kind, value) in [("position", tolerance.position), ("normal", tolerance.normal)] {
            if !(value >= 0.0 && value.is_finite()) {
                return self.refuse(format!("the {kind} tolerance is {value}"), "give a tolerance of 0 or more");
            }
        }
        let count = self.positions.len();
        if count == 0 {
            return self.refuse("the base pose has no vertex", "give a mesh with at least one vertex");
        }
        // Corners as well, since adjacency counts them in 32 bits.
        if u32::try_from(count).is_err() || u32::try_from(self.faces.corners.len()).is_err() {
            return self.refuse("more than 4,294,967,295 vertices or face corners", "split the mesh");
        }
        self.check_values(Semantic::Position, self.positions.iter().map(Vec3::to_array))?;
        let normals = self.normals.as_deref().unwrap_or_default();
        if self.normals.is_some() && normals.len() != count {
            return self.refuse(format!("{} normals for {count} vertices", normals.len()), "give one per vertex");
        }
        self.check_values(Semantic::Normal, normals.iter().map(Vec3::to_array))?;
        if let Some(t) = self.texcoords.iter().position(|t| !t.is_finite()) {
            return self.refuse(format!("texture coordinate {t} is {}", self.texcoords[t]), NOT_FINITE);
        }
        self.faces.check(count, self.texcoords.len())?;
        self.check_streams()?;
        let mut names = HashMap::new();
        for (i, target) in self.targets.iter().enumerate() {
            if let Some(first) = names.insert(target.name.as_str(), i) {
                let what = format!("targets {first} and {i} are both called '{}'", target.name);
                return self.refuse(what, "rename one of them");
            }
            self.check_target(target)?;
        }
        check_welds(&self.welds, count).or_else(|what| self.refuse(what, WELD))?;
        if let Some((v, of)) = copies(&self.welds).find(|(v, of)| !self.meet(*v, *of)) {
            return self.refuse(format!("vertex {v} is welded to vertex {of}, but is or moves elsewhere"), WELD);
        }
        Ok(())
    }

    fn refuse(&self, what: impl Display, remedy: &str) -> Result<()> {
        Err(Error::invalid(format!("{}: {what}", self.name), remedy))
    }

    /// Whether the streams beside positions and normals fit the vertices of the base pose.
    fn check_streams(&self) -> Result<()> {
        let count = self.positions.len();
        for (i, StreamData { semantic, values }) in self.streams.iter().enumerate() {
            if matches!(semantic, Semantic::Position | Semantic::Normal) {
                return self
                    .refuse(format!("a further stream '{semantic}'"), "use the fields `positions` and `normals`");
            }
            if self.streams[..i].iter().any(|other| other.semantic == *semantic) {
                return self.refuse(format!("two streams '{semantic}'"), "number them, or remove one");
            }
            let components = semantic.components();
            if values.len() != components * count {
                let what = format!("stream '{semantic}': {} numbers for {count} vertices", values.len());
                return self.refuse(what, &format!("give {components} numbers per vertex"));
            }
            self.check_values(*semantic, values.chunks_exact(components))?;
        }
        Ok(())
    }

    /// Whether the values of a stream are finite, and directions of unit length (within 1%).
    fn check_values(&self, semantic: Semantic, values: impl Iterator<Item: AsRef<[f32]>>) -> Result<()> {
        let is_unit = |v: &[f32]| (0.99..=1.01).contains(&Vec3::from_slice(v).length());
        let is_direction = |v: &[f32]| is_unit(v) && v[3..].iter().all(|handedness| handedness.abs() == 1.0);
        for (v, value) in values.enumerate() {
            let value = value.as_ref();
            let refuse = |remedy| self.refuse(format!("the {semantic} of vertex {v} is {value:?}"), remedy);
            if value.iter().any(|x| !x.is_finite()) {
                return refuse(NOT_FINITE);
            }
            if semantic.measure() == Measure::Angle && !is_direction(value) {
                return refuse(DIRECTION);
            }
        }
        Ok(())
    }

    fn check_target(&self, target: &SourceTarget) -> Result<()> {
        let refuse = |what: String, remedy: &str| self.refuse(format!("target '{}' {what}", target.name), remedy);
        let vectors = |(v, d): &(u32, Vec3)| (*v, d.to_array());
        self.check_deltas(target, Semantic::Position, target.positions.iter().map(vectors))?;
        self.check_deltas(target, Semantic::Normal, target.normals.iter().flatten().map(vectors))?;
        // The deformed surface has to be finite as well, or its normals are not.
        let infinite = |(v, d): &&(u32, Vec3)| !(self.positions[*v as usize] + *d).is_finite();
        if let Some((v, d)) = target.positions.iter().find(infinite) {
            return refuse(format!("moves vertex {v} by {d}, to infinity"), NOT_FINITE);
        }
        let streams = &target.streams;
        if streams.len() > self.streams.len() {
            let what = format!("has deltas of {} streams", streams.len());
            return refuse(what, "give the base pose every stream that a target changes");
        }
        for (semantic, StreamDeltas { vertices, deltas }) in self.streams.iter().map(|s| s.semantic).zip(streams) {
            let numbers = semantic.morphing_components();
            if deltas.len() != numbers * vertices.len() {
                let (found, moved) = (deltas.len(), vertices.len());
                let what = format!("has {found} numbers for {moved} vertices in the deltas of stream '{semantic}'");
                return refuse(what, &format!("give {numbers} numbers per vertex"));
            }
            self.check_deltas(target, semantic, vertices.iter().copied().zip(deltas.chunks_exact(numbers)))?;
        }
        Ok(())
    }

    /// Whether deltas are finite, ascending by vertex, and of vertices that there are.
    fn check_deltas(
        &self,
        target: &SourceTarget,
        semantic: Semantic,
        deltas: impl Iterator<Item = (u32, impl AsRef<[f32]>)>,
    ) -> Result<()> {
        let refuse = |what: String, remedy: &str| self.refuse(format!("target '{}': {what}", target.name), remedy);
        let mut before = None;
        for (v, delta) in deltas {
            let delta = delta.as_ref();
            if delta.iter().any(|d| !d.is_finite()) {
                return refuse(format!("the {semantic} delta of vertex {v} is {delta:?}"), NOT_FINITE);
            }
            if let Some(before) = before.filter(|before| *before >= v) {
                let what = format!("among the {semantic} deltas, vertex {v} comes after vertex {before}");
                return refuse(what, "list each vertex once, ascending");
            }
            if v as usize >= self.positions.len() {
                let what = format!("a {semantic} delta of vertex {v}, there are {} vertices", self.positions.len());
                return refuse(what, "give targets of the same vertices as the base pose");
            }
            before = Some(v);
        }
        Ok(())
    }

    /// Whether two vertices are at one place in the base pose and in all targets.
    pub(super) fn meet(&self, a: u32, b: u32) -> bool {
        let delta = |target: &SourceTarget, v: u32| {
            let found = target.positions.binary_search_by_key(&v, |(v, _)| *v);
            found.map_or(Vec3::ZERO, |i| target.positions[i].1)
        };
        self.positions[a as usize] == self.positions[b as usize]
            && self.targets.iter().all(|t| delta(t, a) == delta(t, b))
    }
}
