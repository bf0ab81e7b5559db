//! Streams besides positions and normals: tangents, texture coordinates and colours with every technique, on real
//! drivers and on the CPU, against the float64 reference.

use super::table::{ROWS, can_read, for_every_update, keep_supported, variants};
use crate::gpu::{self, NORMAL, POSITION, on_every_device, update_descs, weights};
use crate::hazards::{Event, HazardChecker};
use crate::testing;
use deltamorph::mesh::SourceTarget;
use deltamorph::packed::PackedGroup;
use deltamorph::reference::compare_group;
use deltamorph::{
    BatchSize, CpuCrowd, Crowd, CrowdDesc, DeltaFormat, MorphEngine, MorphMesh, MorphSource, PackDesc, PackedMesh,
    Semantic, Tolerance, UpdateDesc, UpdatePath,
};
use deltamorph_headless::{Headless, HeadlessCrowd};
use std::sync::Arc;

const TARGETS: usize = 11;
const HEADS: usize = 3;

/// Makes a source with every kind of stream; target 2 moves nothing, and the last one only tangents.
fn source() -> MorphSource {
    let mesh = testing::with_streams(testing::mesh(300, TARGETS));
    let targets = mesh.targets.iter().enumerate().map(|(t, target)| {
        let moved = if t + 1 < TARGETS { &target.vertices[..] } else { &[] };
        let positions = moved.iter().copied().zip(target.positions.iter().copied()).collect();
        let normals = moved.iter().copied().zip(target.normals.iter().copied()).collect();
        let mut streams = target.streams.clone();
        if t + 1 == TARGETS {
            streams[1..].iter_mut().for_each(|stream| *stream = Default::default());
        }
        SourceTarget { name: target.name.clone(), positions, normals: Some(normals), streams }
    });
    MorphSource {
        name: "streams".into(),
        targets: targets.collect(),
        normals: Some(mesh.normals.clone()),
        positions: mesh.positions.clone(),
        streams: mesh.streams.clone(),
        ..MorphSource::default()
    }
}

