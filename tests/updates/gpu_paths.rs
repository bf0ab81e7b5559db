//! Every GPU path, batch size and format against the float64 reference, on real drivers.

use crate::gpu::{self, NORMAL, POSITION, in_eight_chunks, is_kept, on_every_device, single, update_descs, weights};
use deltamorph::reference::compare;
use deltamorph::{
    CpuCrowd, DeltaFormat, DeviceCaps, MorphEngine, PackDesc, PackedMesh, TransformFeedbackCaps, UpdateDesc,
    UpdateMode, UpdatePath, testing,
};
use deltamorph_headless::{Headless, HeadlessCrowd};
use std::slice::from_mut;

fn packed(engine: &MorphEngine, vertices: usize, targets: usize, format: DeltaFormat) -> PackedMesh {
    gpu::packed(engine, &testing::mesh(vertices, targets), format)
}

/// Play `frames` frames of changing weights and compare every pose and previous pose.
fn check(headless: &Headless, mesh: &PackedMesh, desc: UpdateDesc, frames: u32) {
    let mut crowd = HeadlessCrowd::new(headless, mesh, &single(desc)).expect("a crowd");
    let bound = POSITION * f64::from(mesh.layout().diagonal.max(1.0));
    let mut before: Option<Vec<f64>> = None;
    for frame in 0..frames {
        let weights = weights(mesh, frame, 5);
        crowd.step(&[&weights]).expect("a step");
        let reference = gpu::reference(mesh, &desc, &weights);
        let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
        let context =
            || format!("{} {desc:?} {:?} frame {frame}: {error:?}", headless.caps().name, mesh.layout().format);
        assert!(error.within(bound, NORMAL), "{}", context());
        let previous = crowd.read_previous_pose(0).expect("a device that works");
        if let Some(previous) = previous {
            let expected = before.as_ref().unwrap_or(&reference);
            let error = compare(&previous, expected);
            assert!(error.within(bound, NORMAL), "previous pose: {error:?}, {}", context());
        } else {
            assert!(desc.slots == 1 || (desc.slots == 2 && !desc.path.works_in_place()), "{}", context());
        }
        before = Some(reference);
    }
}

#[test]
fn every_path_batch_and_format_equals_the_reference() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::ALL {
            // No multiple of a workgroup, and more targets than any batch.
            let mesh = packed(engine, 1000, 37, format);
            for desc in update_descs(engine, format) {
                check(headless, &mesh, desc, 6);
            }
        }
    });
}

#[test]
fn modes_and_slot_counts() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Snorm16, DeltaFormat::Fast, DeltaFormat::Small] {
            let mesh = packed(engine, 321, 19, format);
            for desc in update_descs(engine, format) {
                for slots in [1, 3] {
                    for mode in [UpdateMode::Incremental, UpdateMode::Rebuild] {
                        let desc = desc.slots(slots).mode(mode);
                        if desc.check().is_ok() {
                            check(headless, &mesh, desc, 5);
                        }
                    }
                }
            }
        }
    });
}

#[test]
fn degenerate_meshes_and_empty_targets() {
    on_every_device(|headless, engine| {
        for mesh in testing::degenerate() {
            for format in DeltaFormat::ALL {
                let mesh = gpu::packed(engine, &mesh, format);
                for desc in update_descs(engine, format) {
                    check(headless, &mesh, desc, 3);
                }
            }
        }
    });
}

#[test]
fn meshes_beyond_the_storage_range_are_cut_into_chunks() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::DENSE {
            let mesh = in_eight_chunks(&testing::mesh(1000, 37), format);
            for desc in update_descs(engine, format) {
                check(headless, &mesh, desc, 4);
            }
        }
    });
}

/// No limits but the device's own.
fn roomy() -> DeviceCaps {
    gpu::baseline(|caps| {
        caps.max_storage_range = u64::MAX;
        caps.max_texels = u32::MAX;
        caps.max_allocation = u64::MAX;
        caps.max_storage_buffers = u32::MAX;
        caps.max_push_constants = u32::MAX;
        caps.max_vertex_attributes = u32::MAX;
        caps.max_vertex_bindings = u32::MAX;
        caps.max_workgroup_invocations = u32::MAX;
        caps.max_workgroups = u32::MAX;
        caps.transform_feedback = Some(TransformFeedbackCaps { max_buffer_bytes: u64::MAX, max_stride: u32::MAX });
        caps.vertex_stores = true;
        caps.int64 = true;
    })
}

