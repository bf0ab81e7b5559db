//! The meshes that suites run on.

use super::Lab;
use crate::args::InputArgs;
use crate::bench::cache::Cache;
use crate::input::{self, Input};
use crate::output::Failure;
use deltamorph::MorphMesh;
use std::sync::Arc;

/// Mean fraction of the vertices that a target of the sparse head moves, where none is given.
const SPARSE: f32 = 0.08;

/// A mesh with all that was packed from it and computed for it.
pub struct Subject {
    pub input: Input,
    /// See there.
    pub cache: Cache,
    /// It comes from a packed file, which does not say what it was packed from.
    pub was_packed: bool,
}

impl Subject {
    /// The report will describe it.
    pub fn new(lab: &mut Lab<'_>, input: Input) -> Self {
        if lab.meshes.iter().all(|mesh| mesh.name != input.name) {
            lab.meshes.push(input.info());
        }
        let was_packed = input.packed.is_some();
        Self { input, cache: Cache::default(), was_packed }
    }

    /// The first `targets` of the mesh.
    pub fn first_targets(&self, targets: usize) -> Self {
        let first = |mesh: &MorphMesh| {
            let mut mesh = mesh.clone();
            mesh.targets.truncate(targets);
            Arc::new(mesh)
        };
        let Input { name, raw, kept, origin, .. } = &self.input;
        let (raw, kept, name, origin) = (first(raw), first(kept), name.clone(), origin.clone());
        let input = Input { name, raw, kept, packed: None, clips: vec![], origin };
        Self { input, cache: Cache::default(), was_packed: self.was_packed }
    }

    pub fn targets(&self) -> usize {
        self.input.kept.targets.len()
    }
}

/// The built-in head, dense and sparse; or INPUT alone.
pub fn dense_and_sparse(lab: &Lab<'_>) -> Result<Vec<Input>, Failure> {
    let args = &lab.args.input;
    if args.input.is_some() {
        return Ok(vec![input::load(args, true, lab.out)?]);
    }
    let sparse = args.head.sparsity.unwrap_or(SPARSE);
    let mut inputs = vec![];
    for (name, sparsity) in [("dense".to_owned(), 1.0), (format!("{}% sparse", sparse * 100.0), sparse)] {
        let mut args: InputArgs = lab.args.input.clone();
        args.head.sparsity = Some(sparsity);
        let input = input::load(&args, true, lab.out)?;
        inputs.push(Input { name, ..input });
    }
    Ok(inputs)
}
