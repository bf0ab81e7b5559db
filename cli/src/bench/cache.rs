//! What is made once for all configurations of an input: packed meshes, and float64 references.

use crate::args::PackArgs;
use crate::input::Input;
use crate::output::Failure;
use crate::runner::{Gpu, packed};
use deltamorph::reference::{evaluate, evaluate_unpacked};
use deltamorph::{DeltaFormat, PackedMesh};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

#[derive(Default)]
pub struct Cache {
    meshes: HashMap<DeltaFormat, Arc<PackedMesh>>,
    /// By format and the bits of the weights.
    references: HashMap<(DeltaFormat, Vec<u32>), Arc<Reference>>,
}

/// The float64 references of a pose: on the packed deltas, and on the raw files.
pub struct Reference {
    pub packed: Vec<f64>,
    pub raw: Vec<f64>,
}

/// Enough for one workload at its checkpoints in every format; more would only take memory.
const REFERENCES_MAX: usize = 64;

impl Cache {
    pub fn mesh(
        &mut self,
        input: &Input,
        gpu: Option<&Gpu>,
        format: DeltaFormat,
        args: &PackArgs,
    ) -> Result<Arc<PackedMesh>, Failure> {
        Ok(match self.meshes.entry(format) {
            Entry::Occupied(known) => known.get().clone(),
            Entry::Vacant(place) => place.insert(packed(input, gpu, format, args)?).clone(),
        })
    }

    pub fn reference(&mut self, mesh: &PackedMesh, input: &Input, weights: &[f32]) -> Arc<Reference> {
        let key = (mesh.layout().format, weights.iter().map(|w| w.to_bits()).collect());
        if self.references.len() >= REFERENCES_MAX && !self.references.contains_key(&key) {
            self.references.clear();
        }
        let make = || Reference { packed: evaluate(mesh, weights), raw: evaluate_unpacked(&input.raw, weights) };
        self.references.entry(key).or_insert_with(|| Arc::new(make())).clone()
    }
}
