//! Weights one at a time and by name; crowds of several meshes, updated by one call.

use crate::data;
use crate::gpu::{fixed, is_kept, on_every_device, packed, weights};
use crate::joints::{JOINTS, Joints};
use crate::offscreen::Offscreen;
use crate::testing;
use crate::testing::says;
use crate::written::Written;
use deltamorph::after::{SkinDesc, SkinMethod, SkinTarget};
use deltamorph::ash::vk;
use deltamorph::import::{csv, obj};
use deltamorph::internals::plan::schedule::Entry;
use deltamorph::mesh::{Faces, MorphTarget};
use deltamorph::reference::{self, compare, evaluate};
use deltamorph::{
    AnyCrowd, BatchSize, Crowd, CrowdDesc, DecodeTarget, DeltaFormat, MorphEngine, MorphMesh, PackedMesh, Tolerance,
    UpdateDesc, UpdatePath,
};
use deltamorph_headless::Headless;
use std::collections::HashMap;

fn crowd(headless: &Headless, engine: &MorphEngine, mesh: &PackedMesh, desc: &CrowdDesc) -> Crowd {
    // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
    let uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, mesh) }).expect("an upload");
    engine.create_crowd(&uploaded, desc).expect("a crowd")
}

fn count_barriers(entries: &[Entry]) -> usize {
    entries.iter().filter(|entry| matches!(entry, Entry::Barrier(_))).count()
}

/// Updates crowds in one call, and reads their poses of an instance back.
fn step(headless: &Headless, engine: &MorphEngine, crowds: &mut [Crowd], instance: u32) -> (Vec<Vec<f32>>, usize) {
    let mut readbacks: Vec<_> = crowds.iter().map(|_| engine.readback()).collect();
    let mut barriers = 0;
    let recorded = headless.run(|cmd| {
        let mut all: Vec<&mut dyn AnyCrowd> = crowds.iter_mut().map(|crowd| crowd as _).collect();
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; nothing is changed.
        unsafe { engine.record_tampered(cmd, &mut all, |entries| barriers = count_barriers(entries)) }?;
        for (crowd, readback) in crowds.iter().zip(&mut readbacks) {
            // SAFETY: as above.
            unsafe { readback.record(cmd, crowd, &[instance]) }?;
        }
        Ok(())
    });
    recorded.expect("an update");
    // SAFETY: as above.
    let pose = |readback: &mut deltamorph::PoseReadback| unsafe { readback.poses() }.expect("poses").remove(0).vertices;
    (readbacks.iter_mut().map(pose).collect(), barriers)
}

/// Sets the weights of an instance in all crowds, by the names of their targets.
fn set(crowds: &mut [Crowd], instance: u32, names: &[&str], weights: &[f32]) {
    let by_name: HashMap<&str, f32> = names.iter().copied().zip(weights.iter().copied()).collect();
    for crowd in crowds {
        let of_mesh: Vec<f32> = crowd.layout().targets.iter().map(|target| by_name[target.name.as_str()]).collect();
        crowd.set_weights(instance, &of_mesh).expect("weights");
    }
}

