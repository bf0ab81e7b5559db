//! Real meshes and captured clips: the project's limits of errors, bits, bytes and memory.

use crate::prelude::*;
use deltamorph::UpdateStats;

fn pack(mesh: &KeptMesh, format: DeltaFormat) -> Arc<PackedMesh> {
    Arc::new(PackedMesh::pack(mesh, &PackDesc::new(format)).expect("a mesh that packs"))
}

/// Combinations of delta formats, pose formats and numbers of slots. Whole clips of all 24 take minutes (`.ci/deep`
/// plays them); proptests in src/cpu, tests/techniques/poses.rs and tests/updates/integers.rs cover the rest.
fn blocks() -> Vec<(DeltaFormat, UpdateDesc)> {
    let all = [
        (DeltaFormat::Fast, PoseFormat::Float32, 2),
        (DeltaFormat::Fast, PoseFormat::Fixed32, 3),
        (DeltaFormat::Fast, PoseFormat::Fixed16, 2),
        (DeltaFormat::Small, PoseFormat::Float32, 1),
        (DeltaFormat::Small, PoseFormat::Fixed32, 1),
        (DeltaFormat::Small, PoseFormat::Fixed16, 2),
    ];
    let of = |(format, pose, slots)| (format, UpdateDesc { pose, slots, ..UpdateDesc::blocks() });
    all.into_iter().map(of).chain([rebuilt()]).collect()
}

fn rebuilt() -> (DeltaFormat, UpdateDesc) {
    (DeltaFormat::Small, UpdateDesc { pose: PoseFormat::Rebuilt16, ..UpdateDesc::blocks() })
}

/// The smallest and largest batches of the dense paths.
fn dense(engine: &MorphEngine) -> Vec<(DeltaFormat, UpdateDesc)> {
    let mut all = vec![];
    for format in DeltaFormat::DENSE {
        for path in [UpdatePath::Feedback, UpdatePath::Compute] {
            let most = engine.caps().batch_max(path, format).expect("a largest batch");
            all.extend([1, most].map(|batch| (format, UpdateDesc::new(path, BatchSize::Targets(batch)))));
        }
        all.push((format, UpdateDesc::new(UpdatePath::Compute, BatchSize::All)));
    }
    all
}

/// Plays each `every`-th frame of a clip on lavapipe and on the CPU: every 20th of these and the last are within the
/// path's error limits.
fn clip_in(updates: fn(&MorphEngine) -> Vec<(DeltaFormat, UpdateDesc)>, set: &str, clip: &str, every: usize) {
    let Some((mesh, frames)) = data::face(set, clip) else { return };
    let frames: Vec<_> = frames.into_iter().step_by(every).collect();
    let diagonal = f64::from(mesh.diagonal);
    gpu::on_device(&gpu::one(), false, |headless, engine| {
        // Each format once: it takes longer than to play some of the frames.
        let mut packed_in = HashMap::new();
        for (format, desc) in updates(engine) {
            let packed = packed_in.entry(format).or_insert_with(|| pack(&mesh, format)).clone();
            let mut crowd = gpu::crowd(headless, &packed, desc);
            let mut cpu = gpu::cpu_crowd(&packed, desc, 1);
            for (i, weights) in frames.iter().enumerate() {
                let stats = crowd.step(&[weights]).expect("a step").update.stats;
                cpu.set_weights(0, weights).expect("weights that fit");
                let on_cpu = cpu.update();
                if format.is_blocks() {
                    let planned =
                        |s: UpdateStats| (s.coefficients, s.dirty_blocks, s.passes, s.rebuilt_blocks, s.bound);
                    assert_eq!(planned(on_cpu), planned(stats), "{format:?} {desc:?} frame {i}: the same plan on both");
                    // Copies of blocks have a row on the device, of some entry.
                    assert!(on_cpu.bytes_floor <= stats.bytes_floor, "{format:?} {desc:?} frame {i}");
                }
                if i % 20 != 0 && i + 1 != frames.len() {
                    continue;
                }
                let reference = gpu::reference(&packed, &desc, weights);
                let bound = |stats: UpdateStats| {
                    if desc.pose.has_integers() {
                        return 1e-7 * diagonal;
                    }
                    if !format.is_blocks() {
                        return gpu::POSITION * diagonal;
                    }
                    assert!(stats.bound <= desc.tolerance * mesh.diagonal);
                    f64::from(stats.bound)
                };
                let pose = crowd.read_pose(0).expect("a pose");
                let by_cpu = packed.layout().to_user_order(&cpu.pose(0).expect("an instance"));
                for (pose, stats) in [(&pose, stats), (&by_cpu, on_cpu)] {
                    let error = compare(pose, &reference);
                    let what = format!("{set}/{clip} {format:?} {desc:?} frame {i}: {error:?}");
                    assert!(error.within(bound(stats), gpu::NORMAL), "{what}");
                }
                if desc.pose.has_integers() {
                    let stored = crowd.read_stored(0, 0).expect("a pose");
                    assert!(stored == cpu.stored_pose(0, 0).expect("an instance"), "{desc:?} frame {i}");
                    assert!(pose == by_cpu, "{desc:?} frame {i}: decoded poses");
                }
            }
        }
    });
}

#[test]
fn facecap_head_plays_the_captured_take() {
    clip_in(|_| blocks(), "facecap_head_glb", "facecap_30fps.csv", 1);
}

