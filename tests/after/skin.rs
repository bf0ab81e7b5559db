//! The skinning step: poses that joints move, against float64; only what changed is written; previous skinned poses;
//! and barriers are where they have to be.

use crate::gpu;
use crate::joints::{JOINTS, Joints, MIRRORED};
use crate::offscreen::Offscreen;
use crate::written::Written;
use deltamorph::after::{GpuSkin, SkinDesc, SkinMethod, SkinTarget};
use deltamorph::ash::vk;
use deltamorph::internals::plan::hazards::{Event, HazardChecker, Memory, barriers_needed};
use deltamorph::internals::plan::schedule::asset_uploaded;
use deltamorph::internals::plan::steps::Resource;
use deltamorph::reference::{self, compare};
use deltamorph::{
    AnimationDesc, BatchSize, Consumers, CrowdDesc, DeltaFormat, PackedMesh, Playback, PoseFormat, Tolerance,
    UpdateDesc, UpdatePath,
};
use deltamorph_head::{HeadDesc, Rng, head, head_clip};
use deltamorph_headless::{Headless, HeadlessCrowd};
use std::slice::from_mut;
use std::sync::Arc;

/// What skinned positions may be off by, as a share of the diagonal, and their normals, in degrees.
const POSITION: f64 = 1e-5;
const NORMAL: f64 = 0.01;

fn head_desc() -> HeadDesc {
    HeadDesc::default().vertices(900).targets(37).sparsity(0.15).seed(3)
}

fn packed(headless: &Headless, format: DeltaFormat) -> Arc<PackedMesh> {
    let mesh = head(&head_desc()).to_mesh(Tolerance::default()).expect("a mesh");
    Arc::new(gpu::packed(headless.engine(), &mesh, format))
}

/// Joints and weights of every vertex: from one joint to all influences, in no order.
pub fn influences(vertices: usize, influences: u32) -> (Vec<u16>, Vec<f32>) {
    let mut rng = Rng::new(influences.into(), 0);
    let (mut joints, mut weights) = (vec![], vec![]);
    for vertex in 0..vertices {
        let used = 1 + vertex % influences as usize;
        for i in 0..influences as usize {
            let is_used = (i + vertex) % influences as usize % 8 < used;
            joints.push(if is_used { rng.below(MIRRORED as usize) as u16 } else { u16::MAX });
            weights.push(if is_used { rng.range(1e-3, 3.0) } else { 0.0 });
        }
        if vertex % 37 == 0 {
            // Alone: what a mirrored joint and another make together may have no volume, and no normals.
            let first = joints.len() - influences as usize;
            joints[first] = MIRRORED;
            weights[first..].fill(0.0);
            weights[first] = 0.25;
        }
    }
    (joints, weights)
}

pub fn upload(headless: &Headless, mesh: &PackedMesh, desc: &SkinDesc<'_>) -> GpuSkin {
    // SAFETY: the buffer is recording, runs once, and is waited for.
    let mut skin = headless.run(|cmd| unsafe { headless.engine().upload_skin(cmd, mesh, desc) }).expect("a skin");
    // SAFETY: it has run.
    unsafe { skin.release_staging() };
    skin
}

/// What is there as six numbers a vertex in the user's order; and how many vertices were written.
fn taken(headless: &Headless, mesh: &PackedMesh, written: &Written<'_>, held: &mut Vec<f32>) -> usize {
    let vertices = written.take(headless);
    held.resize(mesh.layout().padded_vertices() * 6, f32::NAN);
    for (vertex, words) in vertices.iter().enumerate().filter_map(|(v, words)| Some((v, words.as_ref()?))) {
        let numbers = words.iter().map(|word| f32::from_bits(*word));
        held[6 * vertex..][..6].iter_mut().zip(numbers).for_each(|(held, number)| *held = number);
    }
    vertices.iter().flatten().count()
}

fn weights(mesh: &PackedMesh, frame: u32) -> Vec<f32> {
    gpu::weights(mesh, frame, 7).iter().map(|weight| weight / 2.0).collect()
}

const METHODS: [SkinMethod; 2] = [SkinMethod::Linear, SkinMethod::DualQuaternion];

