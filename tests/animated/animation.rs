//! Animation on the GPU: weights, plans and poses against the CPU reference, bit for bit.

use crate::prelude::*;
use crate::scene::{FIXED, Scene, blocks, clips, crowd, fixed, packed, packed_streams};
use deltamorph::{KeyFormat, Repeat};

/// Returns numbers below `n`, the same everywhere.
fn dice(state: &mut u32, n: u32) -> u32 {
    *state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    (*state >> 16) % n
}

fn some_playback(state: &mut u32, now: f64) -> Playback {
    let speeds = [1.0, 0.5, -1.0, 3.0, 0.0, -0.25];
    // Drawn first: the base of a structure is evaluated after its fields.
    let clip = Playback::new(dice(state, 3));
    Playback {
        start: now + f64::from(dice(state, 20)) / 10.0 - 1.5,
        speed: speeds[dice(state, 6) as usize],
        repeat: if dice(state, 2) == 0 { Repeat::Loop } else { Repeat::Once },
        ..clip
    }
}

/// Plays, hides and shows instances at random. Returns the numbers of blocks rebuilt, added to, and only brought
/// up to date.
fn play_around(
    headless: &Headless,
    mesh: &Arc<PackedMesh>,
    desc: CrowdDesc,
    keys: KeyFormat,
    frames: u32,
) -> [usize; 3] {
    let (clips, mut seen) = (clips(), [0; 3]);
    let mut scene = Scene::new(headless, mesh, desc, &AnimationDesc { key_format: keys, ..AnimationDesc::new(&clips) });
    let mut state = desc.instances * 31 + desc.update.slots;
    for frame in 0..frames {
        let now = f64::from(frame) / 24.0;
        for instance in scene.instances() {
            if dice(&mut state, if frame == 0 { 2 } else { 12 }) == 0 {
                scene.play(instance, some_playback(&mut state, now));
            }
            if dice(&mut state, 8) == 0 {
                scene.hide(instance, !scene.is_hidden(instance));
            }
        }
        // Sometimes an update is lost, or two run at once.
        if dice(&mut state, 5) == 0 {
            scene.drop_one(now + 0.3);
        }
        if dice(&mut state, 5) == 0 {
            let both = [now, now + 0.02].map(|now| scene.record(now));
            scene.run(both.into());
            continue;
        }
        for (from_base, _, _, elements) in scene.step(now).0.values() {
            seen[if *from_base { 0 } else { 1 + usize::from(elements.is_empty()) }] += 1;
        }
        if frame % 4 == 3 {
            let shown: Vec<u32> = scene.instances().filter(|&i| !scene.is_hidden(i)).collect();
            shown.iter().step_by(1 + shown.len() / 5).for_each(|&instance| scene.assert_fresh(instance));
        }
    }
    seen
}

#[test]
fn the_gpu_plans_as_the_cpu_does() {
    gpu::on_every_driver(|headless, _| {
        // Elsewhere one delta format, block size and pose format: updates::integers runs each kernel that updates poses
        // on every driver.
        let all = gpu::runs_all(headless);
        let formats =
            [(DeltaFormat::Fast, 64), (DeltaFormat::Small, 32), (DeltaFormat::Small, 128), (DeltaFormat::Fast, 128)];
        for (i, instances) in [1, 7, 8, 9, 33].into_iter().enumerate() {
            let (format, size) = if all { formats[i % 4] } else { formats[1] };
            let mesh = packed(format, size);
            for slots in 1..4 {
                let pose = FIXED[if all { (i + slots as usize) % 3 } else { 1 }];
                let mode =
                    if (i as u32 + slots).is_multiple_of(4) { UpdateMode::Rebuild } else { UpdateMode::Incremental };
                let keys = if slots == 2 { KeyFormat::Bits16 } else { KeyFormat::Bits32 };
                let desc = crowd(instances, UpdateDesc { mode, ..fixed(pose, slots) });
                let [rebuilt, added, caught_up] = play_around(headless, &mesh, desc, keys, 16);
                let rebuilds = mode == UpdateMode::Rebuild || pose == PoseFormat::Rebuilt16;
                assert!(rebuilt > 0 && (instances < 7 || rebuilds == (added == 0)), "{desc:?}");
                assert!(slots == 1 || caught_up > 0, "{desc:?}");
            }
        }
    });
}

/// All groups of a mesh follow one animation: sampled and decided once, planned and updated per group.
#[test]
fn every_stream_is_animated() {
    gpu::on_every_device(|headless, _| {
        for (format, size, slots) in
            [(DeltaFormat::Fast, 64, 2), (DeltaFormat::Small, 32, 3), (DeltaFormat::Small, 64, 1)]
        {
            let mesh = packed_streams(format, size);
            for (instances, pose) in [(1, FIXED[0]), (9, FIXED[1]), (20, FIXED[0]), (20, FIXED[1])] {
                let update = fixed(pose, slots);
                let [rebuilt, ..] = play_around(headless, &mesh, crowd(instances, update), KeyFormat::Bits32, 16);
                assert!(rebuilt > 0, "{update:?}");
            }
        }
    });
}

