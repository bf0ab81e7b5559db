//! Poses of every technique, batch size and format against the float64 reference, on real drivers; statistics of
//! updates; and idle instances.

use super::table::{check, for_every_update, updates, variants};
use crate::gpu::{in_eight_chunks, packed, weights};
use crate::prelude::*;
use deltamorph::DeltaFormat::{Fast, Float32, Small, Snorm16};
use deltamorph_headless::PoseUpload;

#[test]
fn every_technique_batch_and_format_equals_the_reference() {
    // Not a multiple of a workgroup, and more targets than any batch.
    let mesh = testing::mesh(1000, 37);
    gpu::on_every_driver(|headless, engine| {
        for format in DeltaFormat::ALL {
            let mesh = packed(engine, &mesh, format);
            updates(engine, format).into_iter().for_each(|desc| check(headless, &mesh, desc, 1, 8));
        }
    });
}

#[test]
fn modes_and_slot_counts() {
    for_every_update(&[Float32, Snorm16, Fast, Small], &testing::mesh(321, 19), |headless, mesh, desc| {
        if desc.path.is_baseline() || mesh.layout().format != Float32 {
            variants(desc).for_each(|desc| check(headless, mesh, desc, 1, 5));
        }
    });
}

#[test]
fn degenerate_meshes_and_empty_targets() {
    on_every_device(|headless, engine| {
        for (mesh, format) in testing::degenerate().iter().flat_map(|mesh| DeltaFormat::ALL.map(|f| (mesh, f))) {
            let mesh = packed(engine, mesh, format);
            updates(engine, format).into_iter().for_each(|desc| check(headless, &mesh, desc, 1, 3));
        }
    });
}

#[test]
fn meshes_beyond_the_storage_range_are_cut_into_chunks() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::DENSE {
            let mesh = in_eight_chunks(&testing::mesh(1000, 37), format);
            updates(engine, format).into_iter().for_each(|desc| check(headless, &mesh, desc, 1, 4));
        }
    });
}

/// One thread per record of `scatter`, of which a target has hundreds.
#[test]
fn more_workgroups_than_a_dispatch_has() {
    for driver in gpu::drivers() {
        let limits = gpu::limited(gpu::caps(&driver), |caps| caps.max_workgroups = 3);
        gpu::on_device_within(&driver, Some(limits), |headless, engine| {
            for format in DeltaFormat::ALL {
                let mesh = packed(engine, &testing::mesh(1000, 19), format);
                assert!(format.is_blocks() || mesh.layout().chunks().count() == 6);
                updates(engine, format).into_iter().for_each(|desc| check(headless, &mesh, desc, 1, 3));
            }
        });
    }
}

#[test]
fn bytes_are_those_that_kernels_load_and_store() {
    let weights = [0.0, 0.5, 1.0, 0.0, -1.0, 0.0, 0.0];
    for_every_update(&[Float32, Snorm16, Small], &testing::mesh(300, 7), |headless, mesh, desc| {
        for desc in variants(desc).filter(|desc| desc.path.is_baseline()) {
            let vertices = mesh.layout().padded_vertices() as u64;
            let mut crowd = gpu::crowd(headless, mesh, desc);
            let stats = crowd.step(&[&weights]).expect("a step").update.stats;
            let (stride, passes) = (mesh.layout().format.stride() as u64, stats.passes as u64);
            let mut deltas = 0;
            for target in [1, 2, 4] {
                mesh.for_each_delta(target, |_, delta| deltas += u64::from(delta != [0.0; 6]));
            }
            let (moved, floor) = match desc.path {
                // Each pass: a pose read, a pose written, and its deltas.
                deltamorph_baselines::VERTEX_STORE => {
                    (vertices * (48 * passes + 3 * stride), vertices * (48 + 3 * stride))
                }
                // Clear, six atomics per record, resolve.
                deltamorph_baselines::SCATTER => {
                    (vertices * (24 + 72) + deltas * (16 + 48), vertices * 48 + deltas * 16)
                }
                // Deltas, and displacements blended; rectangles also have texels that the target does not move, and all
                // texels are cleared, of which there are at least as many as vertices. Draws are not counted.
                deltamorph_baselines::TEXTURE => {
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
                    continue;
                }
                // One draw, which reads targets up to the last active one.
                deltamorph_baselines::DIRECT => (vertices * (24 + 3 * stride) + 5 * 8, vertices * (24 + 3 * stride)),
                _ => (vertices * (24 + 3 * stride), vertices * (24 + 3 * stride)),
            };
            assert_eq!((stats.bytes_moved, stats.bytes_floor), (moved, floor), "{desc:?}");
            assert_eq!(stats.coefficients, 3, "{desc:?}");
            let still = crowd.step(&[&weights]).expect("a step").update.stats;
            let drawn = if desc.path.evaluates_in_draws() { moved } else { 0 };
            assert_eq!(still.bytes_moved, drawn, "{desc:?}: draws go on, updates do not");
        }
    });
}

/// A device that is kept busy between timed updates, as GPUs are whose clocks fall, computes the same.
#[test]
fn poses_are_those_of_a_device_that_works_between_updates() {
    gpu::on_device(&gpu::one(), false, |headless, engine| {
        let mesh = packed(engine, &testing::mesh(300, 8), Fast);
        let mut crowd = gpu::crowd(headless, &mesh, UpdateDesc::blocks());
        headless.keep_busy().expect("a load");
        let times = [0.25, 0.5, 0.75, 1.0, 0.25].map(|weight| {
            let step = crowd.step(&[&[weight; 8]]).expect("a step");
            gpu::assert_right(&mut crowd, 0, &mesh, &[weight; 8]);
            step.gpu_ms.expect("timestamps")
        });
        let least = times.into_iter().fold(f64::INFINITY, f64::min);
        assert!(least < 2.0, "{times:?} ms: the two milliseconds before are not among them");
    });
}

#[test]
fn poses_of_the_cpu_path_are_uploaded_as_they_are() {
    on_every_device(|headless, engine| {
        let mesh = Arc::new(packed(engine, &testing::mesh(400, 9), Fast));
        let mut crowd = gpu::cpu_crowd(&mesh, UpdateDesc::blocks(), 2);
        let mut upload = PoseUpload::new(headless, mesh.layout(), 2).expect("buffers");
        for frame in 0..3 {
            for head in 0..2 {
                crowd.set_weights(head, &weights(&mesh, frame, head)).expect("weights");
            }
            crowd.update();
            let poses = [0, 1].map(|i| crowd.pose(i).expect("an instance"));
            let poses = poses.each_ref().map(|pose| &**pose);
            upload.upload(&poses).expect("an upload");
            upload.draw(Draws { copies: 1, passes: 2 }).expect("a draw");
            assert_eq!(upload.read().expect("poses"), poses.concat());
        }
        assert!(upload.upload(&[&crowd.pose(0).expect("an instance")]).is_err());
        assert!(PoseUpload::new(headless, mesh.layout(), 0).is_err());
    });
}
