//! A mesh, and data computed once for all configurations: packed meshes, and float64 references.

use super::machine::Machine;
use crate::input::Input;
use crate::output::Failure;
use crate::runner::{Gpu, packed};
use deltamorph::reference::{evaluate, evaluate_unpacked};
use deltamorph::{DeltaFormat, MorphMesh, PackedMesh};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

pub struct Subject {
    pub input: Input,
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
        Self { was_packed: input.packed.is_some(), input, meshes: HashMap::new(), references: HashMap::new() }
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

    /// The mesh in `format`.
    pub fn mesh(&mut self, machine: &Machine<'_>, format: DeltaFormat) -> Result<Arc<PackedMesh>, Failure> {
        let pack = || packed(&self.input, machine.gpu.as_ref().map(Gpu::engine), format, &machine.args.update.pack);
        Ok(match self.meshes.entry(format) {
            Entry::Occupied(known) => known.get().clone(),
            Entry::Vacant(place) => place.insert(pack()?).clone(),
        })
    }

    /// The references of the pose of `mesh`, made by [`mesh`](Self::mesh), at `weights`.
    pub fn reference(&mut self, mesh: &PackedMesh, weights: &[f32]) -> &Reference {
        let key = (mesh.layout().format, weights.iter().map(|w| w.to_bits()).collect());
        if self.references.len() >= REFERENCES_MAX && !self.references.contains_key(&key) {
            self.references.clear();
        }
        let raw = &self.input.raw;
        let make = || Reference { packed: evaluate(mesh, weights), raw: evaluate_unpacked(raw, weights) };
        self.references.entry(key).or_insert_with(make)
    }
}