/// Streams of very different ranges: what the device plans, what the host plans and what the processor updates are the
/// same in every group.
#[test]
fn groups_of_very_different_ranges_are_animated_alike() {
    for driver in gpu::drivers() {
        gpu::on_device(&driver, false, |headless, _| {
            let (cases, mut compared) = (testing::cases(16), 0);
            for (seed, pose) in (0..cases).flat_map(|seed| FIXED.map(|pose| (seed, pose))) {
                let format = [DeltaFormat::Small, DeltaFormat::Fast][seed as usize % 2];
                let mesh = PackedMesh::pack(&testing::uneven(seed), &PackDesc::new(format)).expect("a mesh that packs");
                let (mesh, update) = (Arc::new(mesh), fixed(pose, 2));
                // Integers cannot hold everything.
                if update.grid(mesh.layout()).is_err() {
                    continue;
                }
                let mut state = seed as u32;
                let weights = mesh.layout().targets.iter().map(|_| dice(&mut state, 2001) as f32 / 1000.0 - 1.0);
                let weights: Vec<f32> = weights.collect();
                let clips = [gpu::clip(&mesh, 30.0, weights.clone())];
                let (desc, clips) = (CrowdDesc::new(update), AnimationDesc::new(&clips));
                let mut animated = HeadlessCrowd::animated(headless, &mesh, &desc, &clips).expect("a crowd");
                animated.play(0, &Playback::new(0)).expect("a clip");
                animated.step(&[]).expect("a step");
                let mut planned = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
                planned.step(&[&weights]).expect("a step");
                let mut on_cpu = gpu::cpu_crowd(&mesh, update, 1);
                on_cpu.set_weights(0, &weights).expect("weights");
                on_cpu.update();
                for group in 0..mesh.groups().len() {
                    let expected = on_cpu.stored_pose(0, group).expect("a pose");
                    let what = format!("mesh {seed}, {format:?}, {pose:?}, group {group} on {driver}");
                    assert!(planned.read_stored(0, group).expect("a pose") == expected, "planned by the host: {what}");
                    assert!(animated.read_stored(0, group).expect("a pose") == expected, "animated: {what}");
                }
                compared += 1;
            }
            println!("{driver}: {compared} crowds of {cases} meshes are alike");
            assert!(compared > cases, "{compared} of {cases} meshes, in three formats");
        });
    }
}

/// Groups and dispatches are split where the device's limits require it.
#[test]
fn small_limits_split_the_crowd() {
    let mesh = packed(DeltaFormat::Fast, 32);
    // Sixteen instances in two slots, plus some; four items in a dispatch.
    let range = 2 * 17 * mesh.layout().base_bytes();
    let limits = gpu::baseline(|caps| (caps.max_storage_range, caps.max_workgroups) = (range, 4));
    for (driver, limits) in gpu::with_and_without_texels(&limits) {
        let wide = limits.int64 && driver == "llvmpipe";
        gpu::on_device_within(&driver, Some(limits), |headless, _| {
            let texels = wide && headless.caps().tuning.texels;
            assert_eq!(headless.caps().takes_texels(DeltaFormat::Fast), texels, "{driver}");
            for pose in FIXED {
                play_around(headless, &mesh, crowd(45, fixed(pose, 2)), KeyFormat::Bits32, 10);
            }
        });
    }
    let small = gpu::limited(limits, |caps| caps.max_storage_range = 20_000);
    gpu::on_device_within(&gpu::one(), Some(small), |headless, _| {
        let clips = clips();
        let animation = AnimationDesc::new(&clips);
        let refused = HeadlessCrowd::animated(headless, &mesh, &crowd(9, fixed(PoseFormat::Fixed16, 2)), &animation);
        testing::says(refused, &["bytes", "allows 20000"]);
    });
}

/// Both planners, and kernels that process fewer instances at once.
#[test]
fn planners_and_tiles_of_all_widths_give_the_same_poses() {
    let mesh = packed(DeltaFormat::Small, 32);
    let cases = [(1, true, FIXED[0]), (2, false, FIXED[1]), (4, false, FIXED[2]), (8, true, FIXED[1])];
    for driver in gpu::drivers_or("llvmpipe,SwiftShader") {
        for (widest_tile, plans_together, pose) in cases {
            let limits = gpu::baseline(|caps| {
                (caps.tuning.widest_tile, caps.tuning.plans_together) = (widest_tile, plans_together);
            });
            gpu::on_device_within(&driver, Some(limits), |headless, _| {
                let tuning = headless.caps().tuning;
                assert_eq!(tuning.widest_tile, widest_tile);
                // A device whose workgroups plan keeps to it.
                assert!(tuning.plans_together >= plans_together);
                play_around(headless, &mesh, crowd(21, fixed(pose, 2)), KeyFormat::Bits32, 6);
            });
        }
    }
}

