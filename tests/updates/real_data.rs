//! Real meshes and captured clips, whole, on every path: the project's error limits.

use crate::data;
use crate::gpu;
use deltamorph::import::obj;
use deltamorph::reference::{compare, evaluate, evaluate_unpacked};
use deltamorph::{
    Asset, BatchSize, CpuCrowd, DeltaFormat, MorphMesh, PackDesc, PackedMesh, PoseError, Tolerance, UpdateDesc,
    UpdatePath,
};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Returns whether a frame's poses are compared: every 20th, and the last.
fn is_checked(frame: usize, frames: usize) -> bool {
    frame.is_multiple_of(20) || frame + 1 == frames
}

struct Errors {
    /// Error against the kept deltas.
    kept: PoseError,
    /// Error against the raw files.
    raw: PoseError,
}

fn play(
    frames: &[Vec<f32>],
    packed: &PackedMesh,
    raw: &MorphMesh,
    mut pose: impl FnMut(&[f32], bool) -> Option<Vec<f32>>,
) -> Errors {
    let mut errors = Errors { kept: PoseError::default(), raw: PoseError::default() };
    for (i, weights) in frames.iter().enumerate() {
        if let Some(pose) = pose(weights, is_checked(i, frames.len())) {
            errors.kept = errors.kept.max(compare(&pose, &evaluate(packed, weights)));
            errors.raw = errors.raw.max(compare(&pose, &evaluate_unpacked(raw, weights)));
        }
    }
    errors
}

fn assert_kept(errors: &Errors, diagonal: f64, what: &str) {
    assert!(
        errors.kept.within(gpu::POSITION * diagonal, gpu::NORMAL),
        "{what}: positions {:.2e} of the diagonal, normals {:.4}°",
        errors.kept.position / diagonal,
        errors.kept.normal_degrees
    );
}

/// Plays a whole clip on the GPU paths at their smallest and largest batch, and on the path `cpu`.
fn whole_clip(set: &str, clip_name: &str) {
    let Some(folder) = data::set(set) else { return };
    let source = obj::import_folder(&folder).expect("a folder that imports");
    let raw = source.to_mesh(Tolerance::ZERO).expect("a mesh");
    let (kept, frames) = data::face(set, clip_name).expect("the same set");
    let diagonal = f64::from(kept.diagonal);

    gpu::on_device(&gpu::one(), false, |headless, engine| {
        for format in DeltaFormat::DENSE {
            let packed = gpu::packed(engine, &kept, format);
            let most = |path| BatchSize::Targets(engine.caps().batch_max(path, format).expect("a largest batch"));
            for (path, batch) in [
                (UpdatePath::Feedback, BatchSize::Targets(1)),
                (UpdatePath::Feedback, most(UpdatePath::Feedback)),
                (UpdatePath::Compute, BatchSize::Targets(1)),
                (UpdatePath::Compute, most(UpdatePath::Compute)),
                (UpdatePath::Compute, BatchSize::All),
            ] {
                let desc = UpdateDesc::new(path, batch);
                let mut crowd = gpu::crowd(headless, &packed, desc);
                let errors = play(&frames, &packed, &raw, |weights, check| {
                    crowd.step(&[weights]).expect("a step");
                    check.then(|| crowd.read_pose(0).expect("a pose"))
                });
                let what = format!("{set}/{clip_name} {} {} {batch}", path.name(), format.name());
                assert_kept(&errors, diagonal, &what);
                assert!(errors.raw.position <= 5e-5 * diagonal, "{what}: {:?} against the raw files", errors.raw);
            }
        }
    });

    for (mesh, raw_bound) in [(&kept, 5e-5), (&raw, gpu::POSITION)] {
        let packed = Arc::new(PackedMesh::pack(mesh, &Default::default()).expect("a mesh that fits"));
        let desc = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
        let mut crowd = CpuCrowd::new(packed.clone(), desc, 1, 2).expect("a crowd");
        let errors = play(&frames, &packed, &raw, |weights, check| {
            crowd.set_weights(0, weights).expect("weights that fit");
            crowd.update();
            check.then(|| crowd.pose(0).expect("an instance").to_vec())
        });
        assert_kept(&errors, diagonal, &format!("{set}/{clip_name} cpu"));
        assert!(errors.raw.position <= raw_bound * diagonal, "{set} cpu: {:?} against the raw files", errors.raw);
    }
}

#[test]
fn facecap_head_plays_the_captured_take() {
    whole_clip("facecap_head_glb", "facecap_30fps.csv");
}

#[test]
#[ignore = "a minute: .ci/deep"]
fn ict_facekit_plays_the_captured_take() {
    whole_clip("ict_facekit", "facecap_30fps.csv");
}

#[test]
#[ignore = "a minute: .ci/deep"]
fn makehuman_plays_the_captured_take() {
    whole_clip("makehuman_face", "facecap_30fps.csv");
}

fn timed<T>(f: impl FnOnce() -> T) -> (T, Duration) {
    let start = Instant::now();
    let result = f();
    (result, start.elapsed())
}

/// A packed file loads equal. `.ci/deep` measures the speed, which depends on the machine.
#[test]
fn a_packed_file_loads_as_it_was_packed() {
    let Some(folder) = data::set("ict_facekit") else { return };
    let (mesh, import) = timed(|| {
        let source = obj::import_folder(&folder).expect("a folder that imports");
        source.to_mesh(Tolerance::default()).expect("a mesh")
    });
    let dir = tempfile::tempdir().expect("a folder");
    for format in [DeltaFormat::Small, DeltaFormat::Fast] {
        let path = dir.path().join(format!("ict_{}.dmorph", format.name()));
        let asset = Asset::pack(&mesh, &PackDesc::new(format)).expect("a mesh that packs");
        asset.write(&path).expect("written");
        let mut loads = [(); 3].map(|()| {
            let (loaded, time) = timed(|| Asset::read(&path).expect("a file that reads"));
            assert_eq!(loaded, asset);
            time
        });
        loads.sort_unstable();
        let (load, times) = (loads[1], import.as_secs_f64() / loads[1].as_secs_f64());
        let size = path.metadata().expect("a file").len();
        println!("{}: {size} bytes; import {import:?}, load {load:?}, {times:.0} times as fast", format.name());
    }
}
