//! What the tests of the techniques of others share.
#![allow(dead_code)] // each test file uses some of this

use crate::gpu;
use deltamorph::{BatchSize, DeltaFormat, MorphEngine, MorphMesh, PackedMesh, UpdateDesc, UpdateMode, UpdatePath};
use deltamorph_headless::Headless;

/// Pack `mesh` in each format that baselines take, and run `test` with every description that the device can run.
pub fn for_every_desc(engine: &MorphEngine, mesh: &MorphMesh, mut test: impl FnMut(&PackedMesh, UpdateDesc)) {
    for format in [DeltaFormat::Float32, DeltaFormat::Snorm16, DeltaFormat::Small] {
        let mesh = gpu::packed(engine, mesh, format);
        descs(engine, format).into_iter().for_each(|desc| test(&mesh, desc));
    }
}

/// Every baseline that the device can run in `format`, with a spread of batch sizes, modes and slots.
pub fn descs(engine: &MorphEngine, format: DeltaFormat) -> Vec<UpdateDesc> {
    let mut descs = vec![];
    for path in UpdatePath::ALL.into_iter().filter(|path| path.is_baseline()) {
        if !path.formats().contains(&format) || engine.caps().check_path(path).is_err() {
            continue;
        }
        let mut batches = match (path, engine.caps().batch_max(path, format)) {
            (UpdatePath::VertexStore, Some(most)) => [1, 3, most].map(BatchSize::Targets).to_vec(),
            (_, Some(most)) => vec![BatchSize::Targets(most)],
            (_, None) => vec![BatchSize::All],
        };
        batches.dedup();
        for batch in batches {
            for (mode, slots) in [UpdateMode::Incremental, UpdateMode::Rebuild]
                .into_iter()
                .flat_map(|m| (1..4).map(move |slots| (m, slots)))
            {
                let desc = UpdateDesc::new(path, batch).mode(mode).slots(slots);
                descs.extend(desc.check().is_ok().then_some(desc));
            }
        }
    }
    descs
}

/// Whether the device can tell what a draw of a direct path evaluates.
pub fn can_read(headless: &Headless, desc: &UpdateDesc) -> bool {
    let caps = headless.caps();
    !desc.path.evaluates_in_draws() || caps.transform_feedback.is_some() || caps.vertex_stores
}

/// Weights of a face that rests, moves, moves a little, stays, moves all over, exaggerates, and rests again; no more
/// active than the path takes.
pub fn history(mesh: &PackedMesh, desc: &UpdateDesc, seed: u32) -> Vec<Vec<f32>> {
    let targets = mesh.layout().targets.len();
    let (a, b) = (gpu::weights(mesh, 1, seed), gpu::weights(mesh, 9, seed + 1));
    let mut nudged = a.clone();
    nudged.iter_mut().skip(targets / 2).take(1).for_each(|w| *w = 0.375);
    let mut one = vec![0.0; targets];
    one.iter_mut().rev().take(1).for_each(|w| *w = -0.75);
    let exaggerated = b.iter().map(|w| w * 1.9 - 0.3).collect();
    let mut frames = vec![vec![0.0; targets], a, nudged.clone(), nudged, b, exaggerated, one, vec![0.0; targets]];
    frames.iter_mut().for_each(|weights| keep_supported(weights, desc));
    frames
}

/// Clear the weights beyond those that the path takes at a time.
pub fn keep_supported(weights: &mut [f32], desc: &UpdateDesc) {
    if let (UpdatePath::DirectAttributes, BatchSize::Targets(most)) = (desc.path, desc.batch) {
        weights.iter_mut().filter(|w| **w != 0.0).skip(most as usize).for_each(|w| *w = 0.0);
    }
}
