//! Instances animated on the GPU: time, slots, adding and removing, misuse, and planted faults.

use crate::gpu;
use crate::scene::{FIXED, Scene, clips, crowd, fixed, head_desc, packed};
use deltamorph::internals::plan::schedule::Barrier;
use deltamorph::internals::plan::steps::{Access, Scope};
use deltamorph::{
    AnimationDesc, BatchSize, DeltaFormat, PackedMesh, Playback, PoseFormat, Repeat, UpdateDesc, UpdatePath,
};
use deltamorph_headless::{Headless, HeadlessCrowd};
use std::sync::Arc;

/// Days of playback: records are restarted without a visible effect.
#[test]
fn the_clock_may_run_for_days() {
    let mesh = packed(DeltaFormat::Small, 64);
    gpu::on_device(&gpu::one(), false, |headless, _| {
        let clips = clips();
        let animation = AnimationDesc::new(&clips);
        let mut scene = Scene::new(headless, &mesh, crowd(3, fixed(PoseFormat::Fixed16, 2)), &animation);
        scene.play(0, Playback::new(0));
        scene.play(1, Playback::new(1).speed(-1.7));
        scene.play(2, Playback::new(0).repeat(Repeat::Once).start(16_000.0).speed(0.01));
        for hours in [0.0, 4.4, 4.6, 9.0, 18.3, 40.0, 200.0] {
            for later in [0.0, 0.5] {
                scene.step(hours * 3600.0 + later);
                (0..3).for_each(|instance| scene.assert_fresh(instance));
            }
        }
    });
}

/// Two instances that play the clip in which all weights change.
fn two_heads<'a>(headless: &'a Headless, mesh: &Arc<PackedMesh>, update: UpdateDesc) -> Scene<'a> {
    let clips = clips();
    let animation = AnimationDesc::new(&clips);
    let mut scene = Scene::new(headless, mesh, crowd(2, update), &animation);
    (0..2).for_each(|i| scene.play(i, Playback::new(1)));
    scene
}

#[test]
fn poses_and_previous_poses_follow_the_slots() {
    let mesh = packed(DeltaFormat::Fast, 64);
    gpu::on_every_device(|headless, _| {
        for (slots, pose) in (1..4).flat_map(|slots| FIXED.map(|pose| (slots, pose))) {
            let mut scene = two_heads(headless, &mesh, fixed(pose, slots));
            crate::testing::says(scene.crowd.crowd().pose(0), &["record an update first"]);
            let mut before: Option<Vec<f32>> = None;
            let mut frozen = vec![];
            for frame in 0..12 {
                match frame {
                    4 => scene.crowd.cut(0).expect("an instance"),
                    5 => {
                        frozen = scene.crowd.read_pose(1).expect("a pose");
                        scene.hide(1, true);
                    }
                    9 => scene.hide(1, false),
                    _ => {}
                }
                if frame == 6 {
                    scene.drop_one(100.0);
                    assert_eq!(Some(scene.crowd.read_pose(0).expect("a pose")), before, "the last that ran");
                }
                scene.step(f64::from(frame) / 7.0);
                let pose = scene.crowd.read_pose(0).expect("a pose");
                let previous = scene.crowd.read_previous_pose(0).expect("a pose");
                let expected = match (frame, slots) {
                    (0 | 4, _) => Some(&pose),
                    (_, 1) => None,
                    _ => before.as_ref(),
                };
                assert!(previous.as_ref() == expected, "{slots} slots, frame {frame}");
                before = Some(pose);
                if (5..=9).contains(&frame) {
                    let pose = scene.crowd.crowd().pose(1).expect("a pose");
                    let previous = scene.crowd.crowd().previous_pose(1).expect("a pose");
                    assert_eq!(Some(pose), previous, "hidden, or just shown");
                }
                if (5..9).contains(&frame) {
                    assert!(scene.crowd.read_pose(1).expect("a pose") == frozen, "a hidden head's pose stays");
                }
            }
            (0..2).for_each(|instance| scene.assert_fresh(instance));
        }
    });
}

/// An instance hidden or shown by an update that never runs keeps its pose.
#[test]
fn a_discarded_update_takes_no_pose_away() {
    let mesh = packed(DeltaFormat::Small, 64);
    gpu::on_every_device(|headless, _| {
        for (slots, pose) in (1..4).flat_map(|slots| FIXED.map(|pose| (slots, pose))) {
            let mut scene = two_heads(headless, &mesh, fixed(pose, slots));
            scene.step(0.0);
            scene.step(0.1);
            let pose = scene.crowd.read_pose(1).expect("a pose");
            for (frame, hidden) in [true, false, true].into_iter().enumerate() {
                scene.hide(1, hidden);
                scene.drop_one(5.0);
                assert!(scene.crowd.read_pose(1).expect("a pose") == pose, "{slots} slots, hidden: {hidden}, dropped");
                if hidden {
                    scene.step(0.2 + frame as f64);
                    assert!(scene.crowd.read_pose(1).expect("a pose") == pose, "{slots} slots, hidden");
                }
            }
            scene.hide(1, false);
            scene.step(4.0);
            scene.assert_fresh(1);
        }
    });
}