fn packed(desc: &PackDesc) -> PackedMesh {
    let mesh = source().to_mesh(Tolerance::ZERO).expect("a mesh that is right");
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
    let crowd_desc = CrowdDesc::new(desc).instances(HEADS as u32);
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
        crowd.draw(1).expect("a draw");
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
    let streams = source().to_mesh(Tolerance::ZERO).expect("a mesh that is right");
    let plain = MorphMesh { streams: vec![], ..streams.clone() };
    for (mesh, with_streams) in [(streams, true), (plain, false)] {
        for_every_update(&DeltaFormat::ALL, &mesh, |headless, mesh, desc| {
            if ROWS[desc.path as usize].streams == with_streams {
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
                check(headless, &mesh, desc.error_budget(0.3 * mesh.layout().diagonal), 8);
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
                    checker.finish().unwrap_or_else(|found| panic!("{desc:?}: {}", found[0]));
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

#[test]
fn views_say_where_streams_are() {
    on_every_device(|headless, engine| {
        let mesh = packed(&engine.pack_desc(DeltaFormat::Fast));
        let desc = CrowdDesc::new(UpdateDesc::blocks()).instances(2);
        let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
        crowd.step(&[&[0.5; TARGETS], &[0.25; TARGETS]]).expect("a step");
        let crowd = crowd.crowd();
        let view = |semantic| crowd.stream(1, semantic).expect("a stream");
        let pose = crowd.pose(1).expect("a pose");
        let normal = view(Semantic::Normal);
        assert_eq!((normal.buffer, normal.offset, normal.components), (pose.buffer, pose.offset + 12, 3));
        let (tangent, texcoord, color) =
            (view(Semantic::Tangent), view(Semantic::TexCoord(0)), view(Semantic::Color(0)));
        assert_eq!((tangent.components, texcoord.components, color.components), (4, 2, 4));
        assert_eq!((texcoord.buffer, texcoord.offset), (tangent.buffer, tangent.offset + 16));
        assert!(tangent.buffer != pose.buffer && color.buffer != pose.buffer && color.buffer != tangent.buffer);
        assert_eq!((tangent.stride, tangent.slot, tangent.offset), (pose.stride, pose.slot, pose.offset));
        assert_eq!(crowd.previous_stream(1, Semantic::Tangent).expect("a stream"), Some(tangent));
        testing::says(crowd.stream(1, Semantic::Color(1)), &["'color 1'", "texcoord 0, color 0"]);
        assert_eq!(Crowd::pose_bytes(&mesh, &desc), 3 * 4 * mesh.layout().base_bytes());
        let plain = gpu::packed(engine, &testing::mesh(300, TARGETS), DeltaFormat::Fast);
        assert!(MorphEngine::mesh_bytes(&mesh) > MorphEngine::mesh_bytes(&plain) + 2 * mesh.layout().base_bytes());
    });
}

#[test]
fn the_cpu_updates_every_stream() {
    for format in DeltaFormat::ALL {
        let mesh = Arc::new(packed(&PackDesc::new(format)));
        let float = UpdateDesc::blocks().tolerance(1e-2);
        let descs = [float].into_iter().chain(gpu::fixed()).filter(|desc| desc.pose.takes(format));
        for desc in descs.flat_map(|desc| (1..4).map(move |slots| desc.path(UpdatePath::Cpu).slots(slots))) {
            let mut crowd = CpuCrowd::new(mesh.clone(), desc, HEADS as u32, 2).expect("a crowd");
            let mut before: Vec<Option<Vec<Vec<f32>>>> = vec![None; HEADS];
            let mut shown = vec![vec![]; HEADS];
            for frame in 0..12 {
                crowd.set_hidden(1, (2..4).contains(&frame)).expect("an instance");
                for (head, shown) in shown.iter_mut().enumerate() {
                    let asked = requested(&mesh, &desc, frame, head);
                    crowd.set_weights(head as u32, &asked).expect("weights");
                    if head != 1 || !(2..4).contains(&frame) {
                        *shown = asked;
                    }
                }
                crowd.update();
                for head in 0..HEADS {
                    let mut poses = vec![];
                    for (number, group) in mesh.groups().iter().enumerate() {
                        let what = format!("{desc:?} {format:?} frame {frame} head {head} group {number}");
                        let pose = crowd.group_pose(head as u32, number).expect("a pose");
                        assert_pose(group, &desc, &mesh.layout().to_user_order(&pose), &shown[head], &what);
                        let previous = crowd.previous_group_pose(head as u32, number).expect("an instance");
                        if let (Some(previous), Some(before), false) =
                            (previous, &before[head], head == 1 && (2..5).contains(&frame))
                        {
                            assert_eq!(bits(&previous), bits(&before[number]), "{what}: the previous pose");
                        }
                        poses.push(pose.to_vec());
                    }
                    before[head] = Some(poses);
                }
            }
            if desc.pose.has_integers() {
                let mut fresh = CpuCrowd::new(mesh.clone(), desc, HEADS as u32, 1).expect("a crowd");
                (0..).zip(&shown).for_each(|(head, w)| fresh.set_weights(head, w).expect("weights"));
                fresh.update();
                for (head, number) in (0..HEADS).flat_map(|head| (0..3).map(move |number| (head, number))) {
                    let pose = |crowd: &CpuCrowd| bits(&crowd.group_pose(head as u32, number).expect("a pose"));
                    assert_eq!(pose(&fresh), pose(&crowd), "{desc:?} head {head} group {number}");
                }
            }
            testing::says(crowd.group_pose(0, 3), &["group 3", "has 3"]);
        }
    }
}

/// A target stretches a sheet to twice its width, and its texture coordinates with it: the picture on it keeps its size
/// at every weight.
#[test]
fn texture_coordinates_follow_a_target_that_stretches() {
    use deltamorph::mesh::{StreamData, StreamDeltas};
    use glam::Vec3;
    let positions: Vec<Vec3> = (0..400u16).map(|i| Vec3::new(f32::from(i % 20), f32::from(i / 20), 0.0)).collect();
    let texcoords = positions.iter().flat_map(|p| [p.x / 20.0, p.y / 20.0]).collect();
    let moved: Vec<u32> = (0..400).filter(|i| i % 20 != 0).collect();
    let along = |i: u32| positions[i as usize].x;
    let stretched = SourceTarget {
        name: "stretch".into(),
        positions: moved.iter().map(|&i| (i, Vec3::X * along(i))).collect(),
        normals: None,
        streams: vec![StreamDeltas {
            deltas: moved.iter().flat_map(|&i| [along(i) / 20.0, 0.0]).collect(),
            vertices: moved.clone(),
        }],
    };
    let source = MorphSource {
        name: "sheet".into(),
        normals: Some(vec![Vec3::Z; positions.len()]),
        positions: positions.clone(),
        targets: vec![stretched],
        streams: vec![StreamData { semantic: Semantic::TexCoord(0), values: texcoords }],
        ..MorphSource::default()
    };
    let mesh = source.to_mesh(Tolerance::ZERO).expect("a mesh that is right");
    on_every_device(|headless, engine| {
        for (path, format) in [
            (UpdatePath::Blocks, DeltaFormat::Fast),
            (UpdatePath::Texture, DeltaFormat::Float32),
            (UpdatePath::Texture, DeltaFormat::Snorm16),
        ] {
            if engine.caps().check_path(path).is_err() {
                continue;
            }
            let packed = PackedMesh::pack(&mesh, &engine.pack_desc(format)).expect("a mesh that fits");
            let (group, first) = (1, packed.groups()[1].layout().streams[0].first);
            let desc = CrowdDesc::new(UpdateDesc::new(path, BatchSize::All));
            let mut crowd = HeadlessCrowd::new(headless, &packed, &desc).expect("a crowd");
            for weight in [0.5, 1.0, -0.25] {
                crowd.step(&[&[weight]]).expect("a step");
                let pose = crowd.read_pose(0).expect("a pose");
                let (streams, _) = crowd.read_group(0, group).expect("a pose");
                for (i, (pose, uv)) in pose.chunks_exact(6).zip(streams.chunks_exact(6)).enumerate() {
                    let x = positions[i].x * (1.0 + weight);
                    assert!(
                        (pose[0] - x).abs() < 2e-3,
                        "{path:?} {format:?} {weight}, vertex {i}: {} for {x}",
                        pose[0]
                    );
                    let off = (uv[first] - pose[0] / 20.0).abs() + (uv[first + 1] - positions[i].y / 20.0).abs();
                    assert!(off < 2e-4, "{path:?} {format:?} {weight}, vertex {i}: {uv:?} at {pose:?}");
                }
            }
        }
    });
}
