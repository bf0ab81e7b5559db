//! Crowds that get more places between two updates of one submission.

use crate::gpu::{self, NORMAL, fixed, is_kept, on_every_device, update_descs, weights};
use deltamorph::ash::vk;
use deltamorph::lod::{Camera, Importance, LevelDesc, Place};
use deltamorph::reference::compare;
use deltamorph::{
    AnimatedCrowd, AnimationDesc, Crowd, CrowdDesc, CrowdSet, DecodeTarget, DeltaFormat, PackedMesh, Playback,
    PoseReadback, UpdateDesc, WeightClip, testing,
};
use glam::Vec3;

fn assert_poses(readback: &mut PoseReadback, mesh: &PackedMesh, update: &UpdateDesc, asked: &[Vec<f32>], what: &str) {
    // SAFETY: the callers have waited.
    for pose in unsafe { readback.poses() }.expect("poses") {
        let error = compare(&pose.vertices, &gpu::reference(mesh, update, &asked[pose.instance as usize]));
        let kept = is_kept(&error, mesh.layout().diagonal) || error.within(f64::from(update.tolerance), NORMAL);
        assert!(kept, "{what}, {update:?}, instance {}: {error:?}", pose.instance);
    }
}

#[test]
fn a_crowd_grows_while_its_updates_are_in_flight() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
            let mesh = gpu::packed(engine, &testing::mesh(300, 11), format);
            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
            let uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, &mesh) }).expect("an upload");
            for update in update_descs(engine, format) {
                let desc = CrowdDesc::new(update).instances(3);
                let mut crowd = engine.create_crowd(&uploaded, &desc).expect("a crowd");
                let asked = |frame| (0..6).map(|i| weights(&mesh, frame, i)).collect::<Vec<_>>();
                let set = |crowd: &mut Crowd, frame: u32, instances: &[u32]| {
                    let asked = asked(frame);
                    instances.iter().for_each(|&i| crowd.set_weights(i, &asked[i as usize]).expect("weights"));
                };
                set(&mut crowd, 0, &[0, 1, 2]);
                crowd.remove(1).expect("an instance");
                let mut readbacks = [0, 1].map(|_| engine.readback());
                let outgrown = headless.run(|cmd| {
                    // SAFETY: as above; what is outgrown is dropped after the wait.
                    unsafe {
                        engine.record_update(cmd, &mut crowd)?;
                        readbacks[0].record(cmd, &crowd, &[0, 2])?;
                        crowd.set_hidden(2, true)?;
                        let outgrown = engine.grow_crowd(&mut crowd, &desc.instances(6))?;
                        assert!(crowd.pose(0).is_err(), "there is none until the next update");
                        assert_eq!(crowd.desc().instances, 6);
                        assert_eq!([crowd.add()?, crowd.add()?], [1, 3], "the place that was free, and a new one");
                        assert!(crowd.set_weight(4, 0, 0.5).is_err(), "the others are free");
                        assert_eq!(crowd.weights(0)?, &asked(0)[0][..]);
                        set(&mut crowd, 1, &[1, 3]);
                        engine.record_update(cmd, &mut crowd)?;
                        assert!(crowd.shown().eq([0, 1, 3]) && crowd.pose(2).is_err());
                        let (pose, previous) = (crowd.pose(0)?, crowd.previous_pose(0)?);
                        assert_eq!(previous, Some(pose), "the pose after a cut");
                        readbacks[1].record(cmd, &crowd, &[0, 1, 3])?;
                        Ok(outgrown)
                    }
                });
                drop(outgrown.expect("updates"));
                assert_poses(&mut readbacks[0], &mesh, &update, &asked(0), "before");
                let now = |i: usize| if i == 0 { asked(0)[0].clone() } else { asked(1)[i].clone() };
                let now: Vec<_> = (0..6).map(now).collect();
                assert_poses(&mut readbacks[1], &mesh, &update, &now, "grown");
                // And on, from the poses that are there; the hidden one catches up with what was asked before.
                crowd.set_hidden(2, false).expect("an instance");
                set(&mut crowd, 2, &[0, 1, 3]);
                let on = headless.run(|cmd| {
                    // SAFETY: as above.
                    unsafe {
                        engine.record_update(cmd, &mut crowd)?;
                        readbacks[0].record(cmd, &crowd, &[0, 1, 2, 3])
                    }
                });
                on.expect("an update");
                let mut now = asked(2);
                now[2] = asked(0)[2].clone();
                assert_poses(&mut readbacks[0], &mesh, &update, &now, "on");
            }
        }
    });
}

