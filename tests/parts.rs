//! Meshes in blocks whose deltas exceed what a descriptor covers, on real drivers: the asset is cut into parts, and
//! poses are those of a device that takes it whole.

#[path = "common/gpu.rs"]
mod gpu;

use deltamorph::headless::{DeviceChoice, Headless, HeadlessCrowd, HeadlessDesc};
use deltamorph::reference::{compare, evaluate};
use deltamorph::{
    AnimationDesc, CrowdDesc, DeltaFormat, DeviceCaps, MorphEngine, MorphMesh, PackDesc, PackedMesh, PoseFormat,
    UpdateDesc, WeightClip, testing,
};
use gpu::{complaints, drivers};

/// What the devices here offer, with at most so many bytes to a descriptor.
fn headless(driver: &str, texels: bool, range: u64) -> Headless {
    let mut limits = DeviceCaps::android_baseline();
    if texels {
        (limits.max_texels, limits.int64) = (u32::MAX, true);
    }
    limits.max_storage_range = limits.max_storage_range.min(range);
    let desc = HeadlessDesc::default().device(DeviceChoice::Name(driver.to_owned())).validation(true);
    Headless::new(&desc.limits(Some(limits))).expect("a device")
}

fn frame(targets: usize, frame: usize, instance: usize) -> Vec<f32> {
    let weight =
        |t: usize| if (t + frame + instance).is_multiple_of(3) { 0.0 } else { ((t * 7 + frame * 5) % 9) as f32 / 9.0 };
    (0..targets).map(weight).collect()
}

/// 3,000 vertices × 96 targets: more than a megabyte in every format; then vertices that nothing
/// moves, whose blocks have no entry.
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

#[test]
fn an_asset_beyond_the_storage_range_runs_in_parts() {
    let mesh = mesh();
    for (driver, texels) in drivers().into_iter().flat_map(|driver| [(driver.clone(), false), (driver, true)]) {
        for format in DeltaFormat::BLOCKS {
            let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("a mesh");
            // Each kernel once.
            let once = if texels {
                format == DeltaFormat::Fast
            } else {
                driver == drivers()[0] || format == DeltaFormat::Small
            };
            if !once {
                continue;
            }
            let all = [
                (PoseFormat::Float32, 1),
                (PoseFormat::Float32, 5),
                (PoseFormat::Fixed32, 1),
                (PoseFormat::Fixed16, 5),
            ];
            for (pose, instances) in all.into_iter().filter(|(pose, _)| format.has_integers() || !pose.has_integers()) {
                let poses = [1 << 20, u64::MAX].map(|range| {
                    let headless = headless(&driver, texels, range);
                    let whole = MorphEngine::mesh_bytes(&packed) <= headless.caps().max_storage_range;
                    assert_eq!(whole, range == u64::MAX, "{format:?}");
                    let desc = CrowdDesc::new(UpdateDesc::blocks().pose(pose).tolerance(1e-2)).instances(instances);
                    let mut crowd = HeadlessCrowd::new(&headless, &packed, &desc).expect("a crowd");
                    for f in 0..3 {
                        let weights: Vec<Vec<f32>> = (0..instances as usize).map(|i| frame(96, f, i)).collect();
                        crowd.step(&weights.iter().map(Vec::as_slice).collect::<Vec<_>>()).expect("a step");
                    }
                    let error = compare(&crowd.read_pose(0).expect("a pose"), &evaluate(&packed, &frame(96, 2, 0)));
                    assert!(
                        error.position <= 3e-3 * f64::from(mesh.diagonal),
                        "{driver} {format:?} {pose:?}: {error:?}"
                    );
                    let stored = (0..instances).map(|i| crowd.read_stored(i, 0).expect("a pose"));
                    let stored: Vec<Vec<u8>> = stored.collect();
                    drop(crowd);
                    let messages = complaints(&headless);
                    assert!(messages.is_empty(), "{driver} says:\n{}", messages.join("\n"));
                    stored
                });
                // Several heads may be in narrower tiles, whose float32 sums round otherwise.
                let comparable = pose.has_integers() || instances == 1;
                assert!(!comparable || poses[0] == poses[1], "{driver} {format:?} {pose:?} of {instances}");
            }
        }
    }
}

#[test]
fn what_cannot_be_cut_is_refused() {
    let packed = PackedMesh::pack(&mesh(), &PackDesc::new(DeltaFormat::Fast)).expect("a mesh");
    let driver = &drivers()[0];
    let device = headless(driver, false, 1 << 20);
    let clip = WeightClip { name: "clip".into(), names: vec!["target_0".into()], fps: 30.0, values: vec![0.0, 1.0] };
    let desc = CrowdDesc::new(UpdateDesc::blocks().pose(PoseFormat::Fixed16));
    let error = HeadlessCrowd::animated(&device, &packed, &desc, &AnimationDesc::new(&[clip])).err().expect("refused");
    assert!(error.to_string().contains("exceeds the storage range"), "{error}");
    drop(device);
    let pose = 6016 * 24;
    let device = headless(driver, false, pose);
    let large = PackedMesh::pack(&testing::mesh(64, 200), &PackDesc::new(DeltaFormat::BlockFloat32)).expect("a mesh");
    let error = HeadlessCrowd::new(&device, &large, &CrowdDesc::new(UpdateDesc::blocks())).err().expect("refused");
    assert!(error.to_string().contains("a block takes"), "{error}");
}
