//! Poses read back by the engine's own type: every technique, streams, fixed-point poses, several instances, hosts'
//! barriers.

use crate::gpu::weights;
use crate::prelude::*;
use deltamorph::ReadPose;
use deltamorph::reference::compare_group;

/// Update, readback and next update are in one submission each, so only barriers order them; the second time with the
/// memory of the first.
#[test]
fn poses_and_streams_are_read_back_between_updates_in_one_submission() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Float32, DeltaFormat::Snorm16, DeltaFormat::Fast, DeltaFormat::Small] {
            let mesh = gpu::packed(engine, &testing::with_streams(testing::mesh(300, 11)), format);
            let uploaded = gpu::upload(headless, engine, &mesh);
            for update in update_descs(engine, format) {
                let desc = CrowdDesc { instances: 4, frames_in_flight: 4, ..CrowdDesc::new(update) };
                let mut crowd = engine.create_crowd(&uploaded, &desc).expect("a crowd");
                let mut readbacks = [0, 1, 2].map(|_| engine.readback());
                // SAFETY: nothing was recorded.
                assert!(unsafe { readbacks[0].poses() }.expect("nothing yet").is_empty());
                for (first, instances) in [(0, [&[1][..], &[2, 0], &[3]]), (3, [&[0, 3, 2], &[1], &[3, 2, 1, 0]])] {
                    let asked = |frame: u32, i: u32| weights(&mesh, first + frame, 5 * i);
                    let recorded = headless.run(|cmd| {
                        for ((frame, readback), instances) in (0..).zip(&mut readbacks).zip(instances) {
                            (0..4).try_for_each(|i| crowd.set_weights(i, &asked(frame, i)))?;
                            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
                            unsafe {
                                engine.record_update(cmd, &mut crowd)?;
                                readback.record(cmd, &crowd, instances)?;
                            }
                        }
                        Ok(())
                    });
                    recorded.expect("updates");
                    for ((frame, readback), instances) in (0..).zip(&mut readbacks).zip(instances) {
                        // SAFETY: `run` has waited.
                        let poses = unsafe { readback.poses() }.expect("poses");
                        assert!(poses.iter().map(|pose| pose.instance).eq(instances.iter().copied()));
                        poses.iter().for_each(|pose| assert_read(pose, &mesh, &update, &asked(frame, pose.instance)));
                    }
                }
            }
        }
    });
}

/// Asserts that a pose with all its streams is that of the weights.
fn assert_read(pose: &ReadPose, mesh: &PackedMesh, update: &UpdateDesc, weights: &[f32]) {
    let further = mesh.groups()[1..].iter().flat_map(|group| &group.layout().streams).map(|place| place.semantic);
    assert!(further.eq(pose.streams.iter().map(|(semantic, _)| *semantic)));
    for group in mesh.groups() {
        let layout = group.layout();
        let reference = gpu::reference_group(group, update, weights);
        let mut read = vec![0.0f32; reference.len()];
        for place in &layout.streams {
            let found = pose.streams.iter().find(|(semantic, _)| *semantic == place.semantic);
            let Some((_, numbers)) = found else {
                read.copy_from_slice(&pose.vertices);
                break;
            };
            let vertices = numbers.chunks_exact(place.semantic.components());
            assert_eq!(vertices.len(), layout.vertex_count);
            for (vertex, numbers) in read.chunks_exact_mut(6).zip(vertices) {
                vertex[place.components()].copy_from_slice(numbers);
            }
        }
        let error = compare_group(&layout.streams, &read, &reference);
        let kept = error.within(f64::from(update.tolerance).max(1.2e-4), NORMAL) && error.absolute <= 1e-5;
        assert!(kept, "{update:?}: {error:?}");
    }
}

/// A limit refuses more memory here, before the driver is asked; the same code handles a driver without memory.
#[test]
fn what_was_read_back_stays_where_there_is_no_memory_for_more() {
    let limits = gpu::baseline(|caps| caps.max_allocation = 1 << 20);
    gpu::on_device_within(&gpu::one(), Some(limits), |headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(300, 11), DeltaFormat::Fast);
        let uploaded = gpu::upload(headless, engine, &mesh);
        let mut crowd = engine.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
        crowd.set_weights(0, &weights(&mesh, 1, 0)).expect("weights");
        let mut readback = engine.readback();
        let recorded = headless.run(|cmd| {
            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
            unsafe {
                engine.record_update(cmd, &mut crowd)?;
                readback.record(cmd, &crowd, &[0])
            }
        });
        recorded.expect("an update");
        // SAFETY: `run` has waited.
        let before = unsafe { readback.poses() }.expect("a pose");
        // SAFETY: as above.
        let refused = headless.run(|cmd| unsafe { readback.record(cmd, &crowd, &[0; 200]) });
        let text = refused.expect_err("more than is allowed").to_string();
        for remedy in ["fewer instances", "frames in flight", "fixed16"] {
            assert!(text.contains(remedy) && !text.contains("snorm16"), "{text}");
        }
        // SAFETY: `run` has waited.
        assert!(before.len() == 1 && unsafe { readback.poses() }.expect("a pose") == before);
    });
}
