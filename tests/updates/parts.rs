//! Meshes in blocks whose deltas exceed a descriptor's range, on real drivers: the asset is split into parts, and poses
//! equal those of a device that takes it whole.

use crate::gpu::{self, drivers};
use crate::scene::{Scene, crowd, fixed};
use deltamorph::reference::{compare, evaluate};
use deltamorph::{
    AnimationDesc, CrowdDesc, DeltaFormat, MorphEngine, MorphMesh, PackDesc, PackedMesh, Playback, PoseFormat,
    UpdateDesc, UpdateMode, WeightClip, testing,
};
use deltamorph_headless::{Headless, HeadlessCrowd};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Runs `test` on a device with descriptors of at most `range` bytes.
fn within<R>(driver: &str, texels: bool, range: u64, test: impl FnOnce(&Headless) -> R) -> R {
    let limits = gpu::baseline(|caps| {
        if texels {
            (caps.max_texels, caps.int64) = (u32::MAX, true);
        }
        caps.max_storage_range = caps.max_storage_range.min(range);
    });
    gpu::on_device_within(driver, Some(limits), |headless, _| test(headless))
}

fn frame(targets: usize, frame: usize, instance: usize) -> Vec<f32> {
    let weight =
        |t: usize| if (t + frame + instance).is_multiple_of(3) { 0.0 } else { ((t * 7 + frame * 5) % 9) as f32 / 9.0 };
    (0..targets).map(weight).collect()
}

/// Makes 3,000 vertices × 96 targets: more than a megabyte in every format; then vertices without targets, whose blocks
/// have no entry.
fn mesh() -> MorphMesh {
    let mut mesh = testing::mesh(6000, 96);
    for target in &mut mesh.targets {
        let moved = target.vertices.partition_point(|&vertex| vertex < 3000);
        target.vertices.truncate(moved);
        target.positions.truncate(moved);
        target.normals.truncate(moved);
    }
    mesh
}

/// Returns whether to test a format on a driver: its kernels are not those of another driver or format.
fn is_tried(driver: &str, texels: bool, format: DeltaFormat) -> bool {
    match texels {
        true => matches!(format, DeltaFormat::Fast | DeltaFormat::Small),
        false => driver == drivers()[0] || format == DeltaFormat::Small,
    }
}

#[test]
fn an_asset_beyond_the_storage_range_runs_in_parts() {
    let mesh = mesh();
    for (driver, texels) in drivers().into_iter().flat_map(|driver| [(driver.clone(), false), (driver, true)]) {
        for format in DeltaFormat::BLOCKS.into_iter().filter(|format| is_tried(&driver, texels, *format)) {
            let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("a mesh");
            let all = [
                (PoseFormat::Float32, 1),
                (PoseFormat::Float32, 5),
                (PoseFormat::Fixed32, 1),
                (PoseFormat::Fixed16, 5),
            ];
            for (pose, instances) in all.into_iter().filter(|(pose, _)| format.has_integers() || !pose.has_integers()) {
                let poses = [1 << 20, u64::MAX].map(|range| {
                    within(&driver, texels, range, |headless| {
                        let whole = MorphEngine::mesh_bytes(&packed) <= headless.caps().max_storage_range;
                        assert_eq!(whole, range == u64::MAX, "{format:?}");
                        let desc = CrowdDesc::new(UpdateDesc::blocks().pose(pose).tolerance(1e-2)).instances(instances);
                        let mut crowd = HeadlessCrowd::new(headless, &packed, &desc).expect("a crowd");
                        for f in 0..3 {
                            let weights: Vec<Vec<f32>> = (0..instances as usize).map(|i| frame(96, f, i)).collect();
                            crowd.step(&weights.iter().map(Vec::as_slice).collect::<Vec<_>>()).expect("a step");
                        }
                        let error = compare(&crowd.read_pose(0).expect("a pose"), &evaluate(&packed, &frame(96, 2, 0)));
                        assert!(
                            error.position <= 3e-3 * f64::from(mesh.diagonal),
                            "{driver} {format:?} {pose:?}: {error:?}"
                        );
                        (0..instances).map(|i| crowd.read_stored(i, 0).expect("a pose")).collect::<Vec<_>>()
                    })
                });
                // Several instances may use narrower tiles, whose float32 sums round differently.
                let comparable = pose.has_integers() || instances == 1;
                assert!(!comparable || poses[0] == poses[1], "{driver} {format:?} {pose:?} of {instances}");
            }
        }
    }
}

