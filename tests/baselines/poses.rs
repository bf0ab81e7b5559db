//! The techniques of others, each against the float64 reference, on real drivers: poses, sums, bytes.

use crate::baselines::{can_read, descs, for_every_desc, history, keep_supported};
use crate::data;
use crate::gpu::{self, NORMAL, POSITION, in_eight_chunks, on_every_device, packed, single};
use deltamorph::import::{csv, obj};
use deltamorph::reference::{compare, evaluate};
use deltamorph::{
    BatchSize, CpuCrowd, DeltaFormat, MorphEngine, MorphMesh, PackedMesh, PoseFormat, Tolerance, UpdateDesc,
    UpdateMode, UpdatePath, testing,
};
use deltamorph_headless::{Headless, HeadlessCrowd, PoseUpload};
use std::sync::Arc;

/// Play a history and compare every pose and previous pose with the reference.
pub fn check(headless: &Headless, mesh: &PackedMesh, desc: UpdateDesc, seed: u32) {
    let mut crowd = HeadlessCrowd::new(headless, mesh, &single(desc)).expect("a crowd");
    let bound = POSITION * f64::from(mesh.layout().diagonal.max(1.0));
    let mut before: Option<Vec<f64>> = None;
    for (frame, weights) in history(mesh, &desc, seed).iter().enumerate() {
        crowd.step(&[weights]).expect("a step");
        crowd.draw(1).expect("a draw");
        if !can_read(headless, &desc) {
            let text = crowd.read_pose(0).expect_err("no way to capture").to_string();
            assert!(text.contains("vertexPipelineStoresAndAtomics") && text.contains("transform_feedback"), "{text}");
            continue;
        }
        let reference = gpu::reference(mesh, &desc, weights);
        let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
        let context =
            || format!("{} {desc:?} {:?} frame {frame}: {error:?}", headless.caps().name, mesh.layout().format);
        assert!(error.within(bound, NORMAL), "{}", context());
        match crowd.read_previous_pose(0).expect("a device that works") {
            Some(previous) => {
                let error = compare(&previous, before.as_ref().unwrap_or(&reference));
                assert!(error.within(bound, NORMAL), "previous pose: {error:?}, {}", context());
            }
            None => assert!(
                desc.path.evaluates_in_draws()
                    || desc.slots == 1
                    || (desc.slots == 2 && desc.path == UpdatePath::VertexStore),
                "{}",
                context()
            ),
        }
        before = Some(reference);
    }
}

#[test]
fn every_baseline_equals_the_reference() {
    on_every_device(|headless, engine| {
        for_every_desc(engine, &testing::mesh(1000, 37), |mesh, desc| check(headless, mesh, desc, 5));
    });
}

#[test]
fn degenerate_meshes_and_empty_targets() {
    on_every_device(|headless, engine| {
        for mesh in testing::degenerate() {
            for_every_desc(engine, &mesh, |mesh, desc| {
                if desc.slots == 2 {
                    check(headless, mesh, desc, 2);
                }
            });
        }
    });
}

#[test]
fn chunks() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::DENSE {
            let mesh = in_eight_chunks(&testing::mesh(1000, 37), format);
            for desc in descs(engine, format) {
                check(headless, &mesh, desc, 4);
            }
        }
    });
}

#[test]
fn small_limits_are_kept_or_refused_with_the_numbers() {
    for driver in gpu::drivers() {
        let whole = gpu::caps(&driver);
        let within = |limits, test: &dyn Fn(&Headless, &MorphEngine)| {
            gpu::on_device_within(&driver, Some(limits), test);
        };
        // More workgroups than a dispatch has: one thread a record, of which there are hundreds a target.
        within(gpu::limited(whole.clone(), |caps| caps.max_workgroups = 3), &|headless, engine| {
            for_every_desc(engine, &testing::mesh(1000, 9), |mesh, desc| {
                if desc.slots == 2 {
                    check(headless, mesh, desc, 3);
                }
            });
        });
        within(gpu::limited(whole, |caps| caps.max_storage_range = 40_000), &|headless, engine| {
            let mesh = packed(engine, &testing::mesh(1000, 9), DeltaFormat::Small);
            let desc = single(UpdateDesc::new(UpdatePath::Scatter, BatchSize::All));
            let text = HeadlessCrowd::new(headless, &mesh, &desc).err().expect("refused").to_string();
            assert!(text.contains("the records of 'scatter' take") && text.contains("allows 40000"), "{text}");
        });
    }
}