#[test]
fn skinned_poses_are_the_reference_and_only_what_changed_is_written() {
    gpu::on_every_device(|headless, _| {
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        let mut worst = (0.0f64, 0.0f64);
        for (i, (format, update)) in gpu::updates(headless).into_iter().enumerate() {
            let mesh = packed(headless, format);
            let (vertices, diagonal) = (mesh.layout().vertex_count, mesh.layout().diagonal);
            for (method, n) in METHODS.into_iter().zip(if i % 2 == 0 { [4, 8] } else { [8, 4] }) {
                let (joint_numbers, joint_weights) = influences(vertices, n);
                let desc = SkinDesc::new(n, JOINTS, &joint_numbers, &joint_weights);
                let skin = upload(headless, &mesh, &desc);
                let consumers = Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES;
                let crowd_desc = CrowdDesc::new(update).instances(2).consumers(consumers);
                let mut crowd = HeadlessCrowd::new(headless, &mesh, &crowd_desc).expect("a crowd");
                let mut joints = Joints::new(headless, &host, method, diagonal);
                let places = [(0, 24, Some(12)), (268, 40, Some(16))];
                let outputs = places.map(|place| Written::new(headless, &host, vertices, place));
                let (offset, stride, normals) = places[i % 2];
                // Two places of the same stride in turn, or one.
                let two = method == SkinMethod::Linear;
                let other = Written::new(headless, &host, vertices, (offset + 4, stride, normals));
                let first = &outputs[i % 2];
                let target = SkinTarget::new(first.buffer, joints.shared.buffer, 3 * Joints::STRIDE).method(method);
                let target = target.offset(offset).stride(stride).normals(normals).joints_offset(joints.offset());
                let target = target.second(two.then_some((other.buffer, offset + 4)));
                let mut held = [vec![], vec![]];
                let mut before: Vec<f32> = vec![];
                let mut fewer = 0;
                for frame in 0..14 {
                    let what = format!("{} {format:?} {update:?} {method:?} {n}, frame {frame}", headless.caps().name);
                    // Frames in which no weight changes; in which joints do; in which all is written.
                    let still = [1, 4, 5, 9].contains(&frame);
                    let moved = [3, 5, 9].contains(&frame);
                    let whole = moved || [1, 7, 11].contains(&frame);
                    match frame {
                        // SAFETY: the buffers are large enough, and live as long as the crowd; nothing is running.
                        1 => unsafe { crowd.set_skin_target(1, Some((&skin, &target))) }.expect("a target"),
                        6 => {
                            let (_, dropped) = crowd.record(&[&[0.1; 37][..]; 2]).expect("a record");
                            crowd.discard(dropped.ticket).expect("a ticket");
                            assert!(crowd.crowd().skinned(1).is_err());
                            crowd.set_hidden(1, true).expect("an instance");
                        }
                        7 => crowd.set_hidden(1, false).expect("an instance"),
                        11 => crowd.set_joints(1, joints.offset()).expect("joints"),
                        12 => crowd.cut(1).expect("an instance"),
                        _ => {}
                    }
                    if moved {
                        joints.turn(headless, u64::from(frame));
                        crowd.set_joints(1, joints.offset()).expect("joints");
                    }
                    let requested = weights(&mesh, if frame == 5 { 3 } else { frame - u32::from(still) });
                    let step = crowd.step(&[&requested, &requested]).expect(&what);
                    if frame == 0 {
                        assert!(crowd.crowd().skinned(1).is_err());
                        continue;
                    }
                    let written = [first, &other];
                    let counts: [usize; 2] = std::array::from_fn(|i| taken(headless, &mesh, written[i], &mut held[i]));
                    let count = counts[0] + counts[1];
                    if frame == 6 {
                        assert_eq!(count, 0, "{what}: hidden");
                        continue;
                    }
                    if still && !whole {
                        assert_eq!((count, step.update.stats.passes), (0, 0), "{what}: nothing changed");
                    }
                    if whole {
                        assert_eq!(count, vertices, "{what}");
                    }
                    fewer += usize::from((1..vertices).contains(&count));
                    let view = crowd.crowd().skinned(1).expect("a skinned pose");
                    let place = |i: usize| (written[i].buffer, written[i].place.0);
                    let now = if view.current == place(0) { 0 } else { 1 };
                    assert_eq!(view.current, place(now));
                    assert!(counts[1 - now] == 0 && (two || now == 0), "{what}: {counts:?}");
                    match (frame, count) {
                        (1 | 7 | 12, _) | (_, 0) => assert_eq!(view.previous, Some(view.current), "{what}"),
                        _ if two => {
                            assert_eq!(view.previous, Some(place(1 - now)), "{what}");
                            let same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits();
                            assert!(held[1 - now].iter().zip(&before).all(same), "{what}: previous");
                        }
                        _ => assert_eq!(view.previous, None, "{what}"),
                    }
                    before = held[now].clone();
                    let pose = gpu::reference(&mesh, &update, &requested);
                    let expected = reference::skin(&pose, &desc, method, &joints.numbers).expect("a skinned pose");
                    let error = compare(&mesh.layout().to_user_order(&before), &expected);
                    assert!(error.within(POSITION * f64::from(diagonal), NORMAL), "{what}: {error:?}");
                    worst = (worst.0.max(error.position / f64::from(diagonal)), worst.1.max(error.normal_degrees));
                }
                assert_eq!(fewer > 0, format.is_blocks(), "{format:?} {update:?}: parts of a pose");
                // SAFETY: nothing is running.
                unsafe { crowd.set_skin_target(1, None) }.expect("an instance");
                crowd.step(&[&[0.5; 37], &[0.5; 37]]).expect("a step");
                assert_eq!(taken(headless, &mesh, first, &mut held[0]), 0);
            }
        }
        println!("{}: off by {:.1e} of the diagonal, {:.1e} degrees", headless.caps().name, worst.0, worst.1);
    });
}

