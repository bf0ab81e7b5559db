//! Meshes whose targets come to the device and go, on a headless device, and what their poses are compared with.
#![allow(dead_code)] // each test file uses some of this

use crate::gpu::{self, NORMAL, fixed, is_kept};
use deltamorph::reference::compare;
use deltamorph::{
    Crowd, DeltaFormat, GpuMesh, MorphEngine, PackedMesh, PoseReadback, TargetSwap, Tolerance, UpdateDesc, testing,
};
use deltamorph_head::{HeadDesc, head};
use deltamorph_headless::Headless;

pub const TARGETS: usize = 37;

pub fn packed(engine: &MorphEngine, format: DeltaFormat, with_streams: bool) -> PackedMesh {
    let desc = HeadDesc::default().vertices(900).targets(TARGETS).sparsity(0.15).seed(3);
    let mesh = head(&desc).to_mesh(Tolerance::default()).expect("a mesh");
    gpu::packed(engine, &if with_streams { testing::with_streams(mesh) } else { mesh }, format)
}

/// Bytes of the deltas of all targets.
pub fn all_bytes(mesh: &PackedMesh) -> u64 {
    (0..TARGETS).map(|target| mesh.target_bytes(target)).sum()
}

/// Float32 poses, and integers where the format has them.
pub fn updates(format: DeltaFormat) -> Vec<UpdateDesc> {
    let floats = [UpdateDesc::blocks().tolerance(1e-2)];
    floats.into_iter().chain(fixed().into_iter().filter(|_| format.has_integers())).collect()
}

pub fn upload(headless: &Headless, mesh: &PackedMesh, bytes: Option<u64>) -> GpuMesh {
    let engine = headless.engine();
    // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
    let uploaded = headless.run(|cmd| unsafe {
        match bytes {
            Some(bytes) => engine.upload_resident(cmd, mesh, bytes),
            None => engine.upload(cmd, mesh),
        }
    });
    let mut uploaded = uploaded.expect("an upload");
    // SAFETY: it has run.
    unsafe { uploaded.release_staging() };
    uploaded
}

pub fn swap(headless: &Headless, gpu: &mut GpuMesh, mesh: &PackedMesh, load: &[usize], unload: &[usize]) -> u64 {
    let swap = TargetSwap::default().load(load).unload(unload);
    // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
    let copies = headless.run(|cmd| unsafe { headless.engine().record_swap(cmd, gpu, mesh, &swap) });
    copies.expect("a swap").bytes()
}

pub fn update(headless: &Headless, crowd: &mut Crowd) {
    // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
    headless.run(|cmd| unsafe { headless.engine().record_update(cmd, crowd) }).expect("an update");
}

pub fn refused<T>(result: deltamorph::Result<T>, words: &str) {
    let text = result.err().unwrap_or_else(|| panic!("not refused: {words}")).to_string();
    assert!(text.contains(words), "{text}");
}

/// The poses of both crowds of the same weights are the same bits, and right.
pub fn assert_same(mesh: &PackedMesh, update: &UpdateDesc, readbacks: &mut [PoseReadback; 2], weights: &[Vec<f32>]) {
    // SAFETY: the callers have waited.
    let [swapped, whole] = readbacks.each_mut().map(|readback| unsafe { readback.poses() }.expect("poses"));
    assert_eq!(swapped.len(), weights.len());
    for ((swapped, whole), weights) in swapped.iter().zip(&whole).zip(weights) {
        let bits = |numbers: &[f32]| numbers.iter().map(|number| number.to_bits()).collect::<Vec<_>>();
        assert!(bits(&swapped.vertices) == bits(&whole.vertices), "{update:?}: {weights:?}");
        for (one, other) in swapped.streams.iter().zip(&whole.streams) {
            assert!(one.0 == other.0 && bits(&one.1) == bits(&other.1), "{update:?}: {:?}", one.0);
        }
        let error = compare(&swapped.vertices, &gpu::reference(mesh, update, weights));
        let kept = is_kept(&error, mesh.layout().diagonal) || error.within(f64::from(update.tolerance), NORMAL);
        assert!(kept, "{update:?}: {error:?}");
    }
}