/// More instances than one command can send records for, and more invocations than workgroups in a row.
#[test]
fn thousands_of_heads_start_at_once() {
    let mesh = packed(DeltaFormat::Small, 128);
    let limits = gpu::baseline(|caps| caps.max_workgroups = 60);
    gpu::on_device_within(&gpu::one(), Some(limits), |headless, _| {
        let clips = clips();
        let animation = AnimationDesc { key_format: KeyFormat::Bits16, ..AnimationDesc::new(&clips) };
        let mut scene = Scene::new(headless, &mesh, crowd(2100, fixed(PoseFormat::Fixed16, 1)), &animation);
        let mut state = 5;
        for instance in scene.instances() {
            scene.play(instance, some_playback(&mut state, 0.0));
        }
        scene.step(0.0);
        scene.step(0.7);
        [0, 2047, 2048, 2099].into_iter().for_each(|instance| scene.assert_fresh(instance));
    });
}

/// The minimum: a mesh of one block, no visible instance, no instances.
#[test]
fn one_block_and_no_head_that_is_shown() {
    let mesh = PackedMesh::pack(&testing::mesh(7, 4), &PackDesc::new(DeltaFormat::Fast)).expect("a mesh");
    assert_eq!(blocks(&mesh), 1);
    let mesh = Arc::new(mesh);
    let clips = [gpu::clip(&mesh, 10.0, (0..12).map(|i| i as f32 / 12.0).collect())];
    gpu::on_every_device(|headless, _| {
        for instances in [1, 3] {
            let desc = crowd(instances, fixed(PoseFormat::Fixed16, 2));
            let mut scene = Scene::new(headless, &mesh, desc, &AnimationDesc::new(&clips));
            let set_hidden = |scene: &mut Scene, hidden| scene.instances().for_each(|i| scene.hide(i, hidden));
            set_hidden(&mut scene, true);
            assert!(scene.step(0.0).0.is_empty() && scene.crowd.read_pose(0).is_err());
            set_hidden(&mut scene, false);
            scene.instances().for_each(|i| scene.play(i, Playback::new(0)));
            assert_eq!(scene.step(0.05).0.len(), instances as usize);
            scene.instances().for_each(|i| scene.assert_fresh(i));
            let pose = scene.crowd.read_stored(0, 0).expect("a pose");
            set_hidden(&mut scene, true);
            assert!(scene.step(0.15).0.is_empty() && scene.step(0.16).0.is_empty());
            assert!(pose == scene.crowd.read_stored(0, 0).expect("a pose"), "a hidden head keeps its pose");
            scene.instances().for_each(|i| scene.remove(i));
            assert!(scene.step(0.2).0.is_empty());
            let added = scene.add();
            assert_eq!(scene.step(0.25).0.len(), 1);
            scene.assert_fresh(added);
        }
    });
}

/// Recorded commands depend on the slots, and on whether playback changes, but not on the values.
#[test]
fn the_same_is_recorded_whatever_changes_and_an_idle_crowd_is_no_work() {
    let mesh = packed(DeltaFormat::Fast, 64);
    gpu::on_every_device(|headless, _| {
        let clips = clips();
        let animation = AnimationDesc::new(&clips);
        let mut scene = Scene::new(headless, &mesh, crowd(9, fixed(PoseFormat::Fixed16, 2)), &animation);
        let (first, still) = scene.step(0.0);
        let (second, _) = scene.step(0.0);
        assert_eq!((first.len(), second.len()), (9 * blocks(&mesh), 9 * blocks(&mesh)), "both slots are filled");
        let (idle, idle_again) = (scene.step(0.0), scene.step(0.1));
        assert!(idle.0.is_empty() && idle_again.0.is_empty(), "nothing plays");
        assert_eq!(idle.1, still);
        for instance in 0..9 {
            scene.play(instance, Playback::new(1));
        }
        let (_, with_records) = scene.step(1.0);
        assert_eq!(with_records.len(), still.len() + 3);
        let (busy, commands) = scene.step(1.1);
        let changed = busy.values().filter(|work| !work.3.is_empty()).count();
        assert!(changed > 4 * blocks(&mesh), "{changed} blocks");
        assert_eq!(scene.step(1.2).1.len(), commands.len());
        assert_eq!(scene.step(1.3).1, commands);
        assert_eq!(commands.len(), still.len());
    });
}
