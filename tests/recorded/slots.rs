//! The slots of animated updates that follow discarded ones: hosts that count frames rely on the rule for several
//! queues in the documentation of `MorphEngine`. src/update/tests.rs holds weighted ones to it.

use crate::prelude::*;

const INSTANCES: u32 = 3;
/// Most updates waiting to be submitted, all of which may be discarded at once.
const UNFINISHED: usize = 3;
const TARGETS: usize = 5;

/// Places of all instances: slots of pose and previous pose, and the output of the first if it is skinned.
#[derive(Clone, Default)]
struct Places {
    poses: Vec<[Option<u32>; 2]>,
    skinned: Option<(vk::Buffer, u64)>,
}

fn places(crowd: &Crowd) -> Places {
    let pose = |i| crowd.pose(i).ok().map(|pose| pose.slot);
    let previous = |i| crowd.previous_pose(i).ok().flatten().map(|pose| pose.slot);
    let poses = (0..INSTANCES).map(|i| [pose(i), previous(i)]).collect();
    Places { poses, skinned: crowd.output(0).ok().map(|view| view.current) }
}

/// Asserts that updates write nothing that draws running concurrently by the rule may read: `drawn`, the last frame
/// first.
fn assert_waits_for_enough(slots: usize, before: &Places, now: &Places, drawn: &[Places], what: &str) {
    for (i, ([old, _], [slot, _])) in before.poses.iter().zip(&now.poses).enumerate() {
        if slot.is_none() || old == slot {
            continue;
        }
        for (back, places) in drawn.iter().take(slots - 1).enumerate() {
            let [pose, previous] = places.poses[i];
            let is_read = pose == *slot || previous == *slot && back + 2 < slots;
            assert!(
                !is_read,
                "{what}: instance {i} is written to {slot:?}, which the draw of {} frames before reads",
                back + 1
            );
        }
    }
    let is_read = drawn.first().is_some_and(|places| places.skinned == now.skinned && now.skinned.is_some());
    assert!(
        before.skinned == now.skinned || !is_read,
        "{what}: the skinned pose that the draw before reads is written"
    );
}

/// Runs a random history of updates, of which several are discarded at once, with instances hidden, shown, cut, added
/// and removed.
fn follow(mut crowd: HeadlessCrowd<'_>, slots: usize) {
    let what = format!("{slots} slots");
    let mut time = 0.0;
    let (mut rng, mut drawn, mut waiting, mut hidden) = (Rng::new(slots as u64, 7), vec![], vec![], vec![]);
    for _ in 0..200 {
        time += rng.below(3) as f64 / 30.0;
        crowd.set_time(time).expect("a time");
        let one = rng.below(INSTANCES as usize) as u32;
        match rng.below(12) {
            0 => crowd.reset_history(one).expect("an instance"),
            1 | 2 if !hidden.contains(&one) => {
                crowd.set_hidden(one, true).expect("an instance");
                hidden.push(one);
            }
            3..6 => hidden.drain(..).for_each(|i| crowd.set_hidden(i, false).expect("an instance")),
            // The first instance keeps its target.
            6 if !hidden.contains(&2) => {
                crowd.remove(2).expect("an instance");
                assert_eq!(crowd.add().expect("a place"), 2);
            }
            _ => {}
        }
        if waiting.len() == UNFINISHED {
            let (oldest, _) = waiting.remove(0);
            crowd.submit(vec![oldest]).expect("an update");
        }
        let before = places(crowd.crowd());
        let (recorded, update) = crowd.record(&[]).expect("an update");
        let mut now = places(crowd.crowd());
        assert_waits_for_enough(slots, &before, &now, &drawn, &what);
        // Hidden instances are not drawn.
        hidden.iter().for_each(|&i| now.poses[i as usize] = [None; 2]);
        now.skinned = now.skinned.filter(|_| !hidden.contains(&0));
        drawn.insert(0, now);
        waiting.push((recorded, update.ticket));
        while rng.below(3) == 0 && !waiting.is_empty() {
            let first = rng.below(waiting.len());
            crowd.discard(waiting[first].1).expect("a ticket of this crowd");
            drawn.drain(..waiting.len() - first);
            waiting.truncate(first);
        }
    }
    crowd.submit(waiting.into_iter().map(|(recorded, _)| recorded).collect()).expect("updates");
}

fn skin(headless: &Headless, mesh: &PackedMesh) -> GpuSkin {
    let vertices = mesh.layout().vertex_count;
    let (joints, weights) = (vec![0; 4 * vertices], vec![1.0; 4 * vertices]);
    let desc = SkinDesc { influences: 4, joint_count: 1, joints: &joints, weights: &weights };
    gpu::skin(headless, mesh, &desc).expect("a skin")
}

#[test]
fn discarded_updates_give_their_slots_back() {
    on_device(&drivers()[0], false, |headless, engine| {
        let host = Buffers::new(headless);
        let source = testing::mesh(100, TARGETS);
        let place = || host.shared(100 * 24).buffer;
        let joints = host.shared(48).buffer;
        let mesh = gpu::packed(engine, &source, DeltaFormat::Fast);
        let skin = skin(headless, &mesh);
        let joints = Some(Joints::new(&skin, joints, 48));
        let target = OutputTarget { second: Some((place(), 0)), joints, ..OutputTarget::new(place()) };
        let clips = [gpu::clip(&mesh, 30.0, (0..10 * TARGETS).map(|i| (i % 7) as f32 / 8.0).collect())];
        for slots in 1..4 {
            let desc = CrowdDesc {
                instances: INSTANCES,
                frames_in_flight: 3,
                ..CrowdDesc::new(UpdateDesc { slots, ..gpu::fixed()[0] })
            };
            let mut crowd =
                HeadlessCrowd::animated(headless, &mesh, &desc, &AnimationDesc::new(&clips)).expect("a crowd");
            // SAFETY: the buffers are large enough, and outlive the crowd; nothing is running.
            unsafe { crowd.set_output_target(0, Some(&target)) }.expect("a target");
            (0..INSTANCES).for_each(|i| crowd.play(i, &Playback::new(0)).expect("a clip"));
            follow(crowd, slots as usize);
        }
    });
}