#[test]
fn weights_are_set_one_at_a_time_and_read_back() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, &testing::mesh(200, 9), DeltaFormat::Small);
        let name = |target: usize| mesh.layout().targets[target].name.clone();
        assert_eq!(mesh.layout().target_index(&name(4)), Some(4));
        assert_eq!(mesh.layout().target_index("no such target"), None);
        let desc = CrowdDesc::new(fixed()[0]).instances(2);
        let mut other = crowd(headless, engine, &mesh, &desc);
        let mut one = crowd(headless, engine, &mesh, &desc);
        let mut asked = weights(&mesh, 3, 1);
        one.set_weights(1, &asked).expect("weights");
        (asked[2], asked[4]) = (0.625, -0.5);
        one.set_weight(1, 2, 0.625).expect("a weight");
        one.set_weight(1, 4, -0.5).expect("a weight");
        for (weight, words) in [(f32::NAN, "is NaN"), (f32::INFINITY, "is inf"), (5.0, "use a larger weight_max")] {
            says(one.set_weight(1, 2, weight), &["the weight of target 2", words]);
        }
        says(one.set_weight(1, 9, 0.0), &["target 9 of mesh", "which has 9; count targets from 0"]);
        says(one.set_weight(2, 0, 0.0), &["instance 2 of a crowd of 2"]);
        says(one.weights(2), &["instance 2 of a crowd of 2"]);
        assert_eq!((one.weights(0).unwrap(), one.weights(1).unwrap()), (&[0.0; 9][..], &asked[..]));
        other.set_weights(1, &asked).expect("weights");
        let pose = |crowd| step(headless, engine, std::slice::from_mut(crowd), 1).0;
        assert_eq!(pose(&mut one), pose(&mut other), "the pose of the same weights, set at once");
        one.remove(1).expect("an instance");
        says(one.set_weight(1, 0, 0.0), &["instance 1 was removed"]);
    });
}

#[test]
fn a_weight_that_makes_too_many_active_is_refused_alone() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, &testing::mesh(64, 4), DeltaFormat::Float32);
        let desc = CrowdDesc::new(UpdateDesc::new(UpdatePath::DirectAttributes, BatchSize::Targets(2)));
        let mut crowd = crowd(headless, engine, &mesh, &desc);
        crowd.set_weights(0, &[0.5, 0.0, 0.5, 0.0]).expect("two active");
        assert!(crowd.set_weight(0, 1, 0.5).is_err());
        assert_eq!(crowd.weights(0).unwrap(), [0.5, 0.0, 0.5, 0.0]);
        crowd.set_weight(0, 2, 0.0).expect("one active");
        crowd.set_weight(0, 1, 0.5).expect("two active");
    });
}

/// Returns the floats of every vertex in `written`, six each.
fn floats(headless: &Headless, written: &Written<'_>, mesh: &PackedMesh) -> Vec<f32> {
    let vertices = written.take(headless).into_iter();
    let mut all: Vec<f32> = vertices.flat_map(|words| words.expect("all is written")).map(f32::from_bits).collect();
    all.resize(mesh.layout().padded_vertices() * 6, 0.0);
    mesh.layout().to_user_order(&all)
}

