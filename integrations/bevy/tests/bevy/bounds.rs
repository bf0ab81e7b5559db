//! Bevy culls by the boxes of poses, and tests rays with them.

use crate::posed::posed;
use crate::probe::Probe;
use crate::scene::{Face, Scene, SceneDesc, difference};
use crate::{ALLOWED, DESC, TARGETS, TURN, assert_same, scene_with, silent};
use bevy::camera::primitives::Aabb;
use bevy::camera::visibility::{DynamicSkinnedMeshBounds, NoAutoAabb, NoFrustumCulling};
use bevy::ecs::system::RunSystemOnce;
use bevy::mesh::VertexAttributeValues;
use bevy::mesh::morph::MeshMorphWeights;
use bevy::mesh::skinning::{SkinnedMesh, SkinnedMeshInverseBindposes};
use bevy::picking::mesh_picking::ray_cast::{MeshRayCast, MeshRayCastSettings, SimplifiedMesh};
use bevy::prelude::*;
use deltamorph_bevy::BevyMorphing;
use deltamorph_bevy::deltamorph::glam;
use std::sync::PoisonError;

/// Makes a scene of heads with a target that moves all of them to the left, far out of the picture; also returns the
/// distance.
fn far(heads: usize) -> (Scene, f32) {
    let mut face = Face::head(1_500, TARGETS as usize, 0.12).expect("a head");
    let way = 15.0 * face.morphs.diagonal;
    let (count, target) = (face.morphs.vertex_count(), &mut face.morphs.targets[0]);
    target.vertices = (0..count as u32).collect();
    target.positions = vec![glam::Vec3::NEG_X * way; count];
    target.normals = vec![glam::Vec3::ZERO; count];
    let desc = SceneDesc { heads, tangents: false, motion: false, ..DESC };
    let mut scene = scene_with(&Probe::default(), &desc, &face).0;
    each(&mut scene, |head| head.get_mut::<Transform>().expect("a place").rotation = Quat::IDENTITY);
    // A single texel of their maps, which are coarse, is many pixels.
    let world = scene.app.world_mut();
    for mut light in world.query::<&mut DirectionalLight>().iter_mut(world) {
        light.shadow_maps_enabled = false;
    }
    pose(&mut scene, 0.0);
    (scene, way)
}

/// Sets the weight of that target.
fn pose(scene: &mut Scene, weight: f32) {
    scene.clip = vec![[&[weight], &[0.0; TARGETS as usize - 1][..]].concat()];
    scene.show(0);
    scene.settle();
}

/// Changes all heads.
fn each(scene: &mut Scene, change: impl Fn(&mut EntityWorldMut)) {
    scene.heads.iter().for_each(|head| change(&mut scene.app.world_mut().entity_mut(*head)));
    scene.settle();
}

fn move_by(scene: &mut Scene, x: f32) {
    each(scene, |head| head.get_mut::<Transform>().expect("a place").translation.x += x);
}

/// Returns a component of the first head.
fn first<C: Component + Clone>(scene: &Scene) -> C {
    scene.app.world().get::<C>(scene.heads[0]).expect("a component").clone()
}

#[test]
fn heads_are_culled_by_their_poses() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let (mut scene, way) = far(2);
    let by_bevy = |scene: &mut Scene, is_bevys: bool| {
        each(scene, |head| _ = if is_bevys { head.insert(BevyMorphing) } else { head.remove::<BevyMorphing>() });
    };
    let seen = |scene: &Scene| {
        let is_seen = |head: &&Entity| scene.app.world().get::<ViewVisibility>(**head).expect("visibility").get();
        scene.heads.iter().filter(is_seen).count()
    };
    // Heads in the middle, with a pose far to the left.
    pose(&mut scene, 1.0);
    let nothing = scene.picture().expect("a picture");
    assert_eq!(seen(&scene), 0, "drawn while far away");
    by_bevy(&mut scene, true);
    assert_eq!(seen(&scene), 2, "Bevy goes by the mesh");

    // Heads far to the right, with a pose in the middle.
    move_by(&mut scene, way);
    let pixels = |scene: &mut Scene| {
        let (_, differ) = difference(&scene.picture().expect("a picture"), &nothing, ALLOWED.0);
        (differ * f64::from(DESC.edge * DESC.edge)) as u32
    };
    assert_eq!((seen(&scene), pixels(&mut scene)), (0, 0), "Bevy goes by the mesh");
    by_bevy(&mut scene, false);
    let drawn = pixels(&mut scene);
    assert!(seen(&scene) == 2 && drawn > 3_000, "{} heads in {drawn} pixels", seen(&scene));
    let ours = scene.picture().expect("a picture");
    for visibility in [Visibility::Hidden, Visibility::Inherited] {
        each(&mut scene, |head| _ = head.insert(visibility));
    }
    assert_same(&ours, &scene.picture().expect("a picture"), "heads that were hidden");
    each(&mut scene, |head| _ = head.insert((BevyMorphing, NoFrustumCulling)));
    assert_same(&ours, &scene.picture().expect("a picture"), "what Bevy draws without culling");
    silent();
}

