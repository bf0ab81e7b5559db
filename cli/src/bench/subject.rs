//! A mesh, and data computed once for all configurations: packed meshes, and float64 references.

use super::machine::Machine;
use crate::input::{Input, MeshInfo};
use crate::output::Failure;
use crate::runner::{Gpu, packed};
use deltamorph::reference::{evaluate, evaluate_unpacked};
use deltamorph::{DeltaFormat, MorphMesh, PackedMesh};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

pub struct Subject {
    pub input: Input,
    /// The other meshes of a scene, which are updated together with this one.
    pub others: Vec<Self>,
    /// Whether it comes from a packed file, which lacks the original deltas.
    pub was_packed: bool,
    meshes: HashMap<DeltaFormat, Arc<PackedMesh>>,
    /// By format and the bits of the weights.
    references: HashMap<(DeltaFormat, Vec<u32>), Reference>,
}

/// The float64 references of a pose: on the packed deltas, and on the raw files.
pub struct Reference {
    pub packed: Vec<f64>,
    pub raw: Vec<f64>,
}

/// Enough for one workload at its checkpoints in every format.
const REFERENCES_MAX: usize = 64;

impl Subject {
    pub fn new(input: Input) -> Self {
        let (meshes, references) = (HashMap::new(), HashMap::new());
        Self { was_packed: input.packed.is_some(), input, others: vec![], meshes, references }
    }

    /// What reports say of the mesh, or of all meshes of a scene together.
    pub fn info(&self) -> MeshInfo {
        let mut sum = self.input.info();
        for (n, other) in (2..).zip(self.others.iter().map(|other| other.input.info())) {
            sum.name = format!("{n} rigs");
            let deltas = |mesh: &MeshInfo| (mesh.vertices * mesh.targets) as f64;
            let moved = sum.moved_mean * deltas(&sum) + other.moved_mean * deltas(&other);
            sum.moved_mean = moved / (deltas(&sum) + deltas(&other)).max(1.0);
            sum.vertices += other.vertices;
            sum.targets += other.targets;
            sum.triangles += other.triangles;
        }
        sum
    }

    /// The mesh with its first `targets` targets.
    pub fn first_targets(&self, targets: usize) -> Self {
        let first = |mesh: &MorphMesh| {
            let mut mesh = mesh.clone();
            mesh.targets.truncate(targets);
            Arc::new(mesh)
        };
        let (name, origin) = (self.input.name.clone(), self.input.origin.clone());
        let (raw, kept) = (first(&self.input.raw), first(&self.input.kept));
        let input = Input { name, raw, kept, origin, ..Input::default() };
        Self { was_packed: self.was_packed, ..Self::new(input) }
    }

    pub fn targets(&self) -> usize {
        self.input.kept.targets.len()
    }

    /// The mesh in `format`, and after it those of a scene.
    pub fn meshes(&mut self, machine: &Machine<'_>, format: DeltaFormat) -> Result<Vec<Arc<PackedMesh>>, Failure> {
        let pack = || packed(&self.input, machine.gpu.as_ref().map(Gpu::engine), format, &machine.args.update.pack);
        let own = match self.meshes.entry(format) {
            Entry::Occupied(known) => known.get().clone(),
            Entry::Vacant(place) => place.insert(pack()?).clone(),
        };
        let mut all = vec![own];
        for other in &mut self.others {
            all.extend(other.meshes(machine, format)?);
        }
        Ok(all)
    }

    /// The references of the pose of `mesh`, number `part` of [`meshes`](Self::meshes), at `weights`.
    pub fn reference(&mut self, part: usize, mesh: &PackedMesh, weights: &[f32]) -> &Reference {
        if let Some(other) = part.checked_sub(1) {
            return self.others[other].reference(0, mesh, weights);
        }
        let key = (mesh.layout().format, weights.iter().map(|w| w.to_bits()).collect());
        if self.references.len() >= REFERENCES_MAX && !self.references.contains_key(&key) {
            self.references.clear();
        }
        let raw = &self.input.raw;
        let make = || Reference { packed: evaluate(mesh, weights), raw: evaluate_unpacked(raw, weights) };
        self.references.entry(key).or_insert_with(make)
    }
}
