//! Poses read back by the engine's own type: every technique, streams, fixed-point poses, several instances, hosts'
//! barriers.

use crate::gpu::weights;
use crate::prelude::*;
use deltamorph::reference::compare_group;

/// Update, readback and next update are in one submission each, so only barriers order them.
#[test]
fn poses_are_read_back_between_updates_in_one_submission() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Float32, DeltaFormat::Snorm16, DeltaFormat::Small] {
            let mesh = gpu::packed(engine, &testing::mesh(300, 11), format);
            let uploaded = gpu::upload(headless, engine, &mesh);
            for update in update_descs(engine, format) {
                let desc = CrowdDesc { instances: 3, frames_in_flight: 4, ..CrowdDesc::new(update) };
                let mut crowd = engine.create_crowd(&uploaded, &desc).expect("a crowd");
                let mut readbacks = [0, 1, 2].map(|_| engine.readback());
                let asked = |frame: usize, i: u32| weights(&mesh, frame as u32, 5 * i);
                headless
                    .run(|cmd| {
                        for (frame, readback) in readbacks.iter_mut().enumerate() {
                            (0..3).try_for_each(|i| crowd.set_weights(i, &asked(frame, i)))?;
                            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
                            unsafe {
                                engine.record_update(cmd, &mut crowd)?;
                                readback.record(cmd, &crowd, &[2, 0])?;
                            }
                        }
                        Ok(())
                    })
                    .expect("updates");
                for (frame, readback) in readbacks.iter_mut().enumerate() {
                    // SAFETY: `run` has waited.
                    let poses = unsafe { readback.poses() }.expect("poses");
                    assert_eq!(poses.iter().map(|pose| pose.instance).collect::<Vec<_>>(), [2, 0]);
                    for pose in &poses {
                        let reference = gpu::reference(&mesh, &update, &asked(frame, pose.instance));
                        let error = compare(&pose.vertices, &reference);
                        let kept = is_kept(&error, mesh.layout().diagonal)
                            || error.within(f64::from(update.tolerance), NORMAL);
                        assert!(kept && pose.streams.is_empty(), "{update:?} frame {frame}: {error:?}");
                    }
                }
            }
        }
    });
}

#[test]
fn streams_come_with_the_pose_and_memory_is_used_again() {
    on_every_device(|headless, engine| {
        let format = DeltaFormat::Fast;
        let mesh = PackedMesh::pack(&testing::with_streams(testing::mesh(300, 11)), &engine.pack_desc(format));
        let mesh = mesh.expect("a mesh that fits");
        let uploaded = gpu::upload(headless, engine, &mesh);
        for update in update_descs(engine, format) {
            let mut crowd =
                engine.create_crowd(&uploaded, &CrowdDesc { instances: 4, ..CrowdDesc::new(update) }).expect("a crowd");
            let mut readback = engine.readback();
            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
            assert!(unsafe { readback.poses() }.expect("nothing yet").is_empty());
            for (frame, instances) in [(0, &[1][..]), (1, &[0, 3, 2]), (2, &[3])] {
                let asked = |i: u32| weights(&mesh, frame, i);
                (0..4).for_each(|i| crowd.set_weights(i, &asked(i)).expect("weights"));
                let recorded = headless.run(|cmd| {
                    // SAFETY: as above.
                    unsafe {
                        engine.record_update(cmd, &mut crowd)?;
                        readback.record(cmd, &crowd, instances)
                    }
                });
                recorded.expect("an update");
                // SAFETY: as above.
                let poses = unsafe { readback.poses() }.expect("poses");
                assert!(poses.iter().map(|pose| pose.instance).eq(instances.iter().copied()));
                for pose in poses {
                    let semantics: Vec<_> = pose.streams.iter().map(|(semantic, _)| *semantic).collect();
                    let further = mesh.groups()[1..].iter().flat_map(|group| &group.layout().streams);
                    assert!(further.clone().map(|place| place.semantic).eq(semantics));
                    for group in mesh.groups() {
                        let layout = group.layout();
                        let reference = gpu::reference_group(group, &update, &asked(pose.instance));
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
                        assert!(error.within(1.2e-4, NORMAL) && error.absolute <= 1e-5, "{update:?}: {error:?}");
                    }
                }
            }
        }
    });
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