/// Each mesh with its own joints, which turn and are cut together; the second one is also decoded.
#[test]
fn several_crowds_are_skinned_decoded_and_cut_in_one_update() {
    on_every_device(|headless, engine| {
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        let meshes = [(200, 3), (90, 3)].map(|(n, m)| packed(engine, &testing::mesh(n, m), DeltaFormat::Fast));
        let desc = CrowdDesc::new(UpdateDesc::blocks()).instances(2);
        let mut crowds: Vec<Crowd> = meshes.iter().map(|mesh| crowd(headless, engine, mesh, &desc)).collect();
        let influences: Vec<(Vec<u16>, Vec<f32>)> = meshes
            .iter()
            .map(|mesh| (0..4 * mesh.layout().vertex_count).map(|i| ((i % 7) as u16, 1.0 + (i % 5) as f32)).unzip())
            .collect();
        let skins = influences.iter().map(|(which, weights)| SkinDesc::new(4, JOINTS, which, weights));
        let skins: Vec<SkinDesc<'_>> = skins.collect();
        let mut joints =
            meshes.each_ref().map(|m| Joints::new(headless, &host, SkinMethod::Linear, m.layout().diagonal));
        let places = [0, 1].map(|_| {
            meshes.each_ref().map(|mesh| Written::new(headless, &host, mesh.layout().vertex_count, (0, 24, Some(12))))
        });
        let decoded = Written::new(headless, &host, meshes[1].layout().vertex_count, (0, 24, Some(12)));
        for (i, mesh) in meshes.iter().enumerate() {
            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
            let skin = headless.run(|cmd| unsafe { engine.upload_skin(cmd, mesh, &skins[i]) }).expect("a skin");
            let target = SkinTarget::new(places[0][i].buffer, joints[i].shared.buffer, 3 * Joints::STRIDE);
            let target = target.joints_offset(joints[i].offset()).stride(24).normals(Some(12));
            let target = target.second(Some((places[1][i].buffer, 0)));
            // SAFETY: the buffers are large enough, and outlive the crowd; nothing is running.
            unsafe { engine.set_skin_target(&mut crowds[i], 1, Some((&skin, &target))) }.expect("a target");
        }
        // SAFETY: as above.
        unsafe {
            let target = DecodeTarget::new(decoded.buffer).stride(24).normals(Some(12));
            engine.set_decode_target(&mut crowds[1], 1, Some(&target)).expect("a target");
        }
        for frame in 0..4u16 {
            let asked: Vec<f32> = (0..3u16).map(|t| f32::from((5 * t + 3 * frame) % 8) / 8.0).collect();
            crowds.iter_mut().for_each(|crowd| crowd.set_weights(1, &asked).expect("weights"));
            for (i, joints) in joints.iter_mut().enumerate() {
                joints.turn(headless, u64::from(frame) + 10 * i as u64);
                crowds[i].set_joints(1, joints.offset()).expect("joints");
            }
            if frame == 2 {
                crowds.iter_mut().for_each(|crowd| crowd.cut(1).expect("an instance"));
            }
            let (poses, _) = step(headless, engine, &mut crowds, 1);
            for (i, mesh) in meshes.iter().enumerate() {
                let view = crowds[i].skinned(1).expect("a skinned pose");
                let now = usize::from(view.current.0 == places[1][i].buffer);
                let before = if matches!(frame, 0 | 2) { now } else { 1 - now };
                assert_eq!(view.previous, Some((places[before][i].buffer, 0)), "frame {frame}");
                let pose = evaluate(mesh, &asked);
                let expected =
                    reference::skin(&pose, &skins[i], SkinMethod::Linear, &joints[i].numbers).expect("a pose");
                let error = compare(&floats(headless, &places[now][i], mesh), &expected);
                assert!(error.within(1e-5 * f64::from(mesh.layout().diagonal), 0.01), "frame {frame}: {error:?}");
            }
            assert_eq!(floats(headless, &decoded, &meshes[1]), poses[1], "frame {frame}");
        }
        says(crowds[0].set_joints(0, 0), &["not skinned"]);
    });
}

/// Returns the part of a mesh with these vertices, with the targets that move any of them.
fn part(mesh: &MorphMesh, name: &str, vertices: &[u32]) -> MorphMesh {
    let new: HashMap<u32, u32> = vertices.iter().copied().zip(0..).collect();
    let at = |v: &u32| *v as usize;
    let mut part =
        MorphMesh { name: name.into(), diagonal: mesh.diagonal, tolerance: mesh.tolerance, ..Default::default() };
    part.positions = vertices.iter().map(|v| mesh.positions[at(v)]).collect();
    part.normals = vertices.iter().map(|v| mesh.normals[at(v)]).collect();
    part.faces = Faces::default();
    for face in mesh.faces.iter().filter(|face| new.contains_key(&face[0].position)) {
        part.faces.sizes.push(face.len() as u32);
        let corner = |corner: &deltamorph::mesh::Corner| deltamorph::mesh::Corner {
            position: new[&corner.position],
            texcoord: None,
        };
        part.faces.corners.extend(face.iter().map(corner));
    }
    for target in &mesh.targets {
        let mut moved = MorphTarget { name: target.name.clone(), ..Default::default() };
        for (i, v) in target.vertices.iter().enumerate().filter_map(|(i, v)| Some((i, *new.get(v)?))) {
            moved.vertices.push(v);
            moved.positions.push(target.positions[i]);
            moved.normals.push(target.normals[i]);
        }
        part.targets.extend(Some(moved).filter(|moved| !moved.vertices.is_empty()));
    }
    part
}

