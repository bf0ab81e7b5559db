//! Bevy with and without deltamorph, from the same components: the same pictures and motion vectors.

mod bounds;
mod gltf;
#[allow(dead_code, reason = "its `main` is for `cargo run --example heads`")]
#[path = "../../examples/heads.rs"]
mod heads;
#[path = "../../../wgpu/tests/wgpu/layers.rs"]
mod layers;
mod posed;
mod probe;
mod scene;
mod times;
#[allow(dead_code, reason = "this program writes less than the tests of the reader do")]
#[path = "../../../../src/import/gltf/tests/written.rs"]
mod written;

use bevy::core_pipeline::prepass::MotionVectorPrepass;
use bevy::mesh::morph::MeshMorphWeights;
use bevy::mesh::{MeshAttributeCompressionFlags, MeshCompressionArgs};
use bevy::prelude::*;
use bevy::render::settings::InstanceFlags;
use deltamorph_bevy::deltamorph::glam;
use deltamorph_bevy::{BevyMorphing, DeltamorphSettings};
use layers::{listen, messages};
use probe::Probe;
use scene::{Face, Scene, SceneDesc, difference};
use std::sync::{Mutex, PoisonError};

/// One test at a time, so that layer messages can be assigned to a test.
static TURN: Mutex<()> = Mutex::new(());

/// Allowed difference of a channel, in units of 1/255, and fraction of pixels that may exceed it: outlines, and edges
/// of shadows.
const ALLOWED: (u8, f64) = (2, 0.0003);

const TARGETS: u64 = 30;

const DESC: SceneDesc = SceneDesc {
    heads: 3,
    edge: 128,
    tangents: true,
    motion: true,
    flags: InstanceFlags::VALIDATION.union(InstanceFlags::DEBUG),
};

/// Makes a scene with a probe; also returns the number of elements of the mesh's targets in Bevy.
fn scene(probe: &Probe) -> (Scene, u64) {
    scene_of(probe, &DESC)
}

fn scene_of(probe: &Probe, desc: &SceneDesc) -> (Scene, u64) {
    scene_with(probe, desc, &Face::head(1_500, TARGETS as usize, 0.12).expect("a head"))
}

fn scene_with(probe: &Probe, desc: &SceneDesc, face: &Face) -> (Scene, u64) {
    listen();
    drop(messages());
    let mut scene = Scene::new(desc, face, |app| probe.add_to(app)).expect("a scene");
    probe.lock().mesh = Some(scene.mesh.id());
    let world = scene.app.world();
    let mesh = world.resource::<Assets<Mesh>>().get(&scene.mesh).expect("a mesh");
    let elements = mesh.morph_targets().expect("targets").len() as u64;
    scene.settle();
    (scene, elements)
}

fn silent() {
    let messages = messages();
    assert!(messages.is_empty(), "the layers say:\n{}", messages.join("\n"));
}

/// Asserts that these pictures are the same, but for a few pixels.
fn assert_same(ours: &[u8], bevys: &[u8], what: &str) {
    let (largest, beyond) = difference(ours, bevys, ALLOWED.0);
    assert!(beyond <= ALLOWED.1, "{what}: {largest} of 255, {beyond} of the pixels beyond {}", ALLOWED.0);
}

/// Asserts that they are not: otherwise comparisons would be meaningless.
fn assert_moved(before: &[u8], now: &[u8], what: &str) {
    let (_, moved) = difference(before, now, ALLOWED.0);
    assert!(moved > 10.0 * ALLOWED.1, "{what}: {moved} of the pixels differ");
}