#[test]
fn heads_that_play_clips_are_skinned() {
    gpu::on_every_device(|headless, _| {
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        let mesh = packed(headless, DeltaFormat::Fast);
        let (vertices, diagonal) = (mesh.layout().vertex_count, mesh.layout().diagonal);
        let desc = CrowdDesc::new(UpdateDesc::blocks().pose(PoseFormat::Fixed16)).instances(3);
        let clips = [head_clip(&head_desc(), 40, 30.0)];
        let mut crowd = HeadlessCrowd::animated(headless, &mesh, &desc, &AnimationDesc::new(&clips)).expect("a crowd");
        (0..3).for_each(|i| crowd.play(i, &Playback::new(0).start(f64::from(i) * -0.1)).expect("a clip"));
        let (joint_numbers, joint_weights) = influences(vertices, 4);
        let skin_desc = SkinDesc::new(4, JOINTS, &joint_numbers, &joint_weights);
        let skin = upload(headless, &mesh, &skin_desc);
        let joints = Joints::new(headless, &host, SkinMethod::Linear, diagonal);
        let written = Written::new(headless, &host, vertices, (0, 24, Some(12)));
        let target = SkinTarget::new(written.buffer, joints.shared.buffer, 3 * Joints::STRIDE);
        let target = target.joints_offset(joints.offset());
        // SAFETY: the buffers are large enough, and live as long as the crowd; nothing is running.
        unsafe { crowd.set_skin_target(2, Some((&skin, &target))) }.expect("a target");
        for frame in 0..4 {
            crowd.set_time(f64::from(frame) / 30.0).expect("a time");
            crowd.step(&[]).expect("a step");
            let mut held = vec![];
            assert_eq!(taken(headless, &mesh, &written, &mut held), vertices);
            let pose: Vec<f64> = crowd.read_pose(2).expect("a pose").into_iter().map(f64::from).collect();
            let expected = reference::skin(&pose, &skin_desc, SkinMethod::Linear, &joints.numbers).expect("a pose");
            let error = compare(&mesh.layout().to_user_order(&held), &expected);
            assert!(error.within(POSITION * f64::from(diagonal), NORMAL), "frame {frame}: {error:?}");
        }
    });
}

#[test]
fn a_missing_barrier_is_found_with_two_outputs_in_turn_and_joints_that_move() {
    gpu::on_every_device(|headless, _| {
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        let mesh = packed(headless, DeltaFormat::Fast);
        let vertices = mesh.layout().vertex_count;
        let (joint_numbers, joint_weights) = influences(vertices, 4);
        let skin = upload(headless, &mesh, &SkinDesc::new(4, JOINTS, &joint_numbers, &joint_weights));
        let joints = Joints::new(headless, &host, SkinMethod::Linear, 1.0);
        let outputs = [0, 1].map(|_| Written::new(headless, &host, vertices, (0, 24, Some(12))));
        let mut crowd = HeadlessCrowd::new(headless, &mesh, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
        let target = SkinTarget::new(outputs[0].buffer, joints.shared.buffer, 3 * Joints::STRIDE);
        let target = target.joints_offset(16).second(Some((outputs[1].buffer, 0)));
        let (mut updates, mut read) = (vec![], vec![]);
        // The target comes when there is a pose: the next update skins, and does nothing else; so does one in which
        // joints alone move.
        for frame in [0, 0, 1, 2, 2, 3] {
            match updates.len() {
                // SAFETY: the buffers are large enough, and live as long as the crowd; nothing is running.
                1 => unsafe { crowd.set_skin_target(0, Some((&skin, &target))) }.expect("a target"),
                4 => crowd.set_joints(0, 16).expect("joints"),
                _ => {}
            }
            // SAFETY: nothing is changed.
            let step = unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&weights(&mesh, frame)], |_| {}) };
            let slot = crowd.crowd().pose(0).expect("a pose").slot;
            let output = |(buffer, _)| u32::from(buffer == outputs[1].buffer);
            let view = crowd.crowd().skinned(0).map(|view| [Some(output(view.current)), view.previous.map(output)]);
            updates.push(step.expect("a step").1);
            read.push((slot, view.unwrap_or_default()));
        }
        let is_right = |updates: &[Vec<Event>]| {
            let mut checker = HazardChecker::default();
            checker.upload(asset_uploaded());
            for (events, (slot, outputs)) in updates.iter().zip(&read) {
                checker.update(events);
                checker.draw(0, 0, *slot);
                for output in outputs.iter().copied().flatten() {
                    checker.read_after(0, Memory::After { resource: Resource::Skinned, instance: 0, output });
                }
            }
            checker.finish().is_ok()
        };
        // What the third update writes, a slot and a place, nobody has read before.
        let found = barriers_needed(&updates, [1, 3, 4, 5], is_right);
        assert!(found >= 9, "{found} barriers");
    });
}