/// Clips go on where they were: from the next update on, poses are those of a crowd that had all its places from the
/// beginning, bit for bit.
#[test]
fn an_animated_crowd_grows_while_its_updates_are_in_flight() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(300, 11), DeltaFormat::Fast);
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
        let uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, &mesh) }).expect("an upload");
        let names: Vec<String> = mesh.layout().targets.iter().map(|target| target.name.clone()).collect();
        let values =
            |seed: u32| (0..8).flat_map(|frame| weights(&mesh, frame, seed)).map(|weight| weight / 2.0).collect();
        let clip = |seed| WeightClip { name: "clip".into(), names: names.clone(), fps: 10.0, values: values(seed) };
        let clips = [clip(1), clip(2)];
        // Levels of detail that follow a camera: from all targets to a few, by where a head is.
        let importance = Importance::of_packed(&mesh, &[]).expect("an order");
        let diagonal = mesh.layout().diagonal;
        let camera = Camera { eye: Vec3::ZERO, height: 400.0, angle: 0.6 };
        let place =
            |i: u32| Place { centre: Vec3::Z * diagonal * 3.0f32.powf(i as f32), radius: 0.5 * diagonal, scale: 1.0 };
        let playback = |i: u32| Playback::new(i % 2).start(f64::from(i) * -0.13).speed(1.0 + f64::from(i) / 7.0);
        for (update, level) in [
            (fixed()[0].slots(3).error_budget(1e-3), None),
            (fixed()[1], None),
            (fixed()[1], Some(LevelDesc::default())),
        ] {
            let desc = CrowdDesc::new(update).instances(3);
            let animation = AnimationDesc::new(&clips).importance(level.map(|_| &importance)).level(level);
            let follow = |crowd: &mut AnimatedCrowd, instances: &[u32]| {
                let mut places = instances.iter().filter(|_| level.is_some());
                places.try_for_each(|&i| crowd.set_place(i, &place(i)))
            };
            let crowd = |desc: &CrowdDesc| {
                // SAFETY: as above.
                let made =
                    headless.run(|cmd| unsafe { engine.create_animated_crowd(cmd, &uploaded, desc, &animation) });
                let mut crowd = made.expect("a crowd");
                (0..desc.instances).for_each(|i| crowd.play(i, &playback(i)).expect("a clip"));
                follow(&mut crowd, &(0..desc.instances).collect::<Vec<_>>()).expect("places");
                level.iter().for_each(|_| crowd.set_camera(&camera).expect("a camera"));
                crowd
            };
            let (mut grown, mut readbacks) = (crowd(&desc), [0, 1].map(|_| engine.readback()));
            // What a crowd shows that is made for this time alone.
            let fresh = |time: f64, instances: &[u32]| {
                let (mut crowd, mut readback) = (crowd(&desc.instances(6)), engine.readback());
                crowd.set_time(time).expect("a time");
                let read = headless.run(|cmd| {
                    // SAFETY: as above.
                    unsafe {
                        engine.record_update(cmd, &mut crowd)?;
                        readback.record(cmd, &crowd, instances)
                    }
                });
                read.expect("a read-back");
                // SAFETY: `run` has waited.
                unsafe { readback.poses() }.expect("poses")
            };
            let step = |crowd: &mut AnimatedCrowd, time: f64, readback: &mut PoseReadback, instances: &[u32]| {
                crowd.set_time(time).expect("a time");
                let read = headless.run(|cmd| {
                    // SAFETY: as above.
                    unsafe {
                        let update = engine.record_update(cmd, crowd)?;
                        readback.record(cmd, crowd, instances)?;
                        Ok(update.ticket)
                    }
                });
                read.expect("an update")
            };
            let early = step(&mut grown, 0.1, &mut readbacks[0], &[0, 1, 2]);
            grown.remove(1).expect("an instance");
            grown.set_time(0.2).expect("a time");
            let outgrown = headless.run(|cmd| {
                // SAFETY: as above; what is outgrown is dropped after the wait.
                unsafe {
                    engine.record_update(cmd, &mut grown)?;
                    readbacks[0].record(cmd, &grown, &[0, 2])?;
                    grown.set_hidden(2, true)?;
                    let outgrown = engine.grow_animated_crowd(cmd, &mut grown, &desc.instances(6))?;
                    assert!(grown.pose(0).is_err(), "there is none until the next update");
                    assert_eq!(grown.desc().instances, 6);
                    assert_eq!([grown.add()?, grown.add()?], [1, 3], "the place that was free, and a new one");
                    assert!(grown.play(4, &playback(4)).is_err(), "the others are free");
                    [1, 3].into_iter().try_for_each(|i| grown.play(i, &playback(i)))?;
                    follow(&mut grown, &[1, 3])?;
                    grown.set_time(0.3)?;
                    engine.record_update(cmd, &mut grown)?;
                    assert!(grown.shown().eq([0, 1, 3]) && grown.pose(2).is_err());
                    let (pose, previous) = (grown.pose(0)?, grown.previous_pose(0)?);
                    assert_eq!(previous, Some(pose), "the pose after a cut");
                    readbacks[1].record(cmd, &grown, &[0, 1, 3])?;
                    Ok(outgrown)
                }
            });
            drop(outgrown.expect("updates"));
            // SAFETY: `run` has waited; so below.
            unsafe { grown.release_staging() };
            let budget = update.error_budget > 0.0;
            let assert_same = |readback: &mut PoseReadback, time: f64, instances: &[u32], what: &str| {
                // SAFETY: as above.
                let poses = unsafe { readback.poses() }.expect("poses");
                for (pose, fresh) in poses.iter().zip(fresh(time, instances)) {
                    // A budget holds positions back, by so much in both crowds.
                    let numbers = (0..pose.vertices.len()).filter(|i| !budget || i % 6 < 3);
                    let off = numbers.map(|i| (pose.vertices[i] - fresh.vertices[i]).abs()).fold(0.0, f32::max);
                    assert!(off <= 2.1 * update.error_budget, "{what}, {update:?}: {off}");
                }
            };
            assert_same(&mut readbacks[0], 0.2, &[0, 2], "before");
            assert_same(&mut readbacks[1], 0.3, &[0, 1, 3], "grown");
            // And on, from the poses that are there; the hidden one is shown at the time that it is now.
            grown.set_hidden(2, false).expect("an instance");
            for frame in 4..8 {
                let time = f64::from(frame) / 10.0;
                let _ = step(&mut grown, time, &mut readbacks[0], &[0, 1, 2, 3]);
                assert_same(&mut readbacks[0], time, &[0, 1, 2, 3], "on");
            }
            // Tickets of before stay good. The updates have run here, and are taken for lost: what the GPU keeps is a
            // crowd's that was just grown, or it would be off.
            let mut lost = engine.readback();
            drop(headless.run(|cmd| {
                // SAFETY: as above.
                unsafe { engine.grow_animated_crowd(cmd, &mut grown, &desc.instances(7)) }
            }));
            grown.discard(early).expect("a ticket of this crowd");
            assert!(grown.pose(0).is_err());
            let _ = step(&mut grown, 0.9, &mut lost, &[0, 1, 2, 3]);
            assert_same(&mut lost, 0.9, &[0, 1, 2, 3], "after a discard");
            // Refused: nothing changes.
            let refused = [
                (desc.instances(6), "that is to have 6"),
                (desc.instances(9).update(update.weight_max(Some(1.0))), "on another grid"),
                (desc.instances(9).update(UpdateDesc::blocks()), "use PoseFormat::Fixed16"),
            ];
            for (desc, words) in refused {
                // SAFETY: as above.
                let error = headless.run(|cmd| unsafe { engine.grow_animated_crowd(cmd, &mut grown, &desc) });
                let text = error.err().expect("refused").to_string();
                assert!(text.contains(words), "{text}");
                assert!(grown.pose(0).is_ok() && grown.desc().instances == 7);
            }
        }
    });
}

