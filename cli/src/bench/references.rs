//! The float64 references, computed once for all configurations.

use crate::input::Input;
use deltamorph::reference::{evaluate, evaluate_unpacked};
use deltamorph::{DeltaFormat, PackedMesh};
use std::collections::HashMap;
use std::sync::Arc;

/// The float64 references of a workload's checkpoints: on the packed deltas, and on the raw files.
#[derive(Default)]
pub struct References {
    /// By format and the bits of the weights.
    known: HashMap<(DeltaFormat, Vec<u32>), Arc<Reference>>,
}

pub struct Reference {
    pub packed: Vec<f64>,
    pub raw: Vec<f64>,
}

/// Enough for one workload at its checkpoints in every format; more would only take memory.
const REFERENCES_MAX: usize = 64;

impl References {
    /// The references for these weights.
    pub fn get(&mut self, mesh: &PackedMesh, input: &Input, weights: &[f32]) -> Arc<Reference> {
        let key = (mesh.layout().format, weights.iter().map(|w| w.to_bits()).collect());
        if self.known.len() >= REFERENCES_MAX && !self.known.contains_key(&key) {
            self.known.clear();
        }
        let make = || {
            let (packed, raw) = (evaluate(mesh, weights), evaluate_unpacked(&input.raw, weights));
            Arc::new(Reference { packed, raw })
        };
        self.known.entry(key).or_insert_with(make).clone()
    }
}
