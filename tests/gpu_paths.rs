//! Every GPU path, batch size and format against the float64 reference, on real drivers.

#[path = "common/gpu.rs"]
mod gpu;
#[path = "../src/testing.rs"]
mod testing;

use deltamorph::engine::MorphEngine;
use deltamorph::headless::{Headless, HeadlessCrowd};
use deltamorph::mesh::packed::{DeltaFormat, PackDesc, PackedMesh};
use deltamorph::plan::{UpdateDesc, UpdateMode, UpdatePath};
use deltamorph::reference::{compare, evaluate};
use gpu::{on_every_device, single, update_descs, weights};

/// Positions within 3e-6 of the diagonal, normals within 0.01°: what the project promises after whole clips.
const POSITION: f64 = 3e-6;
const NORMAL: f64 = 0.01;

fn packed(engine: &MorphEngine, vertices: usize, targets: usize, format: DeltaFormat) -> PackedMesh {
    PackedMesh::pack(&testing::mesh(vertices, targets), &engine.pack_desc(format)).expect("a mesh that fits")
}

/// Play `frames` frames of changing weights and compare every pose and previous pose.
fn check(headless: &Headless, engine: &MorphEngine, mesh: &PackedMesh, desc: UpdateDesc, frames: u32) {
    let mut crowd = HeadlessCrowd::new(headless, engine, mesh, &single(desc)).expect("a crowd");
    let bound = POSITION * f64::from(mesh.layout().diagonal.max(1.0));
    let mut before: Option<Vec<f64>> = None;
    for frame in 0..frames {
        let weights = weights(mesh, frame, 5);
        crowd.step(&[&weights]).expect("a step");
        let reference = evaluate(mesh, &weights);
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
                check(headless, engine, &mesh, desc, 6);
            }
        }
    });
}

#[test]
fn modes_and_slot_counts() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, 321, 19, DeltaFormat::Snorm16);
        for desc in update_descs(engine, DeltaFormat::Snorm16) {
            for slots in [1, 3] {
                for mode in [UpdateMode::Incremental, UpdateMode::Rebuild] {
                    let desc = UpdateDesc { slots, mode, ..desc };
                    if desc.check().is_ok() {
                        check(headless, engine, &mesh, desc, 5);
                    }
                }
            }
        }
    });
}

#[test]
fn degenerate_meshes() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::ALL {
            for (vertices, targets) in [(1, 1), (1, 0), (63, 3), (64, 1), (65, 0), (2, 300)] {
                let mesh = packed(engine, vertices, targets, format);
                for desc in update_descs(engine, format) {
                    check(headless, engine, &mesh, desc, 3);
                }
            }
        }
    });
}

#[test]
fn all_targets_empty() {
    on_every_device(|headless, engine| {
        let mut mesh = testing::mesh(100, 5);
        for target in &mut mesh.targets {
            *target = deltamorph::mesh::MorphTarget { name: target.name.clone(), ..Default::default() };
        }
        for format in DeltaFormat::ALL {
            let mesh = PackedMesh::pack(&mesh, &engine.pack_desc(format)).expect("a mesh that fits");
            for desc in update_descs(engine, format) {
                check(headless, engine, &mesh, desc, 3);
            }
        }
    });
}

#[test]
fn meshes_beyond_the_storage_range_are_cut_into_chunks() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::ALL {
            let desc = PackDesc { format, max_chunk_bytes: 128 * 37 * format.stride() as u64 };
            let mesh = PackedMesh::pack(&testing::mesh(1000, 37), &desc).expect("a mesh that fits");
            assert_eq!(mesh.layout().chunks().count(), 8);
            for desc in update_descs(engine, format) {
                check(headless, engine, &mesh, desc, 4);
            }
        }
    });
}

#[test]
fn more_workgroups_than_a_dispatch_has() {
    on_every_device(|headless, _| {
        let engine = headless.engine_within(|caps| caps.max_workgroups = 3).expect("an engine");
        for format in DeltaFormat::ALL {
            let mesh = packed(&engine, 1000, 19, format);
            for desc in update_descs(&engine, format) {
                check(headless, &engine, &mesh, desc, 3);
            }
        }
    });
}

