//! Streams besides positions and normals: tangents, texture coordinates and colours with every technique, on real
//! drivers and on the CPU, against the float64 reference.

use super::table::{Row, can_read, for_every_update, keep_supported, variants};
use crate::gpu::{POSITION, weights};
use crate::prelude::*;
use deltamorph::internals::pack::PackedGroup;
use deltamorph::mesh::MorphTarget;
use deltamorph::reference::compare_group;

const TARGETS: usize = 11;
const HEADS: usize = 3;

/// Makes a source with every kind of stream; target 2 moves nothing, and the last one only tangents.
fn source() -> Mesh {
    let mesh = testing::with_streams(testing::mesh(300, TARGETS));
    let targets = mesh.targets.iter().enumerate().map(|(t, target)| {
        let moved = if t + 1 < TARGETS { &target.vertices[..] } else { &[] };
        let positions = moved.iter().copied().zip(target.positions.iter().copied()).collect();
        let normals = moved.iter().copied().zip(target.normals.iter().copied()).collect();
        let mut streams = target.streams.clone();
        if t + 1 == TARGETS {
            streams[1..].iter_mut().for_each(|stream| *stream = Default::default());
        }
        MorphTarget { name: target.name.clone(), positions, normals: Some(normals), streams }
    });
    Mesh {
        name: "streams".into(),
        targets: targets.collect(),
        normals: Some(mesh.normals.clone()),
        positions: mesh.positions.clone(),
        streams: mesh.streams.clone(),
        ..Mesh::default()
    }
}

fn packed(desc: &PackDesc) -> PackedMesh {
    let mesh = source().kept(Tolerance::ZERO).expect("a mesh that is right");
    let packed = PackedMesh::pack(&mesh, desc).expect("a mesh that fits");
    assert_eq!(packed.groups().len(), 3, "position and normal; tangent and texture coordinates; colours and masks");
    packed
}

/// Asserts that a pose of a group is within the project's error limits.
fn assert_pose(group: &PackedGroup, desc: &UpdateDesc, pose: &[f32], weights: &[f32], what: &str) {
    let (layout, reference) = (group.layout(), gpu::reference_group(group, desc, weights));
    let error = compare_group(&layout.streams, pose, &reference);
    let length = POSITION * f64::from(layout.diagonal) + f64::from(desc.error_budget);
    // The budget is one of positions; normals are deferred with them.
    let degrees =
        if desc.error_budget > 0.0 && layout.streams[0].semantic == Semantic::Position { 180.0 } else { NORMAL };
    assert!(error.within(length, degrees) && error.absolute <= 1e-5, "{what}: {error:?}");
    for stream in layout.streams.iter().filter(|stream| stream.semantic == Semantic::Tangent) {
        let (w, base) = (stream.components().end - 1, layout.to_user_order(group.base()));
        for (pose, base) in pose.chunks_exact(6).zip(base.chunks_exact(6)) {
            assert_eq!(pose[w].to_bits(), base[w].to_bits(), "{what}: handedness");
        }
    }
}

fn bits(pose: &[f32]) -> Vec<u32> {
    pose.iter().map(|v| v.to_bits()).collect()
}

/// Returns the weights of an instance in a frame; only tangents move in every fifth frame, nothing in every seventh.
fn requested(mesh: &PackedMesh, desc: &UpdateDesc, frame: u32, head: usize) -> Vec<f32> {
    let held = frame - u32::from(frame % 7 == 6);
    let mut weights = weights(mesh, held - u32::from(held % 5 == 4), 3 + head as u32);
    weights[TARGETS - 1] = if held % 5 == 4 { 0.75 } else { 0.25 };
    keep_supported(&mut weights, desc);
    weights
}

/// Random weights; an instance that is hidden for a while, and shown with the weights requested meanwhile; a lost
/// update.
fn check(headless: &Headless, mesh: &PackedMesh, desc: UpdateDesc, frames: u32) {
    let crowd_desc = CrowdDesc { instances: HEADS as u32, ..CrowdDesc::new(desc) };
    let mut crowd = HeadlessCrowd::new(headless, mesh, &crowd_desc).expect("a crowd");
    let name = &headless.caps().name;
    let (mut shown, mut before) = (vec![vec![]; HEADS], vec![None; HEADS]);
    for frame in 0..frames {
        let hidden = |frame: u32| (2..4).contains(&frame);
        crowd.set_hidden(1, hidden(frame)).expect("an instance");
        let asked: Vec<Vec<f32>> = (0..HEADS).map(|head| requested(mesh, &desc, frame, head)).collect();
        let asked: Vec<&[f32]> = asked.iter().map(Vec::as_slice).collect();
        if frame == 5 {
            let other = requested(mesh, &desc, 3, 9);
            let (_, lost) = crowd.record(&[&other[..]; HEADS]).expect("a recording");
            crowd.discard(lost.ticket).expect("a ticket of this crowd");
        }
        crowd.step(&asked).expect("a step");
        crowd.draw(Draws { copies: 1, passes: 2 }).expect("a draw");
        for (head, asked) in asked.iter().enumerate().filter(|(head, _)| *head != 1 || !hidden(frame)) {
            shown[head] = asked.to_vec();
        }
        for head in (0..HEADS).filter(|_| can_read(headless, &desc)) {
            let mut poses = vec![];
            for (number, group) in mesh.groups().iter().enumerate() {
                let what =
                    format!("{name} {desc:?} {:?} frame {frame} head {head} group {number}", group.layout().format);
                let (pose, previous) = crowd.read_group(head as u32, number).expect("a pose");
                assert_pose(group, &desc, &pose, &shown[head], &what);
                let has_past = !(frame == 0 || frame == 5 || head == 1 && (2..5).contains(&frame));
                match (previous, &before[head]) {
                    (Some(previous), Some(before)) if has_past => {
                        let before: &Vec<Vec<f32>> = before;
                        assert_eq!(bits(&previous), bits(&before[number]), "{what}: the previous pose");
                    }
                    (Some(_), _) => {}
                    (None, _) => {
                        let is_lost = desc.slots == 1 || desc.slots == 2 && !desc.path.works_in_place();
                        assert!(desc.path.evaluates_in_draws() || is_lost, "{what}");
                    }
                }
                poses.push(pose);
            }
            before[head] = Some(poses);
        }
    }
    if desc.pose.has_integers() && desc.error_budget == 0.0 {
        // After any history: bit for bit a full evaluation.
        let mut fresh = crowd.another(&crowd_desc).expect("a crowd");
        let asked: Vec<&[f32]> = shown.iter().map(Vec::as_slice).collect();
        fresh.step(&asked).expect("a step");
        for (head, before) in before.iter().enumerate() {
            for (number, pose) in before.iter().flatten().enumerate() {
                let (full, _) = fresh.read_group(head as u32, number).expect("a pose");
                assert_eq!(bits(&full), bits(pose), "{name} {desc:?} head {head} group {number}");
            }
        }
    }
}