#[test]
fn tickets_stay_good_and_sets_grow_together() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(200, 5), DeltaFormat::Fast);
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
        let uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, &mesh) }).expect("an upload");
        let desc = CrowdDesc::new(fixed()[0]);
        let crowd = || engine.create_crowd(&uploaded, &desc).expect("a crowd");
        let mut set = CrowdSet::new(vec![crowd(), crowd()]).expect("a set");
        // SAFETY: as above; the buffer runs, and its updates are taken for lost all the same: the poses are unknown
        // then.
        let lost = headless.run(|cmd| unsafe { engine.record_updates(cmd, &mut set.crowds_mut()) }).expect("updates");
        drop(engine.grow_set(&mut set, 3).expect("a larger set"));
        assert_eq!(set.add().expect("a place"), 1);
        let asked = vec![weights(&mesh, 1, 1), weights(&mesh, 2, 2)];
        (0..2).for_each(|i| set.set_weights(i, &asked[i as usize]).expect("weights"));
        // SAFETY: as above.
        headless.run(|cmd| unsafe { engine.record_updates(cmd, &mut set.crowds_mut()) }).expect("updates");
        set.discard(&lost).expect("tickets of these crowds");
        assert!(set.crowds().iter().all(|crowd| crowd.pose(0).is_err()), "the later update, too");
        // SAFETY: as above.
        headless.run(|cmd| unsafe { engine.record_updates(cmd, &mut set.crowds_mut()) }).expect("updates");
        for crowd in set.crowds() {
            let mut readback = engine.readback();
            // SAFETY: as above.
            headless.run(|cmd| unsafe { readback.record(cmd, crowd, &[0, 1]) }).expect("a read-back");
            assert_poses(&mut readback, &mesh, &desc.update, &asked, "a set");
        }
    });
}