/// Run `test` on every driver with one limit.
fn within(limit: impl FnOnce(&mut DeviceCaps), test: impl Fn(&Headless, &MorphEngine)) {
    let limits = gpu::limited(roomy(), limit);
    for driver in gpu::drivers() {
        gpu::on_device_within(&driver, Some(limits.clone()), &test);
    }
}

#[test]
fn more_workgroups_than_a_dispatch_has() {
    within(
        |caps| caps.max_workgroups = 3,
        |headless, engine| {
            for format in DeltaFormat::ALL {
                let mesh = packed(engine, 1000, 19, format);
                assert!(format.is_blocks() || mesh.layout().chunks().count() == 6);
                for desc in update_descs(engine, format) {
                    check(headless, &mesh, desc, 3);
                }
            }
        },
    );
}

#[test]
fn limits_are_kept_or_refused_with_the_numbers() {
    let refuse = |path: UpdatePath, limit: fn(&mut DeviceCaps), words: &[&str]| {
        within(limit, |headless, _| {
            if headless.caps().check_path(UpdatePath::Feedback).is_err() && path == UpdatePath::Feedback {
                return;
            }
            let mesh = PackedMesh::pack(&testing::mesh(1000, 5), &PackDesc::default()).expect("a mesh");
            let desc = UpdateDesc::new(path, deltamorph::BatchSize::Targets(1));
            let error = HeadlessCrowd::new(headless, &mesh, &single(desc)).err().expect("refused").to_string();
            assert!(words.iter().all(|w| error.contains(w)), "{error}");
        });
    };
    // 1,024 padded vertices of 24 bytes; five targets of them.
    let compute = |limit, words: &[&str]| refuse(UpdatePath::Compute, limit, words);
    compute(|caps| caps.max_storage_range = 10_000, &["a pose takes 24576 bytes", "allows 10000"]);
    compute(|caps| caps.max_storage_range = 50_000, &["a chunk of deltas takes 122880 bytes", "pack_desc"]);
    compute(|caps| caps.max_workgroups = 15, &["a chunk takes 16 workgroups", "allows 15", "pack_desc"]);
    compute(
        |caps| caps.max_allocation = 100_000,
        &["deltamorph deltas of mesh 'test_1000x5' needs 122880 bytes", "100000"],
    );
    compute(|caps| caps.max_workgroup_invocations = 32, &["32 invocations per workgroup", "'cpu'"]);
    refuse(
        UpdatePath::Feedback,
        |caps| {
            caps.transform_feedback = Some(TransformFeedbackCaps { max_buffer_bytes: 20_000, max_stride: 512 });
        },
        &["a chunk captures 24576 bytes", "allows 20000", "pack_desc"],
    );
}

#[test]
fn a_crowd_of_heads_in_one_recording() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Float32, DeltaFormat::Fast, DeltaFormat::Small, DeltaFormat::Pair] {
            let mesh = packed(engine, 200, 11, format);
            for update in update_descs(engine, format) {
                let desc = single(update).instances(3);
                let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
                for frame in 0..4 {
                    let weights: Vec<Vec<f32>> = (0..3).map(|i| weights(&mesh, frame * i, i)).collect();
                    crowd.step(&weights.iter().map(Vec::as_slice).collect::<Vec<_>>()).expect("a step");
                    for i in 0..3 {
                        let reference = gpu::reference(&mesh, &update, &weights[i as usize]);
                        let error = compare(&crowd.read_pose(i).expect("a pose"), &reference);
                        assert!(
                            error.within(POSITION * 40.0, NORMAL),
                            "{update:?} instance {i} frame {frame}: {error:?}"
                        );
                    }
                    crowd.draw(1).expect("a draw");
                }
            }
        }
    });
}

#[test]
fn passes_are_the_coefficients_over_the_batch_size_and_a_still_face_records_nothing() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, 100, 57, DeltaFormat::Snorm16);
        for desc in update_descs(engine, DeltaFormat::Snorm16) {
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
            let mut weights = vec![0.25; 57];
            let mut passes = |weights: &[f32]| crowd.step(&[weights]).expect("a step").update.stats;
            assert_eq!(passes(&weights).passes, desc.batch.passes(57));
            weights[40] = 0.5;
            let one = passes(&weights);
            assert_eq!((one.coefficients, one.passes), (1, 1), "{desc:?}");
            weights[3..12].fill(-1.0);
            let nine = passes(&weights);
            assert_eq!((nine.coefficients, nine.passes), (9, desc.batch.passes(9)), "{desc:?}");
            let mut still = passes(&weights);
            assert_eq!(std::mem::take(&mut still.bound), nine.bound, "{desc:?}");
            assert_eq!(still, deltamorph::UpdateStats::default(), "{desc:?}");
            // SAFETY: nothing is changed.
            let step = unsafe {
                HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&weights], |entries| assert!(entries.is_empty()))
            };
            assert_eq!(step.expect("a step").0.update.stats.bytes_moved, 0);
        }
    });
}