#[test]
fn heads_come_and_go() {
    let mesh = packed(DeltaFormat::Small, 32);
    gpu::on_every_device(|headless, _| {
        let clips = clips();
        let animation = AnimationDesc::new(&clips);
        let mut scene = Scene::new(headless, &mesh, crowd(10, fixed(PoseFormat::Fixed16, 3)), &animation);
        scene.instances().for_each(|i| scene.play(i, Playback::new(0).speed(1.0 + f64::from(i) / 9.0)));
        (0..3).for_each(|frame| drop(scene.step(f64::from(frame) / 10.0)));
        scene.remove(4);
        scene.remove(9);
        crate::testing::says(scene.crowd.crowd().pose(4), &["instance 4 was removed"]);
        assert!(scene.crowd.play(4, &Playback::new(0)).is_err());
        let (plan, _) = scene.step(0.4);
        assert!(plan.keys().all(|(instance, _)| ![4, 9].contains(instance)));
        // One is added before the next update, one after.
        assert_eq!(scene.add(), 4);
        crate::testing::says(scene.crowd.crowd().pose(4), &["no pose yet"]);
        scene.step(0.5);
        scene.assert_fresh(4);
        let pose = scene.crowd.read_pose(4).expect("a pose");
        assert_eq!(scene.crowd.read_previous_pose(4).expect("a pose").as_ref(), Some(&pose));
        assert_eq!(scene.add(), 9);
        scene.remove(2);
        assert_eq!(scene.add(), 2);
        scene.play(9, Playback::new(1));
        for frame in 6..10 {
            scene.step(f64::from(frame) / 10.0);
            scene.instances().for_each(|instance| scene.assert_fresh(instance));
        }
        assert!(scene.crowd.add().unwrap_err().to_string().contains("all taken"));
    });
}

#[test]
fn misuse_is_an_error_that_says_what_to_do() {
    let mesh = packed(DeltaFormat::Small, 64);
    gpu::on_device(&gpu::one(), false, |headless, _| {
        let clips = clips();
        let animation = AnimationDesc::new(&clips);
        let refuse = |update: UpdateDesc, words: &str| {
            let text = HeadlessCrowd::animated(headless, &mesh, &crowd(2, update), &animation).err().expect("refused");
            assert!(text.to_string().contains(words), "{text}");
        };
        refuse(UpdateDesc::blocks(), "use fixed16 or fixed32 poses");
        refuse(fixed(PoseFormat::Fixed16, 40), "at most 32");
        refuse(UpdateDesc::new(UpdatePath::Compute, BatchSize::All), "pack the mesh as");
        let mut animated =
            HeadlessCrowd::animated(headless, &mesh, &crowd(2, fixed(PoseFormat::Fixed16, 2)), &animation)
                .expect("a crowd");
        let weights = vec![0.0; head_desc().targets];
        for (result, words) in [
            (animated.step(&[&weights]).map(drop), "play a clip"),
            (animated.play(2, &Playback::new(0)), "instance 2 of a crowd of 2"),
            (animated.play(0, &Playback::new(3)), "clip 3 of 3"),
            (animated.set_time(f64::NAN), "second NaN"),
        ] {
            crate::testing::says(result, &[words]);
        }
        let clips = animated.crowd().clips();
        assert_eq!((clips.count(), clips.frames(1)), (3, Some(5)));
        assert_eq!((clips.frames(3), clips.fps(3), clips.rounding(3)), (None, None, None));
    });
}

/// Synchronization validation detects a missing barrier in the real command buffer (within an update: it does not look
/// across submissions).
#[test]
fn validation_sees_a_dropped_barrier() {
    let mesh = packed(DeltaFormat::Small, 64);
    let clips = clips();
    let animation = AnimationDesc::new(&clips);
    // After the records, between two kernels, before the indirect dispatches.
    const fn has(scope: &Scope, access: Access) -> bool {
        scope.accesses & access as u32 != 0
    }
    let wanted: [fn(&Scope, &Scope) -> bool; 3] = [
        |before, _| has(before, Access::TransferWrite),
        |before, after| before.stages == after.stages && has(before, Access::ShaderWrite),
        |_, after| has(after, Access::IndirectRead),
    ];
    for (which, wanted) in wanted.iter().enumerate() {
        let is_it = |barrier: &Barrier| wanted(&barrier.before, &barrier.after);
        let what = format!("barrier {which}");
        gpu::assert_validation_sees_dropped(&what, &[], is_it, |headless| {
            let update = fixed(PoseFormat::Fixed16, 2);
            let mut crowd = HeadlessCrowd::animated(headless, &mesh, &crowd(2, update), &animation).expect("a crowd");
            for _ in 0..2 {
                crowd.play(0, &Playback::new(0)).expect("a clip");
                crowd.step(&[]).expect("a step");
            }
            crowd.play(0, &Playback::new(1)).expect("a clip");
            crowd
        });
    }
}