#[test]
fn crowds() {
    on_every_device(|headless, engine| {
        for_every_desc(engine, &testing::mesh(200, 11), |mesh, update| {
            let desc = single(update).instances(3);
            let mut crowd = HeadlessCrowd::new(headless, mesh, &desc).expect("a crowd");
            let histories: Vec<_> = (0..3).map(|i| history(mesh, &update, i)).collect();
            for frame in 0..6 {
                let weights: Vec<&[f32]> = (0..3).map(|i| histories[i][(frame * (i + 1)) % 8].as_slice()).collect();
                crowd.step(&weights).expect("a step");
                crowd.draw(1).expect("a draw");
                for (i, weights) in weights.iter().enumerate().filter(|_| can_read(headless, &update)) {
                    let reference = gpu::reference(mesh, &update, weights);
                    let error = compare(&crowd.read_pose(i as u32).expect("a pose"), &reference);
                    assert!(error.within(POSITION * 40.0, NORMAL), "{update:?} head {i} frame {frame}: {error:?}");
                }
            }
        });
    });
}

/// Weights set while a head is hidden are not drawn until it is shown, whatever other heads do meanwhile.
#[test]
fn hidden_heads_come_back_with_the_weights_set_meanwhile() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, &testing::mesh(300, 12), DeltaFormat::Float32);
        let bound = POSITION * f64::from(mesh.layout().diagonal.max(1.0));
        // None more than a draw may have attributes for.
        let [first, meant, other] = [[0.5, 0.0], [-0.25, 1.0], [0.0, 0.75]].map(|w| [&w[..], &[0.0; 10]].concat());
        for desc in descs(engine, DeltaFormat::Float32).into_iter().filter(|desc| can_read(headless, desc)) {
            if desc.batch == BatchSize::Targets(1) {
                continue;
            }
            let desc = single(desc).instances(2);
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
            crowd.step(&[&first, &first]).expect("a step");
            crowd.set_hidden(0, true).expect("an instance");
            crowd.step(&[&meant, &other]).expect("a step");
            crowd.set_hidden(0, false).expect("an instance");
            for weights in [[&first, &other], [&meant, &other]] {
                crowd.step(&weights.map(|w| &w[..])).expect("a step");
                crowd.draw(1).expect("a draw");
                for (instance, weights) in (0..).zip(weights) {
                    let reference = gpu::reference(&mesh, &desc.update, weights);
                    let error = compare(&crowd.read_pose(instance).expect("a pose"), &reference);
                    assert!(error.within(bound, NORMAL), "{} {desc:?} {instance}: {error:?}", headless.caps().name);
                }
                let (_, dropped) = crowd.record(&[&other, &first]).expect("a recording");
                crowd.discard(dropped.ticket).expect("a ticket of this crowd");
            }
        }
    });
}

/// The sums that atomics add up in any order are the integers of fixed32 poses, and rounding weights to the grid moves
/// no component further than half a weight step times Σ |delta|.
#[test]
fn scattered_sums_are_those_of_fixed32_poses() {
    on_every_device(|headless, engine| {
        let mesh = Arc::new(packed(engine, &testing::mesh(700, 23), DeltaFormat::Small));
        let update = UpdateDesc::new(UpdatePath::Scatter, BatchSize::All);
        let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(update)).expect("a crowd");
        let exact = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All).pose(PoseFormat::Fixed32);
        let mut reference = CpuCrowd::new(mesh.clone(), exact, 1, 1).expect("a crowd");
        let grid = exact.grid(mesh.layout()).expect("a grid").expect("integers");
        let mut reach = vec![0.0f64; mesh.layout().vertex_count * 6];
        for target in 0..23 {
            mesh.for_each_delta(target, |vertex, delta| {
                (0..6).for_each(|c| reach[vertex * 6 + c] += delta[c].abs());
            });
        }
        for weights in history(&mesh, &update, 8) {
            crowd.step(&[&weights]).expect("a step");
            reference.set_weights(0, &weights).expect("weights");
            reference.update();
            let sums = crowd.read_sums(0).expect("a device that works").expect("sums");
            assert_eq!(sums, PoseFormat::Fixed32.integers(reference.stored_pose(0, 0).expect("an instance")));
            let (pose, unrounded) = (crowd.read_pose(0).expect("a pose"), evaluate(&mesh, &weights));
            for ((got, want), reach) in pose.iter().zip(&unrounded).zip(&reach) {
                let rounding = 4.0 * f64::from(f32::EPSILON) * (want.abs() + reach);
                let bound = 0.5 * f64::from(grid.weight_step()) * reach + rounding;
                assert!((f64::from(*got) - want).abs() <= bound, "{got} for {want}, {bound:e} allowed");
            }
        }
        let too_large = vec![grid.weight_max * 1.01; 23];
        assert!(crowd.step(&[&too_large]).is_err(), "a weight that could overflow");
    });
}