#[test]
fn facecap_head_plays_the_captured_take_on_dense_paths() {
    clip_in(dense, "facecap_head_glb", "facecap_30fps.csv", 1);
}

#[test]
fn ict_facekit_plays_the_captured_take() {
    clip_in(|_| blocks(), "ict_facekit", "facecap_30fps.csv", 1);
}

#[test]
fn aura_rebuilt_plays_its_clip_in_poses_that_are_rounded_once() {
    clip_in(|_| vec![rebuilt()], "aura_rebuilt", "compskin_30fps.csv", 40);
}

/// Checks the bytes that the formats `fast` and `small`, and `small` with 16-bit poses, move over a whole clip, as
/// fractions of a dense update in float32: the changed targets, and a pose read and written, all vertices of each.
fn bytes(set: &str, clip: &str, fast: f64, small: f64, fixed16: f64) {
    let Some((mesh, frames)) = data::face(set, clip) else { return };
    let rest = vec![0.0; mesh.targets.len()];
    let changed = |i: usize| {
        let before = if i == 0 { &rest } else { &frames[i - 1] };
        before.iter().zip(&frames[i]).filter(|(a, b)| a != b).count()
    };
    let whole_poses = (0..frames.len()).map(|i| if changed(i) > 0 { changed(i) + 2 } else { 0 }).sum::<usize>();
    let dense = (whole_poses * mesh.vertex_count() * 24) as f64;
    let packed = [DeltaFormat::Fast, DeltaFormat::Small].map(|format| (format, pack(&mesh, format)));
    for ((format, packed), pose, most) in [
        (&packed[0], PoseFormat::Float32, fast),
        (&packed[1], PoseFormat::Float32, small),
        (&packed[1], PoseFormat::Fixed16, fixed16),
    ] {
        let desc = UpdateDesc { pose, ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
        let mut crowd = gpu::cpu_crowd(packed, desc, 1);
        let mut moved = 0;
        for weights in &frames {
            crowd.set_weights(0, weights).expect("weights that fit");
            moved += crowd.update().bytes_moved;
        }
        let share = moved as f64 / dense;
        println!(
            "{set}/{clip} {format:?} {pose:?}: {:.3}% of {:.2} MB",
            share * 100.0,
            dense / frames.len() as f64 / 1e6
        );
        assert!(share <= most, "{set}/{clip} {format:?} {pose:?}: {share}");
    }
}

#[test]
fn few_bytes_are_moved() {
    bytes("ict_facekit", "facecap_30fps.csv", 0.182, 0.107, 0.075);
    bytes("ict_facekit", "facegood_2_01_mapped_30fps.csv", 0.37, 0.3, 0.17);
    bytes("makehuman_face", "facecap_30fps.csv", 0.079, 0.043, 0.028);
    bytes("makehuman_face", "facegood_2_02_mapped_30fps.csv", 0.14, 0.103, 0.058);
}

#[test]
fn the_small_format_is_small() {
    for (set, clip, most) in [
        ("ict_facekit", "facecap_30fps.csv", 0.036),
        ("makehuman_face", "facecap_30fps.csv", 0.0103),
        ("facecap_head_glb", "facecap_30fps.csv", 0.047),
    ] {
        let Some((mesh, _)) = data::face(set, clip) else { continue };
        let packed = pack(&mesh, DeltaFormat::Small);
        let (layout, error) = (packed.layout(), packed.measure_error(&mesh));
        let dense = (mesh.vertex_count() * mesh.targets.len() * 24) as f64;
        let share = (layout.delta_bytes() + layout.index_bytes()) as f64 / dense;
        let position = error.position / f64::from(mesh.diagonal);
        println!("{set}: {:.2}% of dense float32, {position:.1e}, {:.2}°", share * 100.0, error.normal_degrees);
        assert!(share <= most && position <= 1e-5 && error.normal_degrees <= 0.5, "{set}: {share} {error:?}");
    }
}

#[test]
fn an_error_budget_saves_bytes_under_sensor_noise_and_holds() {
    let Some((mesh, frames)) = data::face("ict_facekit", "facegood_2_01_mapped_30fps.csv") else { return };
    let packed = pack(&mesh, DeltaFormat::Small);
    let budget = 1e-4 * mesh.diagonal;
    let mut moved = vec![];
    for error_budget in [0.0, budget] {
        let desc = UpdateDesc { error_budget, ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
        let mut crowd = gpu::cpu_crowd(&packed, desc, 1);
        let (mut rng, mut sum) = (Rng::new(7, 0), 0);
        for (i, weights) in frames.iter().take(500).enumerate() {
            let weights: Vec<f32> = weights.iter().map(|w| w + 0.0005 * rng.range(-1.0, 1.0)).collect();
            crowd.set_weights(0, &weights).expect("weights that fit");
            sum += crowd.update().bytes_moved;
            if error_budget > 0.0 && i % 20 == 0 {
                let pose = packed.layout().to_user_order(&crowd.pose(0).expect("an instance"));
                let error = compare(&pose, &evaluate(&packed, &weights));
                assert!(error.position <= f64::from(budget), "frame {i}: {error:?}");
            }
        }
        moved.push(sum as f64);
    }
    println!("with the budget {:.2} times fewer bytes", moved[0] / moved[1]);
    assert!(moved[0] >= 4.0 * moved[1], "{moved:?}");
}
