//! Several crowds of one mesh in one submission, and the draws after the updates.

use crate::gpu::{self, on_every_device, update_descs, weights};
use crate::hazards::{Event, HazardChecker, accesses, trace};
use crate::testing;
use deltamorph::internals::plan::schedule::asset_uploaded;
use deltamorph::reference::compare;
use deltamorph::{
    AnimationDesc, AnyCrowd, BatchSize, Crowd, CrowdDesc, DeltaFormat, Playback, UpdateDesc, UpdatePath, WeightClip,
};
use deltamorph_headless::{HeadlessCrowd, Step};
use std::panic::{AssertUnwindSafe, catch_unwind};

#[test]
fn crowds_side_by_side_do_what_one_crowd_does() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
            let mesh = gpu::packed(engine, &testing::mesh(200, 11), format);
            for update in update_descs(engine, format) {
                let desc = |instances| CrowdDesc::new(update).instances(instances).frames_in_flight(1);
                let mut whole = HeadlessCrowd::new(headless, &mesh, &desc(4)).expect("a crowd");
                let half = HeadlessCrowd::new(headless, &mesh, &desc(2)).expect("a crowd");
                let mut halves = [half.another(&desc(2)).expect("another"), half];
                for frame in 0..4 {
                    let heads: Vec<Vec<f32>> = (0..4).map(|i| weights(&mesh, frame * i, i)).collect();
                    let heads: Vec<&[f32]> = heads.iter().map(Vec::as_slice).collect();
                    let one = whole.step(&heads).expect("a step");
                    let two = HeadlessCrowd::step_together(&mut halves, &heads, 3).expect("a step");
                    // Passes and bytes may differ, since a crowd shares work.
                    let work = |step: &Step| (step.update.stats.coefficients, step.update.stats.dirty_blocks);
                    assert_eq!(work(&one), work(&two), "{update:?} frame {frame}");
                    assert_eq!((one.draw_ms, one.gpu_ms.is_some()), (None, two.gpu_ms.is_some()));
                    assert_eq!(two.draw_ms.is_some(), two.gpu_ms.is_some(), "a device with timestamps times draws too");
                    for i in 0..4 {
                        let poses = [
                            whole.read_pose(i).expect("a pose"),
                            halves[i as usize / 2].read_pose(i % 2).expect("a pose"),
                        ];
                        let reference = gpu::reference(&mesh, &update, heads[i as usize]);
                        for pose in poses {
                            let error = compare(&pose, &reference);
                            assert!(error.within(1.2e-4, 0.01), "{update:?} head {i} frame {frame}: {error:?}");
                        }
                    }
                }
            }
        }
    });
}

/// Crowds updated by one call share their barriers: as many as the crowd with the most passes needs, and each is
/// needed.
#[test]
fn crowds_of_one_call_share_their_barriers() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(200, 11), DeltaFormat::Snorm16);
        let update = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(4));
        let first = HeadlessCrowd::new(headless, &mesh, &CrowdDesc::new(update)).expect("a crowd");
        let mut crowds = [first.another(&CrowdDesc::new(update)).expect("another"), first];
        let mut frames = vec![];
        for frame in 0..4u8 {
            // Eleven targets change in the first crowd, in three passes; one in the second.
            let many: Vec<f32> = (1..12u8).map(|t| f32::from(frame + 1) + f32::from(t) / 8.0).collect();
            let mut one = [1.0; 11];
            one[3] = f32::from(frame) / 4.0;
            let mut list = vec![];
            // SAFETY: nothing is changed.
            let step = unsafe {
                HeadlessCrowd::step_tampered(&mut crowds, &[&many, &one], |entries| list.clone_from(entries))
            };
            step.expect("a step");
            let events = trace(&list, |crowd, works| accesses(crowds[crowd as usize].crowd(), works));
            let slots = [0, 1].map(|crowd: usize| {
                let crowd = crowds[crowd].crowd();
                let previous = crowd.previous_pose(0).expect("a pose").expect("two slots keep it");
                [crowd.pose(0).expect("a pose").slot, previous.slot]
            });
            frames.push((events, slots));
        }
        let barriers: Vec<usize> =
            (0..frames[3].0.len()).filter(|&at| matches!(frames[3].0[at], Event::Barrier(_))).collect();
        assert_eq!(barriers.len(), 4, "before, two between three passes, after");
        for dropped in barriers.into_iter().map(Some).chain([None]) {
            let mut checker = HazardChecker::default();
            checker.upload(asset_uploaded());
            for (frame, (events, slots)) in frames.iter().enumerate() {
                let mut events = events.clone();
                if let (3, Some(at)) = (frame, dropped) {
                    events.remove(at);
                }
                checker.update(&events);
                for (crowd, slots) in (0..).zip(slots) {
                    slots.iter().for_each(|&slot| checker.draw(crowd, 0, slot));
                }
            }
            assert_eq!(checker.finish().is_err(), dropped.is_some(), "dropped {dropped:?}");
        }
    });
}