#[test]
fn bytes_are_those_that_kernels_load_and_store() {
    on_every_device(|headless, engine| {
        let weights = [0.0, 0.5, 1.0, 0.0, -1.0, 0.0, 0.0];
        for_every_desc(engine, &testing::mesh(300, 7), |mesh, desc| {
            let vertices = mesh.layout().padded_vertices() as u64;
            let mut crowd = HeadlessCrowd::new(headless, mesh, &single(desc)).expect("a crowd");
            let stats = crowd.step(&[&weights]).expect("a step").update.stats;
            let (stride, passes) = (mesh.layout().format.stride() as u64, stats.passes as u64);
            let mut deltas = 0;
            for target in [1, 2, 4] {
                mesh.for_each_delta(target, |_, delta| deltas += u64::from(delta != [0.0; 6]));
            }
            let (moved, floor) = match desc.path {
                // Each pass: a pose in, a pose out, and its deltas.
                UpdatePath::VertexStore => (vertices * (48 * passes + 3 * stride), vertices * (48 + 3 * stride)),
                // Clear, six atomics a record, resolve.
                UpdatePath::Scatter => (vertices * (24 + 72) + deltas * (16 + 48), vertices * 48 + deltas * 16),
                // Deltas, and displacements blended; rectangles have texels besides that the target does not move, and
                // all texels are cleared, of which there are as many as vertices at least. Draws are not counted.
                UpdatePath::Texture => {
                    let (delta, texels) = (if stride == 12 { 16 } else { 32 }, deltas..=deltas + vertices);
                    let of = |texels: u64| texels * (delta + 64);
                    let moved = of(*texels.start()) + 32..=of(*texels.end()) + 32 * (2 * vertices + 2);
                    assert!(moved.contains(&stats.bytes_moved), "{moved:?}, {stats:?}");
                    let floor = deltas * delta + 64..=of(*texels.end());
                    assert!(floor.contains(&stats.bytes_floor), "{floor:?}, {stats:?}");
                    assert_eq!(crowd.step(&[&weights]).expect("a step").update.stats.bytes_moved, 0);
                    // One target changes: a delta weight, without clearing.
                    let mut changed = weights;
                    changed[1] += 0.25;
                    let one = crowd.step(&[&changed]).expect("a step").update.stats;
                    if desc.mode == UpdateMode::Incremental {
                        assert_eq!((one.coefficients, one.rebuilt), (1, 0));
                        assert!(one.bytes_moved < stats.bytes_moved / 2, "{one:?} after {stats:?}");
                    } else {
                        assert_eq!((one.coefficients, one.bytes_moved), (3, stats.bytes_moved));
                    }
                    return;
                }
                // Of one draw, which looks no further than the last active target.
                UpdatePath::Direct => (vertices * (24 + 3 * stride) + 5 * 8, vertices * (24 + 3 * stride)),
                _ => (vertices * (24 + 3 * stride), vertices * (24 + 3 * stride)),
            };
            assert_eq!((stats.bytes_moved, stats.bytes_floor), (moved, floor), "{desc:?}");
            assert_eq!(stats.coefficients, 3, "{desc:?}");
            let still = crowd.step(&[&weights]).expect("a step").update.stats;
            let drawn = if desc.path.evaluates_in_draws() { moved } else { 0 };
            assert_eq!(still.bytes_moved, drawn, "{desc:?}: draws go on, updates do not");
        });
    });
}