#[test]
fn skins_and_targets_that_do_not_fit_are_refused() {
    gpu::on_every_device(|headless, engine| {
        let mesh = packed(headless, DeltaFormat::Fast);
        let vertices = mesh.layout().vertex_count;
        let (joints, weights) = influences(vertices, 4);
        let refused = |desc: SkinDesc<'_>| {
            // SAFETY: it is refused, and nothing is recorded.
            let uploaded = headless.run(|cmd| unsafe { engine.upload_skin(cmd, &mesh, &desc) });
            uploaded.err().expect("a refusal").to_string()
        };
        let with = |influences, count| SkinDesc::new(influences, count, &joints, &weights);
        let desc = with(4, JOINTS);
        assert!(refused(with(5, JOINTS)).contains("use 4 or 8 influences"));
        assert!(refused(with(4, 0)).contains("1 to 65536 joints"));
        assert!(refused(with(8, JOINTS)).contains("hand in 7"));
        assert!(refused(with(4, 3)).contains("names joint"));
        for (bad, says) in [(-0.5, "vertex 1 has the weight -0.5"), (f32::NAN, "vertex 1 has the weight NaN")] {
            let mut wrong = weights.clone();
            wrong[5] = bad;
            assert!(refused(SkinDesc::new(4, JOINTS, &joints, &wrong)).contains(says));
        }
        let mut wrong = weights.clone();
        wrong[8..12].fill(0.0);
        assert!(refused(SkinDesc::new(4, JOINTS, &joints, &wrong)).contains("vertex 2 has weights that sum to 0"));

        let skin = upload(headless, &mesh, &desc);
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        let output = Written::new(headless, &host, vertices, (0, 24, Some(12)));
        let buffer = Joints::new(headless, &host, SkinMethod::Linear, 1.0).shared.buffer;
        let target = SkinTarget::new(output.buffer, buffer, u64::from(JOINTS) * 48);
        let mut crowd = HeadlessCrowd::new(headless, &mesh, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
        let refused = |crowd: &mut HeadlessCrowd<'_>, instance, target: SkinTarget| {
            // SAFETY: it is refused.
            unsafe { crowd.set_skin_target(instance, Some((&skin, &target))) }.expect_err("a refusal").to_string()
        };
        assert!(refused(&mut crowd, 1, target).contains("instance 1"));
        assert!(refused(&mut crowd, 0, target.stride(20)).contains("multiples of 4"));
        assert!(refused(&mut crowd, 0, target.second(Some((output.buffer, 2)))).contains("multiples of 4"));
        assert!(refused(&mut crowd, 0, target.joints_offset(16)).contains("room for all joints"));
        assert!(refused(&mut crowd, 0, target.joints_offset(8)).contains("multiple of 16"));
        assert!(refused(&mut crowd, 0, target.stride(1 << 30)).contains("use a smaller stride"));
        assert!(crowd.set_joints(0, 0).expect_err("a refusal").to_string().contains("not skinned"));
        // SAFETY: the buffers are large enough, and live as long as the crowd; nothing is running.
        unsafe { crowd.set_skin_target(0, Some((&skin, &target))) }.expect("a target");
        assert!(crowd.set_joints(0, 16).expect_err("a refusal").to_string().contains("room for all joints"));
        // Another packing of the same mesh has another order of vertices.
        let other = packed(headless, DeltaFormat::Float32);
        let dense = UpdateDesc::new(UpdatePath::Compute, BatchSize::All);
        let mut other = HeadlessCrowd::new(headless, &other, &CrowdDesc::new(dense)).expect("a crowd");
        assert!(refused(&mut other, 0, target).contains("the packed mesh that the crowd was made of"));
    });
}