#[test]
fn boxes_follow_components() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let (mut scene, way) = far(1);
    let place = |scene: &Scene| first::<Aabb>(scene).center.x / way;
    let near = |x: f32, expected: f32| (x - expected).abs() < 0.01;
    assert!(near(place(&scene), 0.0));
    pose(&mut scene, 0.5);
    assert!(near(place(&scene), -0.5));
    pose(&mut scene, 5.0);
    assert!(near(place(&scene), -0.5), "the weight is refused");
    pose(&mut scene, 1.0);
    // A second head needs more room, for which the mesh is extracted again.
    let (head, world) = (scene.heads[0], scene.app.world_mut());
    scene.heads.push(world.entity_mut(head).clone_and_spawn());
    for _ in 0..5 {
        scene.app.update();
        assert!(near(place(&scene), -1.0), "{} in between", place(&scene));
    }
    let weights: MeshMorphWeights = first(&scene);
    each(&mut scene, |head| _ = head.remove::<MeshMorphWeights>());
    assert!(near(place(&scene), 0.0), "the mesh is shown as it is");
    each(&mut scene, |head| _ = head.insert(weights.clone()));
    assert!(near(place(&scene), -1.0));
    scene.morph_by_bevy(true);
    scene.settle();
    assert!(near(place(&scene), 0.0), "Bevy's own");
    scene.morph_by_bevy(false);
    scene.settle();
    assert!(near(place(&scene), -1.0));
    let own = Aabb::from_min_max(Vec3::ZERO, Vec3::X * way);
    each(&mut scene, |head| _ = head.insert((own, NoAutoAabb)));
    pose(&mut scene, 0.5);
    assert_eq!(first::<Aabb>(&scene), own);
    silent();
}

#[test]
fn boxes_of_skinned_heads_grow() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let (mut scene, way) = far(1);
    let world = scene.app.world_mut();
    let joint = world.spawn(Transform::from_rotation(Quat::from_rotation_z(2.0))).id();
    let inverse_bindposes = world
        .resource_mut::<Assets<SkinnedMeshInverseBindposes>>()
        .add(SkinnedMeshInverseBindposes::from(vec![Mat4::IDENTITY]));
    let mut meshes = world.resource_mut::<Assets<Mesh>>();
    let mesh = meshes.get_mut(&scene.mesh).expect("a mesh").into_inner();
    let count = mesh.count_vertices();
    mesh.insert_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, VertexAttributeValues::Uint16x4(vec![[0; 4]; count]));
    mesh.insert_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, vec![[1.0, 0.0, 0.0, 0.0]; count]);
    mesh.generate_skinned_mesh_bounds().expect("joints");
    let mesh = mesh.clone();
    let skin = SkinnedMesh { inverse_bindposes, joints: vec![joint] };
    each(&mut scene, |head| _ = head.insert((skin.clone(), DynamicSkinnedMeshBounds)));

    let is_inside = |scene: &Scene, weight: f32| {
        let of_joint = scene.app.world().get::<GlobalTransform>(joint).expect("a place").affine();
        let to_entity = first::<GlobalTransform>(scene).affine().inverse() * of_joint;
        let (aabb, posed): (Aabb, _) = (first(scene), posed(&mesh, &[weight]).expect("a pose"));
        let positions = posed.attribute(Mesh::ATTRIBUTE_POSITION).and_then(|all| all.as_float3()).expect("positions");
        let mut places = positions.iter().map(|at| to_entity.transform_point3a(Vec3::from(*at).into()) - aabb.center);
        places.all(|place| place.abs().cmple(aabb.half_extents + 1e-5 * way).all())
    };
    for is_dynamic in [true, false] {
        if !is_dynamic {
            each(&mut scene, |head| _ = head.remove::<DynamicSkinnedMeshBounds>());
        }
        scene.morph_by_bevy(true);
        scene.settle();
        let bevys: Aabb = first(&scene);
        scene.morph_by_bevy(false);
        pose(&mut scene, 1.0);
        let grown: Aabb = first(&scene);
        assert!(is_inside(&scene, 1.0), "{grown:?}");
        scene.settle();
        assert_eq!(first::<Aabb>(&scene), grown, "boxes do not add up");
        pose(&mut scene, 0.0);
        let again: Aabb = first(&scene);
        assert!((again.half_extents - bevys.half_extents).length() < 1e-4 * way, "{again:?}, not {bevys:?}");
        pose(&mut scene, 1.0);
        scene.morph_by_bevy(true);
        scene.settle();
        assert!(!is_inside(&scene, 1.0), "{:?} is Bevy's", first::<Aabb>(&scene));
        scene.morph_by_bevy(false);
        pose(&mut scene, 0.0);
    }
    silent();
}

#[test]
fn rays_hit_poses_that_bevy_is_given() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let (mut scene, way) = far(1);
    let hit = |scene: &mut Scene| {
        let head = scene.heads[0];
        let cast = move |mut rays: MeshRayCast| {
            let is_head = |entity| entity == head;
            let settings = MeshRayCastSettings::default().with_filter(&is_head);
            rays.cast_ray(Ray3d::new(Vec3::Z * way, Dir3::NEG_Z), &settings).first().map(|(_, hit)| hit.point)
        };
        scene.app.world_mut().run_system_once(cast).expect("a system")
    };
    let face = hit(&mut scene).expect("a face in the middle");
    pose(&mut scene, 1.0);
    move_by(&mut scene, way);
    assert_eq!(hit(&mut scene), None, "Bevy reads the mesh");
    let mut meshes = scene.app.world_mut().resource_mut::<Assets<Mesh>>();
    let posed = posed(meshes.get(&scene.mesh).expect("a mesh"), &scene.clip[0]).expect("a pose");
    let posed = SimplifiedMesh(meshes.add(posed));
    each(&mut scene, |head| _ = head.insert(posed.clone()));
    let again = hit(&mut scene).expect("the pose is in the middle");
    assert!((again - face).length() < 1e-4 * way, "{again}, not {face}");
    assert!(include_str!("../../README.md").contains(include_str!("posed.rs")), "the README shows that function");
    silent();
}