#[test]
fn what_cannot_grow_stays_as_it_is() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(200, 5), DeltaFormat::Fast);
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
        let uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, &mesh) }).expect("an upload");
        let desc = CrowdDesc::new(fixed()[0]).instances(2);
        let mut crowd = engine.create_crowd(&uploaded, &desc).expect("a crowd");
        crowd.set_weights(0, &[0.0, 3.0, 0.0, 0.0, 0.0]).expect("weights");
        // SAFETY: as above.
        headless.run(|cmd| unsafe { engine.record_update(cmd, &mut crowd) }).expect("an update");
        let refused = |crowd: &mut Crowd, desc: &CrowdDesc, words: &str| {
            let text = engine.grow_crowd(crowd, desc).err().expect("refused").to_string();
            assert!(text.contains(words), "{text}");
            assert!(crowd.pose(0).is_ok() && crowd.desc().instances == 2);
        };
        refused(&mut crowd, &desc.instances(1), "a crowd of 2 instances that is to have 1");
        refused(&mut crowd, &desc.instances(u32::MAX), "bytes");
        refused(&mut crowd, &desc.update(fixed()[0].weight_max(Some(1.0))), "the weight of target 1");
        let (_, _, device) = headless.handles();
        let info = vk::BufferCreateInfo::default().size(12 * 200).usage(vk::BufferUsageFlags::STORAGE_BUFFER);
        // SAFETY: made, and destroyed when the crowd has no target any more.
        unsafe {
            let buffer = device.create_buffer(&info, None).expect("a buffer");
            let needs = device.get_buffer_memory_requirements(buffer);
            let memory = device.allocate_memory(&vk::MemoryAllocateInfo::default().allocation_size(needs.size), None);
            let memory = memory.expect("memory");
            device.bind_buffer_memory(buffer, memory, 0).expect("bound");
            engine.set_decode_target(&mut crowd, 0, Some(&DecodeTarget::new(buffer))).expect("a target");
            refused(&mut crowd, &desc.instances(4), "take them away with set_decode_target");
            engine.set_decode_target(&mut crowd, 0, None).expect("no target");
            device.destroy_buffer(buffer, None);
            device.free_memory(memory, None);
        }
        drop(engine.grow_crowd(&mut crowd, &desc.instances(4)).expect("grown"));
        // Anything else may change, too.
        drop(engine.grow_crowd(&mut crowd, &desc.instances(4).update(UpdateDesc::blocks())).expect("made anew"));
        assert_eq!(crowd.weights(0).unwrap()[1], 3.0);
    });
}