/// A face that stops: once what waited has settled, nothing is recorded, and there is no motion left to blur.
#[test]
fn a_face_that_stops_has_its_pose_as_previous_pose() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, 300, 11, DeltaFormat::Small);
        for desc in update_descs(engine, DeltaFormat::Small) {
            for (slots, error_budget) in (1..4).flat_map(|slots| [(slots, 0.0), (slots, 0.05 * mesh.layout().diagonal)])
            {
                let desc = desc.slots(slots).error_budget(error_budget);
                let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
                let mut weights = [0.0; 11];
                let step = |crowd: &mut HeadlessCrowd<'_>, weights: &[f32]| {
                    crowd.step(&[weights]).expect("a step").update.stats
                };
                for frame in 0..9 {
                    weights.iter_mut().enumerate().for_each(|(t, w)| *w += 0.01 * ((frame + t) % 4) as f32);
                    step(&mut crowd, &weights);
                }
                if error_budget > 0.0 {
                    assert!(step(&mut crowd, &weights).dirty_blocks > 0, "{desc:?}: nothing waited");
                }
                let settled = crowd.read_pose(0).expect("a pose");
                let still = step(&mut crowd, &weights);
                assert_eq!((still.coefficients, still.passes, still.dirty_blocks, still.bytes_moved), (0, 0, 0, 0));
                let bits = |pose: Vec<f32>| pose.into_iter().map(f32::to_bits).collect::<Vec<_>>();
                let (pose, previous) = (crowd.read_pose(0).expect("a pose"), crowd.read_previous_pose(0));
                let previous = previous.expect("a device that works").expect("the pose itself");
                assert_eq!((bits(pose), bits(previous)), (bits(settled.clone()), bits(settled)), "{desc:?}");
            }
        }
    });
}

#[test]
fn the_same_poses_on_every_driver() {
    let poses = std::cell::RefCell::new(Vec::<(String, Vec<f32>)>::new());
    on_every_device(|headless, engine| {
        let mesh = packed(engine, 500, 24, DeltaFormat::Float32);
        let desc = UpdateDesc::new(UpdatePath::Compute, deltamorph::BatchSize::Targets(8));
        let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
        for frame in 0..10 {
            crowd.step(&[&weights(&mesh, frame, 3)]).expect("a step");
        }
        poses.borrow_mut().push((headless.caps().name.clone(), crowd.read_pose(0).expect("a pose")));
    });
    let poses = poses.into_inner();
    for (name, pose) in &poses[1..] {
        let reference: Vec<f64> = poses[0].1.iter().map(|&v| f64::from(v)).collect();
        let error = compare(&pose[..500 * 6], &reference[..500 * 6]);
        assert!(error.within(1e-4, NORMAL), "{name} against {}: {error:?}", poses[0].0);
    }
}

#[test]
fn a_device_says_why_feedback_is_missing_and_what_takes_its_place() {
    gpu::on_device("SwiftShader", false, |headless, engine| {
        let mesh = packed(engine, 10, 2, DeltaFormat::Float32);
        let desc = UpdateDesc::new(UpdatePath::Feedback, deltamorph::BatchSize::Targets(1));
        let error = HeadlessCrowd::new(headless, &mesh, &single(desc)).err().expect("refused");
        let text = error.to_string();
        assert!(text.contains("'feedback'") && text.contains("SwiftShader"), "{text}");
        assert!(text.contains("VK_EXT_transform_feedback") && text.contains("'compute'"), "{text}");
    });
}

