//! Meshes, and data computed once for all configurations: packed meshes, and float64 references.

use super::machine::Machine;
use crate::input::{Input, MeshInfo};
use crate::output::Result;
use crate::runner::{Gpu, packed};
use deltamorph::reference::evaluate;
use deltamorph::{DeltaFormat, PackedMesh};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

/// The meshes of a scene, at least one, which are updated together.
pub struct Subject {
    parts: Vec<Part>,
}

struct Part {
    input: Input,
    meshes: HashMap<DeltaFormat, Arc<PackedMesh>>,
    /// Of poses on the packed deltas, by format and the bits of the weights.
    references: HashMap<(DeltaFormat, Vec<u32>), Vec<f64>>,
}

/// Enough for one workload at its checkpoints in every format.
const REFERENCES_MAX: usize = 64;

impl Subject {
    pub fn new(inputs: Vec<Input>) -> Self {
        let part = |input| Part { input, meshes: HashMap::new(), references: HashMap::new() };
        Self { parts: inputs.into_iter().map(part).collect() }
    }

    /// What reports say of each mesh.
    pub fn infos(&self) -> impl Iterator<Item = MeshInfo> {
        self.parts.iter().map(|part| part.input.info())
    }

    /// What reports say of all meshes together.
    pub fn info(&self) -> MeshInfo {
        let together = |mut sum: MeshInfo, other: MeshInfo| {
            let deltas = |mesh: &MeshInfo| (mesh.vertices * mesh.targets) as f64;
            let moved = sum.moved_mean * deltas(&sum) + other.moved_mean * deltas(&other);
            sum.moved_mean = moved / (deltas(&sum) + deltas(&other)).max(1.0);
            sum.vertices += other.vertices;
            sum.targets += other.targets;
            sum.triangles += other.triangles;
            sum.name = format!("{} rigs", self.parts.len());
            sum
        };
        self.infos().reduce(together).unwrap_or_default()
    }

    /// The meshes in `format`.
    pub fn meshes(&mut self, machine: &Machine<'_>, format: DeltaFormat) -> Result<Vec<Arc<PackedMesh>>> {
        let engine = machine.gpu.as_ref().map(Gpu::engine);
        let mesh = |part: &mut Part| match part.meshes.entry(format) {
            Entry::Occupied(known) => Ok(known.get().clone()),
            Entry::Vacant(place) => {
                Ok(place.insert(packed(&part.input, engine, format, &machine.args.update.pack)?).clone())
            }
        };
        self.parts.iter_mut().map(mesh).collect()
    }

    /// The reference of the pose of `mesh`, number `part` of [`meshes`](Self::meshes), at `weights`.
    pub fn reference(&mut self, part: usize, mesh: &PackedMesh, weights: &[f32]) -> &[f64] {
        let references = &mut self.parts[part].references;
        let key = (mesh.layout().format, weights.iter().map(|w| w.to_bits()).collect());
        if references.len() >= REFERENCES_MAX && !references.contains_key(&key) {
            references.clear();
        }
        references.entry(key).or_insert_with(|| evaluate(mesh, weights))
    }
}