#[test]
fn pictures_are_bevys_and_targets_leave_the_device() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let probe = Probe::default();
    let (mut scene, all) = scene(&probe);
    let room = |heads: u64| 2 * heads * all / TARGETS;
    assert_eq!(probe.lock().elements, room(3));

    let mut before: Option<Vec<u8>> = None;
    for frame in [10, 25, 60] {
        scene.show(frame);
        let ours = scene.picture().expect("a picture");
        assert_eq!(probe.lock().elements, room(3));
        scene.morph_by_bevy(true);
        let bevys = scene.picture().expect("a picture");
        assert_eq!(probe.lock().elements, all);
        scene.morph_by_bevy(false);
        assert_eq!(ours.len() as u32, 4 * DESC.edge * DESC.edge);
        assert_same(&ours, &bevys, &format!("frame {frame}"));
        if let Some(before) = before.replace(ours) {
            assert_moved(&before, &bevys, &format!("frame {frame}"));
        }
    }

    scene.settle();
    assert_eq!(probe.lock().elements, room(3));

    // More heads of the same mesh, each with the weights of the first, so that the room grows.
    let first = scene.heads[0];
    for i in 0..2 {
        let mut copy = scene.app.world_mut().entity_mut(first);
        let copy = copy.clone_and_spawn();
        scene.app.world_mut().entity_mut(copy).insert(Transform::from_xyz(0.0, 0.0, 10.0 * i as f32));
        scene.heads.push(copy);
    }
    scene.show(33);
    let ours = scene.picture().expect("a picture");
    assert_eq!(probe.lock().elements, room(6), "twice as much as before");
    // A head is removed, another one added, which reuses its instance. It stands elsewhere than the first: where two
    // surfaces coincide, rounding decides which of them is seen.
    let gone = scene.heads.remove(1);
    let place = *scene.app.world().get::<Transform>(gone).expect("a place");
    scene.app.world_mut().despawn(gone);
    let mut other = scene.app.world_mut().entity_mut(first);
    let other = other.clone_and_spawn();
    scene.app.world_mut().entity_mut(other).insert(place);
    scene.heads.push(other);
    scene.show(47);
    let again = scene.picture().expect("a picture");
    assert_eq!(probe.lock().elements, room(6));

    // One head to be morphed by Bevy switches the whole mesh.
    scene.app.world_mut().entity_mut(first).insert(BevyMorphing);
    let bevys = scene.picture().expect("a picture");
    assert_eq!(probe.lock().elements, all);
    assert_same(&again, &bevys, "another head");
    assert_moved(&ours, &bevys, "another head");
    silent();
}

#[test]
fn a_head_alone_has_its_pose_in_the_vertices_of_its_mesh() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let probe = Probe::default();
    let (mut scene, _) = scene_of(&probe, &SceneDesc { heads: 1, motion: false, ..DESC });
    let mesh = scene.app.world().resource::<Assets<Mesh>>().get(&scene.mesh).expect("a mesh");
    let base = mesh.create_packed_vertex_buffer_data();
    probe.lock().vertices.resize(base.len(), 0);
    let mut before: Option<Vec<u8>> = None;
    let mut look = |scene: &mut Scene, frame, is_posed| {
        scene.show(frame);
        let ours = scene.picture().expect("a picture");
        assert_eq!(probe.lock().vertices != base, is_posed, "frame {frame}");
        scene.morph_by_bevy(true);
        let bevys = scene.picture().expect("a picture");
        assert_eq!(probe.lock().vertices, base, "frame {frame}");
        scene.morph_by_bevy(false);
        scene.settle();
        assert_eq!(probe.lock().vertices != base, is_posed, "frame {frame}, again");
        assert_same(&ours, &bevys, &format!("frame {frame}"));
        if let Some(before) = before.replace(ours) {
            assert_moved(&before, &bevys, &format!("frame {frame}"));
        }
    };
    look(&mut scene, 10, true);
    look(&mut scene, 25, true);

    // A head without weights beside it shows the base pose.
    let world = scene.app.world_mut();
    let other = world.entity_mut(scene.heads[0]).clone_and_spawn();
    world.entity_mut(other).remove::<MeshMorphWeights>().insert(Transform::from_xyz(0.4, 0.0, -0.5));
    look(&mut scene, 60, false);
    scene.app.world_mut().despawn(other);
    look(&mut scene, 33, true);

    // Motion vectors also read the previous pose.
    let world = scene.app.world_mut();
    let camera = world.query_filtered::<Entity, With<Camera3d>>().single(world).expect("a camera");
    world.entity_mut(camera).insert(MotionVectorPrepass);
    look(&mut scene, 47, false);
    scene.app.world_mut().entity_mut(camera).remove::<MotionVectorPrepass>();
    look(&mut scene, 5, true);
    silent();
}