#[test]
fn an_altered_delta_gives_a_wrong_pose() {
    let right = testing::mesh(500, 20);
    let mut wrong = right.clone();
    wrong.targets[13].positions[77].y += 1e-3 * wrong.diagonal;
    let mut weights = [0.0; 20];
    (weights[5], weights[13]) = (0.5, 1.0);
    on_every_device(|headless, engine| {
        for_every_desc(engine, &wrong, |faulty, desc| {
            if desc.slots == 2 && can_read(headless, &desc) {
                let reference = evaluate(&packed(engine, &right, faulty.layout().format), &weights);
                let mut crowd = HeadlessCrowd::new(headless, faulty, &single(desc)).expect("a crowd");
                crowd.step(&[&weights]).expect("a step");
                let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
                assert!(!error.within(POSITION * f64::from(right.diagonal), NORMAL), "{desc:?}: the fault went unseen");
            }
        });
    });
}

#[test]
fn poses_of_the_cpu_path_are_uploaded_as_they_are() {
    on_every_device(|headless, engine| {
        let mesh = Arc::new(packed(engine, &testing::mesh(400, 9), DeltaFormat::Fast));
        let desc = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
        let mut crowd = CpuCrowd::new(mesh.clone(), desc, 2, 1).expect("a crowd");
        let mut upload = PoseUpload::new(headless, mesh.layout(), 2).expect("buffers");
        for frame in 0..3 {
            for head in 0..2 {
                crowd.set_weights(head, &gpu::weights(&mesh, frame, head)).expect("weights");
            }
            crowd.update();
            let poses = [0, 1].map(|i| crowd.pose(i).expect("an instance"));
            let poses = poses.each_ref().map(|pose| &**pose);
            let took = upload.upload(&poses).expect("an upload");
            assert_eq!(took.bytes_moved, 2 * 4 * mesh.layout().base_bytes());
            upload.draw().expect("a draw");
            assert_eq!(upload.read().expect("poses"), poses.concat());
        }
        assert!(
            upload.upload(&[&crowd.pose(0).expect("an instance")]).is_err()
                && PoseUpload::new(headless, mesh.layout(), 0).is_err()
        );
    });
}

/// Real meshes with a few frames of a captured clip: name, mesh, and weights.
pub fn real() -> impl Iterator<Item = (&'static str, MorphMesh, Vec<Vec<f32>>)> {
    let sets = [
        ("facecap_head_glb", "facecap_30fps.csv"),
        ("ict_facekit", "facecap_30fps.csv"),
        ("morph_stress_test", "TheWave_24fps.csv"),
    ];
    sets.into_iter().filter_map(|(set, clip)| {
        let folder = data::set(set)?;
        let source = obj::import_folder(&folder).expect("a folder that imports");
        let kept = source.to_mesh(Tolerance::default()).expect("a mesh");
        let clip = csv::read(&folder.join("weights").join(clip), None).expect("a clip");
        let names: Vec<&str> = kept.targets.iter().map(|t| t.name.as_str()).collect();
        let bound = clip.bind(&names).expect("columns that name targets");
        let few = bound.frames().step_by((bound.frame_count() / 3).max(1)).collect();
        Some((set, kept, few))
    })
}

#[test]
fn real_sets() {
    for (set, kept, frames) in real() {
        on_every_device(|headless, engine| {
            for_every_desc(engine, &kept, |mesh, desc| {
                if desc.slots != 2 || !can_read(headless, &desc) {
                    return;
                }
                let mut crowd = HeadlessCrowd::new(headless, mesh, &single(desc)).expect("a crowd");
                for weights in &frames {
                    let mut weights = weights.clone();
                    keep_supported(&mut weights, &desc);
                    crowd.step(&[&weights]).expect("a step");
                    let reference = gpu::reference(mesh, &desc, &weights);
                    let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
                    let bound = POSITION * f64::from(kept.diagonal);
                    assert!(error.within(bound, NORMAL), "{set} {desc:?} {:?}: {error:?}", mesh.layout().format);
                }
            });
        });
    }
}