#[test]
fn timestamps_cover_the_whole_update() {
    gpu::on_device("llvmpipe", false, |headless, engine| {
        // Large enough for the update to dwarf a submit.
        let mesh = packed(engine, 40_000, 8, DeltaFormat::Float32);
        for path in [UpdatePath::Feedback, UpdatePath::Compute] {
            let desc = UpdateDesc::new(path, deltamorph::BatchSize::Targets(1));
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
            // Where nothing separates it from the timestamp, Mesa 22.3 skips the first pass of transform feedback: an
            // update of one pass then seems to take no time. The device's own times alone, the best of a few.
            let mut weights = [0.0; 8];
            let mut best = |targets: usize| {
                let times = (0..8).map(|_| {
                    weights[..targets].iter_mut().for_each(|w| *w += 1.0);
                    let step = crowd.step(&[&weights]).expect("a step");
                    let gpu_ms = step.gpu_ms.expect("lavapipe has timestamps");
                    assert!(gpu_ms <= step.cpu_ms, "{path:?}: {step:?}");
                    gpu_ms
                });
                times.fold(f64::INFINITY, f64::min)
            };
            let (all, one) = (best(8), best(1));
            assert!(one > 0.0 && all < 40.0 * one, "{path:?}: one pass takes {one} ms, eight {all} ms");
        }
    });
}

/// Any sequence of weights through any path, batch size, format and slot count.
#[test]
fn any_sequence_of_weights_equals_the_reference() {
    use proptest::prelude::*;
    use proptest::test_runner::{Config, TestRunner};
    on_every_device(|headless, engine| {
        let crowds: Vec<(PackedMesh, UpdateDesc)> = DeltaFormat::ALL
            .into_iter()
            .flat_map(|format| {
                let mesh = packed(engine, 130, 9, format);
                update_descs(engine, format).into_iter().map(move |desc| (mesh.clone(), desc))
            })
            .collect();
        let strategy = (2u32..4, prop::collection::vec(prop::collection::vec(-3i8..6, 9), 1..7));
        let mut reached = std::collections::BTreeSet::new();
        for (mesh, desc) in &crowds {
            let format = mesh.layout().format;
            let config = Config { cases: 4, failure_persistence: None, ..Config::default() };
            let run = TestRunner::new(config).run(&strategy, |(slots, frames)| {
                let desc = desc.slots(slots);
                let mut crowd = HeadlessCrowd::new(headless, mesh, &single(desc)).expect("a crowd");
                for frame in frames {
                    let weights: Vec<f32> = frame.iter().map(|&w| f32::from(w) * 0.3).collect();
                    crowd.step(&[&weights]).expect("a step");
                    let reference = gpu::reference(mesh, &desc, &weights);
                    let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
                    prop_assert!(is_kept(&error, mesh.layout().diagonal), "{:?} {:?} {:?}", format, desc, error);
                }
                Ok(())
            });
            run.unwrap_or_else(|e| panic!("{}: {e}", headless.caps().name));
            reached.insert(format.name());
        }
        assert_eq!(reached.len(), DeltaFormat::ALL.len(), "{reached:?}");
    });
}

/// Poses of integers, as they are stored and decoded: the same bits on every driver, on the CPU, and after a fresh
/// rebuild.
#[test]
fn poses_of_integers_are_the_same_bits_everywhere() {
    let formats = DeltaFormat::ALL.into_iter().filter(|format| format.has_integers());
    for (format, desc) in formats.flat_map(|format| gpu::fixed().map(|desc| (format, desc.path(gpu::path_of(format)))))
    {
        let mesh = PackedMesh::pack(&testing::mesh(500, 24), &PackDesc::new(format)).expect("a mesh that fits");
        let mesh = std::sync::Arc::new(mesh);
        let cpu = |frames: std::ops::Range<u32>| {
            let mut crowd = CpuCrowd::new(mesh.clone(), desc.path(UpdatePath::Cpu), 1, 2).expect("a crowd");
            for frame in frames {
                crowd.set_weights(0, &weights(&mesh, frame, 3)).expect("weights that fit");
                crowd.update();
            }
            let stored = crowd.stored_pose(0, 0).expect("an instance").to_vec();
            (stored, mesh.layout().to_user_order(&crowd.pose(0).expect("an instance")))
        };
        let (stored, pose) = cpu(0..60);
        assert_eq!((&stored, &pose), (&cpu(59..60).0, &cpu(59..60).1), "a fresh rebuild");
        on_every_device(|headless, _| {
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
            for frame in 0..60 {
                crowd.step(&[&weights(&mesh, frame, 3)]).expect("a step");
            }
            let name = &headless.caps().name;
            assert_eq!(crowd.read_stored(0, 0).expect("a pose"), stored, "{name} {format:?} {desc:?}");
            assert_eq!(crowd.read_pose(0).expect("a pose"), pose, "{name} {format:?} {desc:?}");
        });
    }
}