/// Plays, hides and shows instances of a crowd animated on the GPU; updates are lost, or run together. Compares plans
/// and poses with the CPU's. Returns the final poses, and the index of the part of each work list.
fn animated(headless: &Headless, packed: &Arc<PackedMesh>, desc: CrowdDesc) -> (Vec<Vec<u8>>, Vec<usize>) {
    let names = packed.layout().targets.iter().map(|target| target.name.clone()).collect();
    let values = (0..5).flat_map(|f| frame(packed.layout().targets.len(), f, 0)).collect();
    let clips = [WeightClip { name: "clip".into(), names, fps: 24.0, values }];
    let mut scene = Scene::new(headless, packed, desc, &AnimationDesc::new(&clips));
    for i in scene.instances().filter(|i| i % 4 != 3) {
        scene.play(i, Playback::new(0).start(-0.07 * f64::from(i)));
    }
    for f in 0..6 {
        let now = f64::from(f) / 30.0;
        if f % 3 == 2 {
            scene.hide(desc.instances - 1, !scene.is_hidden(desc.instances - 1));
            scene.drop_one(now + 0.3);
        }
        if f == 4 {
            scene.step_together(&[now - 0.01, now]);
        } else {
            scene.step(now);
        }
    }
    scene.instances().step_by(5).for_each(|i| scene.assert_fresh(i));
    let lists = scene.crowd.read_plan().expect("a plan").iter().map(|list| list.entries.start).collect();
    (scene.instances().map(|i| scene.crowd.read_stored(i, 0).expect("a pose")).collect(), lists)
}

#[test]
fn crowds_animated_on_the_gpu_run_in_parts() {
    let mesh = mesh();
    for (driver, texels) in drivers().into_iter().flat_map(|driver| [(driver.clone(), false), (driver, true)]) {
        let formats = DeltaFormat::BLOCKS.into_iter().filter(|format| format.has_integers());
        for format in formats.filter(|format| is_tried(&driver, texels, *format)) {
            let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("a mesh"));
            let all = [
                (PoseFormat::Fixed16, 12, UpdateMode::Incremental),
                (PoseFormat::Fixed32, 3, UpdateMode::Incremental),
                (PoseFormat::Fixed16, 1, UpdateMode::Rebuild),
            ];
            let some = match (format, texels) {
                (DeltaFormat::Small, _) => &all[..],
                (_, false) => &all[..1],
                (_, true) => &all[1..2],
            };
            for &(pose, instances, mode) in some {
                let desc = crowd(instances, fixed(pose, 2).mode(mode));
                let [cut, whole] = [1 << 20, u64::MAX].map(|range| {
                    let (poses, lists) = within(&driver, texels, range, |headless| animated(headless, &packed, desc));
                    let parts: BTreeSet<usize> = lists.iter().copied().collect();
                    assert_eq!(parts.len() > 1, range != u64::MAX, "{format:?}");
                    poses
                });
                assert!(cut == whole, "{driver} {format:?} {desc:?}");
            }
        }
    }
}

#[test]
fn what_cannot_be_cut_is_refused() {
    let large = PackedMesh::pack(&testing::mesh(64, 200), &PackDesc::new(DeltaFormat::BlockFloat32)).expect("a mesh");
    let packed = PackedMesh::pack(&mesh(), &PackDesc::new(DeltaFormat::Small)).expect("a mesh");
    within(&drivers()[0], false, 6016 * 24, |headless| {
        let made = HeadlessCrowd::new(headless, &large, &CrowdDesc::new(UpdateDesc::blocks()));
        testing::says(made, &["a block takes"]);
        // The poses of one instance have to fit a descriptor's range.
        let desc = |slots| crowd(2, fixed(PoseFormat::Fixed32, slots));
        let (clips, words) = ([], ["the slots of one instance", "288768 bytes", "use fewer slots, or split the mesh"]);
        let animated = |slots| HeadlessCrowd::animated(headless, &packed, &desc(slots), &AnimationDesc::new(&clips));
        testing::says(animated(2), &words);
        testing::says(HeadlessCrowd::new(headless, &packed, &desc(2)), &words);
        animated(1).expect("a crowd in one slot");
    });
}
