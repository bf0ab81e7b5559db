//! A glTF file with morph targets and an animation of their weights, loaded and animated by Bevy.

use crate::probe::Probe;
use crate::scene::{Face, Scene, difference};
use crate::written::{Written, bytes};
use crate::{ALLOWED, TURN, assert_same, silent};
use bevy::animation::{AnimatedBy, AnimationTargetId};
use bevy::camera::primitives::Aabb;
use bevy::camera::visibility::VisibilityClass;
use bevy::gltf::{GltfMeshName, GltfSceneName};
use bevy::mesh::morph::{MeshMorphWeights, MorphWeights};
use bevy::prelude::*;
use bevy::world_serialization::WorldInstanceReady;
use deltamorph_bevy::deltamorph::glam;
use serde_json::json;
use std::path::Path;
use std::sync::PoisonError;

const TARGETS: usize = 4;

/// Writes a binary glTF file of the built-in head: each target in turn goes from 0 to 1 and back, in a second each.
fn write(path: &Path) {
    let mesh = Face::head(900, TARGETS, 0.8).expect("a head").morphs;
    let mut file = Written::default();
    let mut vectors = |vectors: &[glam::Vec3]| {
        let accessor = file.floats(&vectors.iter().map(|v| v.to_array()).collect::<Vec<_>>());
        let corner = |of: fn(glam::Vec3, glam::Vec3) -> glam::Vec3| {
            json!(vectors.iter().copied().reduce(of).expect("vertices").to_array())
        };
        file.json["accessors"][accessor]["min"] = corner(glam::Vec3::min);
        file.json["accessors"][accessor]["max"] = corner(glam::Vec3::max);
        accessor
    };
    let (positions, normals) = (vectors(&mesh.positions), vectors(&mesh.normals));
    let mut targets = vec![];
    for target in &mesh.targets {
        let [mut position, mut normal] = [(); 2].map(|()| vec![glam::Vec3::ZERO; mesh.vertex_count()]);
        for (i, &v) in target.vertices.iter().enumerate() {
            // Enlarged thirty times, to be visible in a small picture.
            position[v as usize] = 30.0 * target.positions[i];
            normal[v as usize] = target.normals[i];
        }
        targets.push(json!({"POSITION": vectors(&position), "NORMAL": vectors(&normal)}));
    }
    let triangles = mesh.faces.triangles(&mesh.positions);
    let indices = file.accessor(5125, "SCALAR", 3 * triangles.len(), &bytes(triangles.as_flattened()));
    let keys = 2 * TARGETS + 1;
    let seconds = file.floats(&(0..keys).map(|key| [key as f32 / 2.0]).collect::<Vec<_>>());
    file.json["accessors"][seconds]["min"] = json!([0.0]);
    file.json["accessors"][seconds]["max"] = json!([TARGETS as f32]);
    let weight = |i: usize| if i / TARGETS == 2 * (i % TARGETS) + 1 { [1.0] } else { [0.0] };
    let weights = file.floats(&(0..keys * TARGETS).map(weight).collect::<Vec<_>>());
    file.json["meshes"] = json!([{"weights": vec![0.0; TARGETS], "primitives": [{"indices": indices, "targets": targets,
        "attributes": {"POSITION": positions, "NORMAL": normals}}]}]);
    file.json["nodes"] = json!([{"mesh": 0, "name": "head"}]);
    file.json["scenes"] = json!([{"nodes": [0]}]);
    file.json["scene"] = json!(0);
    file.json["animations"] = json!([{"samplers": [{"input": seconds, "output": weights}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}]);
    std::fs::write(path, file.glb()).expect("a file");
}

#[derive(Component)]
struct Playing(AnimationNodeIndex);

fn play(
    ready: On<WorldInstanceReady>,
    children: Query<&Children>,
    playing: Query<(&Playing, &AnimationGraphHandle)>,
    mut players: Query<&mut AnimationPlayer>,
    mut commands: Commands,
) {
    let (Playing(node), graph) = playing.get(ready.entity).expect("what is played");
    for child in children.iter_descendants(ready.entity) {
        if let Ok(mut player) = players.get_mut(child) {
            player.play(*node).pause();
            commands.entity(child).insert(graph.clone());
        }
    }
}

/// Registers the types of such a scene; `reflect_auto_register`, on by default in applications, does this for all
/// types.
fn register(app: &mut App) {
    app.register_type::<Transform>().register_type::<GlobalTransform>().register_type::<TransformTreeChanged>();
    app.register_type::<Visibility>().register_type::<InheritedVisibility>().register_type::<ViewVisibility>();
    app.register_type::<VisibilityClass>().register_type::<Aabb>().register_type::<Name>();
    app.register_type::<Children>().register_type::<ChildOf>();
    app.register_type::<Mesh3d>().register_type::<MeshMaterial3d<StandardMaterial>>();
    app.register_type::<MorphWeights>().register_type::<MeshMorphWeights>();
    app.register_type::<AnimationPlayer>().register_type::<AnimationTargetId>().register_type::<AnimatedBy>();
    app.register_type::<GltfMeshName>().register_type::<GltfSceneName>();
}

#[test]
fn a_gltf_file_that_bevy_loads_and_animates_is_morphed_alike() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("head.glb");
    write(&path);
    let probe = Probe::default();
    let (mut scene, _) = crate::scene(&probe);
    // Replaces the head in the middle.
    let head = scene.heads.remove(0);
    register(&mut scene.app);
    let world = scene.app.world_mut();
    let place = *world.entity(head).get::<Transform>().expect("a place");
    world.despawn(head);
    let server = world.resource::<AssetServer>().clone();
    let clip = server.load(GltfAssetLabel::Animation(0).from_asset(path.clone()));
    let (graph, node) = AnimationGraph::from_clip(clip);
    let graph = AnimationGraphHandle(world.resource_mut::<Assets<AnimationGraph>>().add(graph));
    let root = WorldAssetRoot(server.load(GltfAssetLabel::Scene(0).from_asset(path)));
    world.spawn((root, Playing(node), graph, place)).observe(play);
    let players = |scene: &mut Scene| {
        let world = scene.app.world_mut();
        world.query::<&AnimationPlayer>().iter(world).filter(|player| player.is_playing_animation(node)).count()
    };
    for _ in 0..2_000 {
        if players(&mut scene) > 0 {
            break;
        }
        scene.app.update();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert_eq!(players(&mut scene), 1, "Bevy loads the file within ten seconds");
    let world = scene.app.world_mut();
    let mut shown = world.query_filtered::<&Mesh3d, With<MeshMorphWeights>>();
    let mut meshes = shown.iter(world).map(|mesh| mesh.id());
    let mesh = meshes.find(|id| *id != scene.mesh.id()).expect("that of the file");
    let vertices = world.resource::<Assets<Mesh>>().get(mesh).expect("a mesh").count_vertices();
    probe.lock().mesh = Some(mesh);
    let elements = |targets: usize| (targets * vertices) as u64;

    let mut before: Option<Vec<u8>> = None;
    for seconds in [0.5, 1.6, 3.4] {
        let world = scene.app.world_mut();
        for mut player in world.query::<&mut AnimationPlayer>().iter_mut(world) {
            player.animation_mut(node).expect("it plays").seek_to(seconds);
        }
        let ours = scene.picture().expect("a picture");
        assert_eq!(probe.lock().elements, elements(2), "deltamorph morphs it");
        let world = scene.app.world_mut();
        let mut all = world.query::<&MorphWeights>();
        let weights = all.iter(world).map(|weights| weights.weights().to_vec());
        let of_file: Vec<_> = weights.filter(|weights| weights.len() == TARGETS).collect();
        let mut expected = [0.0; TARGETS];
        let whole = seconds as usize;
        expected[whole] = 1.0 - (2.0 * (seconds - whole as f32) - 1.0).abs();
        let near = of_file[0].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(of_file.len() == 1 && near, "{of_file:?} at {seconds} s, not {expected:?}");
        scene.morph_by_bevy(true);
        let bevys = scene.picture().expect("a picture");
        assert_eq!(probe.lock().elements, elements(TARGETS));
        scene.morph_by_bevy(false);
        assert_same(&ours, &bevys, &format!("{seconds} s"));
        if let Some(before) = before.replace(ours) {
            let (_, moved) = difference(&before, &bevys, ALLOWED.0);
            assert!(moved > 3.0 * ALLOWED.1, "{seconds} s: {moved} of the pixels differ");
        }
    }
    silent();
}
