//! Instances animated on the GPU: time, slots, adding and removing, misuse, and planted faults.

use crate::prelude::*;
use crate::scene::{FIXED, Scene, clips, crowd, fixed, head_desc, packed};
use deltamorph::internals::plan::steps::{Access, Scope};

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
                    4 => scene.crowd.reset_history(0).expect("an instance"),
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
        refuse(UpdateDesc::new(UpdatePath::Compute, BatchSize::All), "pack the mesh as");
        let mut animated =
            HeadlessCrowd::animated(headless, &mesh, &crowd(2, fixed(PoseFormat::Fixed16, 2)), &animation)
                .expect("a crowd");
        let mut planned = HeadlessCrowd::new(headless, &mesh, &crowd(2, UpdateDesc::blocks())).expect("a crowd");
        let weights = vec![0.0; head_desc().targets];
        for (result, words) in [
            (animated.step(&[&weights]).map(drop), "weights of a crowd that plays clips"),
            (animated.play(2, &Playback::new(0)), "instance 2 of a crowd of 2"),
            (animated.play(0, &Playback::new(3)), "clip 3 of 3"),
            (animated.set_time(f64::NAN), "second NaN"),
            (planned.play(0, &Playback::new(0)), "make it with create_animated_crowd"),
            (planned.set_time(1.0), "a crowd that plays no clips"),
            (planned.set_level(0, 1.0), "a crowd that plays no clips"),
        ] {
            crate::testing::says(result, &[words]);
        }
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