/// Every stream, or positions and normals on techniques that support only these.
#[test]
fn every_technique_updates_every_stream_of_a_crowd() {
    let streams = source().kept(Tolerance::ZERO).expect("a mesh that is right");
    let plain = KeptMesh { streams: vec![], ..streams.clone() };
    for (mesh, with_streams) in [(streams, true), (plain, false)] {
        for_every_update(&DeltaFormat::ALL, &mesh, |headless, mesh, desc| {
            if Row::of(desc.path).streams == with_streams {
                variants(desc).filter(|v| v.mode == desc.mode).for_each(|desc| check(headless, mesh, desc, 9));
            }
        });
    }
}

#[test]
fn an_error_budget_holds_back_positions_and_nothing_else() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Fast, DeltaFormat::Small] {
            let mesh = packed(&engine.pack_desc(format));
            for desc in update_descs(engine, format) {
                check(headless, &mesh, UpdateDesc { error_budget: 0.3 * mesh.layout().diagonal, ..desc }, 8);
            }
        }
    });
}

/// Groups need no barriers of their own, and their memory is ordered like that of the first.
#[test]
fn groups_share_steps_and_barriers() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
            let plain = gpu::packed(engine, &testing::mesh(300, TARGETS), format);
            let mesh = packed(&engine.pack_desc(format));
            for desc in update_descs(engine, format) {
                let shape = |mesh: &PackedMesh| {
                    let mut crowd = HeadlessCrowd::new(headless, mesh, &CrowdDesc::new(desc)).expect("a crowd");
                    let (mut checker, mut shape) = (HazardChecker::default(), vec![]);
                    for frame in 0..4 {
                        let weights = weights(mesh, frame, 5);
                        let (.., events) = gpu::recorded(&mut crowd, &[&weights]);
                        checker.update(&events);
                        let pose = crowd.crowd().pose(0).expect("a pose").slot;
                        let previous = crowd.crowd().previous_pose(0).expect("a pose").map(|view| view.slot);
                        for (group, slot) in (0..mesh.groups().len() as u32)
                            .flat_map(|g| [Some(pose), previous].into_iter().flatten().map(move |slot| (g, slot)))
                        {
                            checker.draw_group(0, group, 0, slot);
                        }
                        shape.push(events.iter().filter(|event| matches!(event, Event::Barrier(_))).count());
                    }
                    assert_eq!(checker.finish(), Ok(()), "{desc:?}");
                    shape
                };
                // With texels each dispatch is a step, and a group whose blocks partly start from the base pose has
                // two.
                if desc.path != UpdatePath::Blocks || !engine.caps().takes_texels(format) {
                    assert_eq!(shape(&mesh), shape(&plain), "{desc:?}");
                }
            }
        }
    });
}

/// The proptest of src/cpu, and for integers tests/updates/integers.rs, play histories.
#[test]
fn the_cpu_updates_every_stream() {
    for format in DeltaFormat::ALL {
        let mesh = Arc::new(packed(&PackDesc::new(format)));
        let desc = UpdateDesc { tolerance: 1e-2, path: UpdatePath::Cpu, ..UpdateDesc::blocks() };
        let mut crowd = gpu::cpu_crowd(&mesh, desc, HEADS as u32);
        for frame in 0..12 {
            let asked = [0, 1, 2].map(|head| requested(&mesh, &desc, frame, head));
            (0..).zip(&asked).for_each(|(head, asked)| crowd.set_weights(head, asked).expect("weights"));
            crowd.update();
            for (head, asked) in (0..).zip(&asked) {
                for (number, group) in mesh.groups().iter().enumerate() {
                    let what = format!("{format:?} frame {frame} head {head} group {number}");
                    let pose = mesh.layout().to_user_order(&crowd.group_pose(head, number).expect("a pose"));
                    assert_pose(group, &desc, &pose, asked, &what);
                }
            }
        }
        testing::says(crowd.group_pose(0, 3), &["group 3", "has 3"]);
    }
}