#[test]
fn limits_are_kept_or_refused_with_the_numbers() {
    on_every_device(|headless, _| {
        let refuse = |clamp: &dyn Fn(&mut deltamorph::engine::DeviceCaps), words: &[&str]| {
            let engine = headless.engine_within(clamp).expect("an engine");
            let mesh = PackedMesh::pack(&testing::mesh(1000, 5), &PackDesc::default()).expect("a mesh");
            let desc = UpdateDesc::new(UpdatePath::Compute, deltamorph::plan::BatchSize::Targets(1));
            let error = HeadlessCrowd::new(headless, &engine, &mesh, &single(desc)).err().expect("refused").to_string();
            assert!(words.iter().all(|w| error.contains(w)), "{error}");
        };
        // 1,024 padded vertices of 24 bytes; five targets of them.
        refuse(&|caps| caps.max_storage_range = 10_000, &["a pose takes 24576 bytes", "allows 10000"]);
        refuse(&|caps| caps.max_storage_range = 50_000, &["a chunk of deltas takes 122880 bytes", "pack_desc"]);
        refuse(&|caps| caps.max_allocation = 100_000, &["'deltamorph deltas' needs 122880 bytes", "at most 100000"]);
        refuse(&|caps| caps.max_workgroup_invocations = 32, &["32 invocations per workgroup", "'cpu'"]);
    });
}

#[test]
fn a_crowd_of_heads_in_one_recording() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, 200, 11, DeltaFormat::Float32);
        for update in update_descs(engine, DeltaFormat::Float32) {
            let desc = deltamorph::engine::CrowdDesc { instances: 3, ..single(update) };
            let mut crowd = HeadlessCrowd::new(headless, engine, &mesh, &desc).expect("a crowd");
            for frame in 0..4 {
                let weights: Vec<Vec<f32>> = (0..3).map(|i| weights(&mesh, frame * i, i)).collect();
                crowd.step(&weights.iter().map(Vec::as_slice).collect::<Vec<_>>()).expect("a step");
                for i in 0..3 {
                    let error = compare(&crowd.read_pose(i).expect("a pose"), &evaluate(&mesh, &weights[i as usize]));
                    assert!(error.within(POSITION * 40.0, NORMAL), "{update:?} instance {i} frame {frame}: {error:?}");
                }
                crowd.draw().expect("a draw");
            }
        }
    });
}

#[test]
fn passes_are_the_coefficients_over_the_batch_size_and_a_still_face_records_nothing() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, 100, 57, DeltaFormat::Snorm16);
        for desc in update_descs(engine, DeltaFormat::Snorm16) {
            let mut crowd = HeadlessCrowd::new(headless, engine, &mesh, &single(desc)).expect("a crowd");
            let mut weights = vec![0.25; 57];
            let mut passes = |weights: &[f32]| crowd.step(&[weights]).expect("a step").update.stats;
            assert_eq!(passes(&weights).passes, desc.batch.passes(57));
            weights[40] = 0.5;
            let one = passes(&weights);
            assert_eq!((one.coefficients, one.passes), (1, 1), "{desc:?}");
            weights[3..12].fill(-1.0);
            let nine = passes(&weights);
            assert_eq!((nine.coefficients, nine.passes), (9, desc.batch.passes(9)), "{desc:?}");
            assert_eq!(passes(&weights), deltamorph::plan::UpdateStats::default(), "{desc:?}");
            let step = crowd.step_tampered(&[&weights], |list| assert!(list.commands.is_empty()));
            assert_eq!(step.expect("a step").update.stats.bytes_moved, 0);
        }
    });
}

#[test]
fn the_same_poses_on_every_driver() {
    let poses = std::cell::RefCell::new(Vec::<(String, Vec<f32>)>::new());
    on_every_device(|headless, engine| {
        let mesh = packed(engine, 500, 24, DeltaFormat::Float32);
        let desc = UpdateDesc::new(UpdatePath::Compute, deltamorph::plan::BatchSize::Targets(8));
        let mut crowd = HeadlessCrowd::new(headless, engine, &mesh, &single(desc)).expect("a crowd");
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
        let desc = UpdateDesc::new(UpdatePath::Feedback, deltamorph::plan::BatchSize::Targets(1));
        let error = HeadlessCrowd::new(headless, engine, &mesh, &single(desc)).err().expect("refused");
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
            let desc = UpdateDesc::new(path, deltamorph::plan::BatchSize::Targets(1));
            let mut crowd = HeadlessCrowd::new(headless, engine, &mesh, &single(desc)).expect("a crowd");
            for frame in 0..4 {
                let step = crowd.step(&[&[frame as f32 + 1.0; 8]]).expect("a step");
                let gpu_ms = step.gpu_ms.expect("lavapipe has timestamps");
                assert!(gpu_ms <= step.cpu_ms, "{path:?}: {step:?}");
                // The first run compiles outside the timestamps.
                assert!(frame == 0 || gpu_ms > 0.5 * step.cpu_ms, "{path:?}: {step:?}");
            }
        }
    });
}