/// One call updates both kinds of crowds. If it fails before everything is recorded, nothing counts as done: the next
/// call rewrites poses with the CPU's weights, and poses animated on the GPU are the previous ones.
#[test]
fn crowds_of_both_kinds_are_updated_by_one_call() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(200, 5), DeltaFormat::Small);
        let layout = mesh.layout();
        let desc = CrowdDesc::new(gpu::fixed()[1]);
        // On the grid of weights: a frame per second.
        let weights = |frame: usize| (0..5).map(|t| (frame * t + 1) as f32 / 8.0).collect::<Vec<f32>>();
        let names = layout.targets.iter().map(|target| target.name.clone()).collect();
        let clip = WeightClip { name: "clip".into(), names, fps: 1.0, values: (0..4).flat_map(weights).collect() };
        let clips = [clip];
        let animation = AnimationDesc::new(&clips);
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so in all that follows.
        let uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, &mesh) }).expect("an upload");
        // SAFETY: as above.
        let animated = |cmd| unsafe { engine.create_animated_crowd(cmd, &uploaded, &desc, &animation) };
        let mut animated = headless.run(animated).expect("a crowd");
        let mut weighted = engine.create_crowd(&uploaded, &desc).expect("a crowd");
        animated.play(0, &Playback::new(0)).expect("a clip");
        let mut readbacks = [engine.readback(), engine.readback()];
        for frame in 0..4 {
            weighted.set_weights(0, &weights(frame)).expect("weights");
            animated.set_time(frame as f64).expect("a time");
            if frame == 2 {
                let before = animated.pose(0).expect("a pose").slot;
                let ended = catch_unwind(AssertUnwindSafe(|| {
                    headless.run(|cmd| {
                        let crowds: &mut [&mut dyn AnyCrowd] = &mut [&mut weighted, &mut animated];
                        // SAFETY: as above; the buffer is not submitted.
                        unsafe { engine.record_tampered(cmd, crowds, |_| panic!("planned, and not recorded")) }
                    })
                }));
                assert!(ended.is_err());
                assert!(weighted.pose(0).is_err());
                assert_eq!(animated.pose(0).expect("the pose before").slot, before);
            }
            let stats = headless.run(|cmd| {
                // SAFETY: as above.
                unsafe {
                    let updates = engine.record_updates(cmd, &mut [&mut weighted, &mut animated])?;
                    readbacks[0].record(cmd, &weighted, &[0])?;
                    readbacks[1].record(cmd, &animated, &[0])?;
                    Ok(updates[0].stats)
                }
            });
            let stats = stats.expect("an update");
            assert!(frame != 2 || stats.rebuilt_blocks == stats.dirty_blocks, "{stats:?}");
            let reference = gpu::reference(&mesh, &desc.update, &weights(frame));
            for readback in &mut readbacks {
                // SAFETY: `run` has waited.
                let poses = unsafe { readback.poses() }.expect("poses");
                let error = compare(&poses[0].vertices, &reference);
                assert!(error.within(1e-5, 0.01), "frame {frame}: {error:?}");
            }
        }
    });
}

#[test]
fn a_step_of_nothing_or_of_too_many_is_refused() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(64, 3), DeltaFormat::Fast);
        let update = update_descs(engine, DeltaFormat::Fast)[0];
        let desc = CrowdDesc::new(update).instances(1).frames_in_flight(1);
        let crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
        let mut crowds = [crowd.another(&desc).expect("another"), crowd];
        let heads: [&[f32]; 3] = [&[0.5; 3]; 3];
        testing::says(
            HeadlessCrowd::step_together(&mut crowds, &heads, 0),
            &["3 instances, 1 too many; give one list"],
        );
        testing::says(
            HeadlessCrowd::<Crowd>::step_together(&mut [], &[], 1),
            &["an empty list of crowds; pass at least one"],
        );
        HeadlessCrowd::step_together(&mut crowds, &heads[..2], 1).expect("two for two");
    });
}