#[test]
fn normal_errors_of_targets_add_up_and_can_be_set() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let probe = Probe::default();
    let mut face = Face::head(1_500, TARGETS as usize, 0.8).expect("a head");
    // Each target turns normals by less than the default error, all of them by 12° in the same direction.
    for target in &mut face.morphs.targets {
        target.normals.fill(glam::Vec3::X * 0.4_f32.to_radians());
    }
    face.clip = vec![vec![1.0; TARGETS as usize]];
    let (mut scene, _) = scene_with(&probe, &SceneDesc { heads: 1, tangents: false, motion: false, ..DESC }, &face);
    let mut look = |is_bevys, degrees| {
        scene.morph_by_bevy(is_bevys);
        scene.app.world_mut().resource_mut::<DeltamorphSettings>().normal_error_degrees = degrees;
        scene.picture().expect("a picture")
    };
    let (bevys, coarse, fine) = (look(true, 0.5), look(false, 0.5), look(false, 0.02));
    assert_same(&fine, &bevys, "small errors");
    assert_moved(&coarse, &bevys, "large ones");
    silent();
}

#[test]
fn motion_vectors_are_bevys() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let probe = Probe::default();
    let (mut scene, all) = scene(&probe);
    let mut play = |is_bevys| {
        scene.morph_by_bevy(is_bevys);
        scene.show(0);
        scene.settle();
        probe.lock().motion.clear();
        // The same weights twice: nothing moves in that frame.
        for frame in [4, 8, 8, 16, 12] {
            scene.show(frame);
            scene.app.update();
        }
        scene.settle();
        assert_eq!(probe.lock().elements == all, is_bevys);
        std::mem::take(&mut probe.lock().motion)
    };
    let (ours, bevys) = (play(false), play(true));
    assert_eq!((ours.len(), bevys.len()), (4, 4), "frames in which anything moves");
    // Pixels whose motion differs by more than a hundredth of the fastest.
    let differ = |a: &[[f32; 2]], b: &[[f32; 2]]| {
        let fastest = b.iter().flatten().fold(0.0_f32, |fastest, speed| fastest.max(speed.abs()));
        let apart = |(a, b): &(&[f32; 2], &[f32; 2])| a.iter().zip(*b).any(|(a, b)| (a - b).abs() > 0.01 * fastest);
        a.iter().zip(b).filter(apart).count() as f64 / b.len() as f64
    };
    for (i, (ours, bevys)) in ours.iter().zip(&bevys).enumerate() {
        assert!(differ(ours, bevys) <= ALLOWED.1, "frame {i}: {} of the pixels", differ(ours, bevys));
    }
    assert!(differ(&ours[0], &bevys[1]) > 10.0 * ALLOWED.1, "or it would say nothing");
    silent();
}

#[test]
fn what_cannot_be_taken_stays_with_bevy() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let probe = Probe::default();
    let (mut scene, all) = scene(&probe);
    let mut compressed = MeshCompressionArgs::none();
    compressed.compress_attributes = MeshAttributeCompressionFlags::COMPRESS_POSITION;
    let mut meshes = scene.app.world_mut().resource_mut::<Assets<Mesh>>();
    let mesh = meshes.get(&scene.mesh).expect("a mesh").clone();
    let mesh = mesh.compressed_mesh(&compressed).expect("one that can be compressed");
    *meshes.get_mut(&scene.mesh).expect("a mesh") = mesh;
    scene.settle();
    assert_eq!(probe.lock().elements, all);
    silent();
}
