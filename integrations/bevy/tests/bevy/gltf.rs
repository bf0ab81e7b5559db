//! A glTF file with morph targets and an animation of their weights, loaded and animated by Bevy.

use crate::probe::Probe;
use crate::scene::{Face, Scene, difference};
use crate::{ALLOWED, TURN, silent};
use bevy::animation::{AnimatedBy, AnimationTargetId};
use bevy::camera::primitives::Aabb;
use bevy::camera::visibility::VisibilityClass;
use bevy::gltf::{GltfMeshName, GltfSceneName};
use bevy::mesh::morph::{MeshMorphWeights, MorphWeights};
use bevy::prelude::*;
use bevy::world_serialization::WorldInstanceReady;
use std::fmt::Write;
use std::path::Path;
use std::sync::PoisonError;

const TARGETS: usize = 4;

/// Writes a binary glTF file of the built-in head: each target in turn goes from 0 to 1 and back, in a second each.
fn write(path: &Path) {
    let face = Face::head(900, TARGETS, 0.8).expect("a head");
    let mesh = &face.morphs;
    let (mut bytes, mut views, mut accessors) = (vec![], vec![], vec![]);
    let mut add = |data: Vec<u8>, kind: &str, component: u32, count: usize, more: &str| {
        views.push(format!(r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, bytes.len(), data.len()));
        let view = views.len() - 1;
        accessors.push(format!(
            r#"{{"bufferView":{view},"componentType":{component},"count":{count},"type":"{kind}"{more}}}"#
        ));
        bytes.extend(data);
        view
    };
    let floats = |values: &mut dyn Iterator<Item = f32>| values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    let count = mesh.vertex_count();
    let mut vectors = |dense: Vec<[f32; 3]>| {
        let corner = |of: fn(f32, f32) -> f32, from: f32| {
            let fold = |low: [f32; 3], v: &[f32; 3]| [of(low[0], v[0]), of(low[1], v[1]), of(low[2], v[2])];
            dense.iter().fold([from; 3], fold)
        };
        let bounds = format!(r#","min":{:?},"max":{:?}"#, corner(f32::min, f32::MAX), corner(f32::max, f32::MIN));
        add(floats(&mut dense.iter().flatten().copied()), "VEC3", 5126, count, &bounds)
    };
    let all = |vectors: &[deltamorph_bevy::deltamorph::glam::Vec3]| vectors.iter().map(|v| v.to_array()).collect();
    let (positions, normals) = (vectors(all(&mesh.positions)), vectors(all(&mesh.normals)));
    let mut targets = String::new();
    for target in &mesh.targets {
        let mut dense = [vec![[0.0; 3]; count], vec![[0.0; 3]; count]];
        for (i, &v) in target.vertices.iter().enumerate() {
            // Enlarged thirty times, to be visible in a small picture.
            dense[0][v as usize] = (30.0 * target.positions[i]).to_array();
            dense[1][v as usize] = target.normals[i].to_array();
        }
        let [position, normal] = dense.map(&mut vectors);
        let comma = if targets.is_empty() { "" } else { "," };
        write!(targets, r#"{comma}{{"POSITION":{position},"NORMAL":{normal}}}"#).expect("text");
    }
    let triangles = mesh.faces.triangles(&mesh.positions);
    let indices = triangles.as_flattened().iter().flat_map(|i| i.to_le_bytes()).collect();
    let indices = add(indices, "SCALAR", 5125, 3 * triangles.len(), "");
    let keys = 2 * TARGETS + 1;
    let seconds = add(
        floats(&mut (0..keys).map(|key| key as f32 / 2.0)),
        "SCALAR",
        5126,
        keys,
        &format!(r#","min":[0],"max":[{TARGETS}]"#),
    );
    let weight = |i: usize| if i / TARGETS == 2 * (i % TARGETS) + 1 { 1.0 } else { 0.0 };
    let weights = add(floats(&mut (0..keys * TARGETS).map(weight)), "SCALAR", 5126, keys * TARGETS, "");
    let mut json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"name":"head"}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{positions},"NORMAL":{normals}}},"indices":{indices},
        "targets":[{targets}]}}],"weights":{:?}}}],
        "animations":[{{"samplers":[{{"input":{seconds},"output":{weights}}}],
        "channels":[{{"sampler":0,"target":{{"node":0,"path":"weights"}}}}]}}],
        "buffers":[{{"byteLength":{}}}],"bufferViews":[{}],"accessors":[{}]}}"#,
        [0.0; TARGETS],
        bytes.len(),
        views.join(","),
        accessors.join(","),
    )
    .into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    let words = |words: [usize; 2]| words.map(|word| (word as u32).to_le_bytes()).concat();
    let length = 12 + 8 + json.len() + 8 + bytes.len();
    let file = [
        b"glTF".to_vec(),
        words([2, length]),
        words([json.len(), 0x4E4F_534A]),
        json,
        words([bytes.len(), 0x004E_4942]),
        bytes,
    ];
    std::fs::write(path, file.concat()).expect("a file");
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
        let (largest, beyond) = difference(&ours, &bevys, ALLOWED.0);
        assert!(beyond <= ALLOWED.1, "{seconds} s: {largest} of 255, {beyond} of the pixels");
        if let Some(before) = before.replace(ours) {
            let (_, moved) = difference(&before, &bevys, ALLOWED.0);
            assert!(moved > 3.0 * ALLOWED.1, "{seconds} s: {moved} of the pixels differ");
        }
    }
    silent();
}