/// The body of makehuman_face with eyes and tongue, its teeth, and its lashes as three meshes.
#[test]
fn a_face_in_three_meshes_moves_as_the_whole_one() {
    let Some(folder) = data::set("makehuman_face") else { return };
    let whole = obj::import_folder(&folder).expect("a folder").to_mesh(Tolerance::default()).expect("a mesh");
    // The file has the groups of faces.
    let text = std::fs::read_to_string(folder.join("neutral.obj")).expect("a file");
    let (mut group, mut groups) = (0, vec![0; whole.vertex_count()]);
    for line in text.lines() {
        let mut words = line.split(' ');
        match words.next() {
            Some("g") => group = if line.contains("teeth") { 1 } else { 2 * usize::from(line.contains("lashes")) },
            Some("f") => words.filter_map(|corner| corner.split('/').next()?.parse::<usize>().ok()).for_each(|v| {
                groups[v - 1] = group;
            }),
            Some(_) | None => {}
        }
    }
    let of = |part: usize| (0..groups.len() as u32).filter(|v| groups[*v as usize] == part).collect::<Vec<_>>();
    let parts: Vec<(Vec<u32>, MorphMesh)> =
        ["head", "teeth", "lashes"].iter().enumerate().map(|(i, name)| (of(i), part(&whole, name, &of(i)))).collect();
    let counts: Vec<_> = parts.iter().map(|(_, part)| (part.vertex_count(), part.targets.len())).collect();
    assert!(counts.iter().all(|(vertices, targets)| *vertices > 0 && (1..169).contains(targets)), "{counts:?}");
    let names: Vec<&str> = whole.targets.iter().map(|target| target.name.as_str()).collect();
    let clip = csv::read(&folder.join("weights/facecap_30fps.csv"), None).expect("a clip");
    let frames: Vec<Vec<f32>> = clip.bind(&names).expect("columns that name targets").frames().collect();
    let blocks = UpdateDesc::blocks();
    let dense = UpdateDesc::new(UpdatePath::Compute, BatchSize::All);
    on_every_device(|headless, engine| {
        for (format, update) in [(DeltaFormat::BlockFloat32, blocks), (DeltaFormat::Float32, dense)] {
            let desc = CrowdDesc::new(update);
            let single = packed(engine, &whole, format);
            let crowds = parts.iter().map(|(_, mesh)| crowd(headless, engine, &packed(engine, mesh, format), &desc));
            let mut crowds: Vec<Crowd> = crowds.collect();
            let mut one = [crowd(headless, engine, &single, &desc)];
            for (i, frame) in frames.iter().enumerate().step_by(24) {
                set(&mut crowds, 0, &names, frame);
                one[0].set_weights(0, frame).expect("weights");
                let (poses, barriers) = step(headless, engine, &mut crowds, 0);
                assert_eq!(barriers, 2, "frame {i}: one before all, one after all");
                let (of_one, reference) = (step(headless, engine, &mut one, 0).0.remove(0), evaluate(&single, frame));
                for ((vertices, mesh), pose) in parts.iter().zip(&poses) {
                    let of_part = |whole: &[f64]| -> Vec<f64> {
                        vertices.iter().flat_map(|v| &whole[*v as usize * 6..][..6]).copied().collect()
                    };
                    let of_one: Vec<f64> = of_one.iter().copied().map(f64::from).collect();
                    for expected in [of_part(&reference), of_part(&of_one)] {
                        let error = compare(pose, &expected);
                        assert!(is_kept(&error, whole.diagonal), "frame {i}, {}: {error:?}", mesh.name);
                    }
                }
            }
        }
    });
}
