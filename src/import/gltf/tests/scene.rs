//! Nodes, skins and animations.

use super::super::assemble::{flattens, transform};
use super::super::*;
use super::written::{I16, U8, Written, bytes};
use crate::asset::{Mesh, Tolerance};
use crate::testing::head;
use deltamorph_head::HeadDesc;
use glam::{DMat4, DVec3, Mat4, Vec3};
use serde_json::json;

fn channel(property: Property, interpolation: Interpolation, times: &[f32], values: &[f32]) -> Channel {
    Channel { node: 0, property, target: None, interpolation, times: times.to_vec(), values: values.to_vec() }
}

#[test]
fn steps_and_lines() {
    let values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    let step = channel(Property::Weights, Interpolation::Step, &[1.0, 2.0, 2.0, 3.0], &values);
    let line = Channel { interpolation: Interpolation::Linear, ..step.clone() };
    // Of two keys at one time, the later one.
    for (time, stepped, straight) in [
        (f64::NAN, [0.0, 1.0], [0.0, 1.0]),
        (1.0, [0.0, 1.0], [0.0, 1.0]),
        (1.75, [0.0, 1.0], [1.5, 2.5]),
        (2.0, [4.0, 5.0], [4.0, 5.0]),
        (2.5, [4.0, 5.0], [5.0, 6.0]),
        (9.0, [6.0, 7.0], [6.0, 7.0]),
    ] {
        assert_eq!((step.sample(time), line.sample(time)), (stepped.to_vec(), straight.to_vec()), "{time}");
    }
}

#[test]
fn what_flattens_a_mesh_is_said_and_its_normals_stay_directions() {
    let source = head(&HeadDesc { vertices: 300, targets: 0, ..Default::default() }).kept(Tolerance::ZERO).unwrap();
    for scale in [DVec3::new(1.0, 0.0, 1.0), DVec3::X, DVec3::ZERO] {
        let flat = DMat4::from_scale(scale);
        assert!(flattens(&flat));
        let normals = Some(source.normals.clone());
        let mut moved = Mesh { positions: source.positions.clone(), normals, ..Mesh::default() };
        let of = |v: usize| if v < 7 { DMat4::IDENTITY } else { flat };
        assert_eq!(transform(&mut moved, of), Some(7));
        assert_eq!(moved.positions[..7], source.positions[..7]);
        assert!(moved.normals.unwrap().iter().all(|n| (n.length() - 1.0).abs() < 1e-6), "{scale}");
    }
    assert!(flattens(&DMat4::from_scale(DVec3::splat(f64::NAN))));
}

/// Two joints, the second bends; a mesh with two targets that animates.
fn arm() -> Written {
    let mut file = Written::default();
    let position = file.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 1.0, 0.0]]);
    let (joints, weights) = (
        file.accessor(U8, "VEC4", 3, &[0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0]),
        file.floats(&[[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]]),
    );
    let delta = file.floats(&[[0.0, 0.0, 1.0]; 3]);
    file.json["meshes"] = json!([{"primitives": [{
        "attributes": {"POSITION": position, "JOINTS_0": joints, "WEIGHTS_0": weights},
        "targets": [{"POSITION": delta}, {"POSITION": delta}]}], "extras": {"targetNames": ["a", "b"]}}]);
    let bind = [Mat4::from_translation(-Vec3::Y), Mat4::from_translation(Vec3::new(-1.0, -1.0, 0.0))];
    let bind = file.floats(&bind.map(|m| m.to_cols_array()));
    file.json["skins"] = json!([{"joints": [1, 2], "inverseBindMatrices": bind}]);
    file.json["nodes"] = json!([
        {"name": "mesh", "mesh": 0, "skin": 0, "weights": [0.25, 0.5], "translation": [9, 9, 9]},
        {"name": "shoulder", "translation": [0, 1, 0], "children": [2]},
        {"name": "elbow", "matrix": Mat4::from_translation(Vec3::X).to_cols_array()},
    ]);
    let (times, values) = (file.floats(&[[0.5], [1.5]]), file.floats(&[[0.0], [1.0], [1.0], [0.0]]));
    let half = (0.5f64.sqrt() * 32767.0).round() as i16;
    let turns = file.accessor(I16, "VEC4", 2, &bytes(&[0i16, 0, 0, 32767, 0, 0, half, half]));
    file.json["accessors"][turns]["normalized"] = json!(true);
    file.json["animations"] = json!([
        {"channels": [
            {"sampler": 0, "target": {"node": 0, "path": "weights"}},
            {"sampler": 1, "target": {"node": 1, "path": "rotation"}},
            {"sampler": 0, "target": {"path": "weights"}}, {"sampler": 0, "target": {"node": 0, "path": "pointer"}}],
         "samplers": [{"input": times, "output": values},
             {"input": times, "output": turns, "interpolation": "LINEAR"}]},
    ]);
    file
}

#[test]
fn clips_are_sampled_at_a_frame_rate_or_at_their_keys() {
    let mut gltf = arm().read().unwrap();
    let clip = |fps| gltf.clip(&gltf.animations[0], fps);
    // Two keys, a second apart.
    let keys = clip(Some(1.0)).unwrap();
    assert_eq!((keys.fps, keys.names.join(" "), &keys.values[..]), (1.0, "a b".to_owned(), &[0.0, 1.0, 1.0, 0.0][..]));
    assert_eq!(clip(Some(4.0)).unwrap().values, [0.0, 1.0, 0.25, 0.75, 0.5, 0.5, 0.75, 0.25, 1.0, 0.0]);
    // They are no frames: what is between them is. The last key is there, also between two frames.
    let frames = clip(None).unwrap();
    assert_eq!((frames.fps, frames.frame_count(), frames.values[30]), (30.0, 31, 0.5));
    assert_eq!(clip(Some(1.5)).unwrap().values[4..], [1.0, 0.0]);
    let animation = &gltf.animations[0];
    assert_eq!(animation.frames(2.0, 1).unwrap().collect::<Vec<_>>(), [0.5, 1.0, 1.5], "as its keys are");
    crate::testing::says(gltf.clip(&Animation::default(), None), &["no weights of morph targets"]);
    for fps in [0.0, f32::NAN, -1.0] {
        crate::testing::says(clip(Some(fps)), &["frame rate"]);
    }
    // More frames than there is room for, of weights and of joints.
    let long = "animation 'animation 0' is too long: keys from 5e-1 s to 1.5e0 s; 2^20 frames and 2^24 weights";
    crate::testing::says(clip(Some(2e6)), &["a.glb: ", long]);
    let turn = channel(Property::Rotation, Interpolation::Linear, &[0.0, 1e30], &[0.0; 8]);
    let turns = Animation { name: "turn".to_owned(), channels: vec![turn] };
    crate::testing::says(turns.frames(30.0, 1).map(|_| ()), &["'turn' is too long: keys from 0e0 s to 1e30 s"]);

    // Steps in single precision: each frame has its own key.
    let values: Vec<f32> = (0..400).map(|i| (i / 2) as f32).collect();
    for (start, step, fps) in [(0.0475, 1.0 / 30.0, 30.0), (0.0, 0.05, 20.0), (0.0, 0.0505, 30.0), (0.0, 0.01, 100.0)] {
        let times: Vec<f32> = (0..200).map(|i| start + i as f32 * step).collect();
        gltf.animations[0].channels = vec![channel(Property::Weights, Interpolation::Step, &times, &values)];
        let clip = gltf.clip(&gltf.animations[0], None).unwrap();
        assert_eq!((clip.fps, clip.values == values), (fps, step != 0.0505));
    }
    let uneven = channel(Property::Weights, Interpolation::Step, &[0.0, 0.1, 0.5], &values[..6]);
    gltf.animations[0].channels = vec![uneven];
    assert_eq!(gltf.clip(&gltf.animations[0], None).unwrap().fps, crate::import::DEFAULT_FPS);
}

#[test]
fn meshes_with_targets_are_merged_where_they_stand() {
    let mut file = Written::default();
    let corners = file.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let delta = file.floats(&[[0.0, 0.0, 1.0]; 3]);
    let mesh = |name: &str, targets: &[&str]| {
        let morphs = vec![json!({"POSITION": delta}); targets.len()];
        json!({"name": name, "extras": {"targetNames": targets},
            "primitives": [{"attributes": {"POSITION": corners}, "targets": morphs}]})
    };
    file.json["meshes"] = json!([mesh("head", &["jaw", "blink"]), mesh("eye", &[]), mesh("teeth", &["jaw"])]);
    file.json["nodes"] = json!([{"mesh": 0, "scale": [2, 2, 2]}, {"mesh": 1}, {"mesh": 2, "translation": [0, 0, 5]},
            {"mesh": 2, "scale": [-1, 1, 1]}]);
    let mut source = |notes: &[&str]| {
        let source = file.read().unwrap().into_mesh().unwrap();
        assert_eq!(source.notes, notes);
        source.kept(Tolerance::default()).unwrap();
        file.json["nodes"][0] = json!({"mesh": 0, "scale": [1, 0, 1], "name": "hid"});
        source
    };
    let merged = "merged, targets of one name moved together: 'head', 'teeth'";
    let without = "without targets, and no part of the mesh: 'eye'";
    let whole = source(&[without, merged]);
    // The teeth are there twice.
    assert_eq!((whole.positions[1], whole.positions[3]), (Vec3::X * 2.0, Vec3::Z * 5.0));
    assert_eq!((whole.positions[6], whole.faces.triangles(&whole.positions)[2]), (Vec3::ZERO, [6, 8, 7]), "mirrored");
    let targets: Vec<_> = whole.targets.iter().map(|t| (t.name.as_str(), t.positions.len())).collect();
    assert_eq!(targets, [("jaw", 9), ("blink", 3)]);
    assert_eq!((whole.targets[0].positions[0].1, whole.targets[0].positions[3]), (Vec3::Z * 2.0, (3, Vec3::Z)));
    assert_eq!(whole.welds, [0, 1, 2, 3, 4, 5, 6, 7, 8]);
    let hidden = "nodes that a scale of 0 flattens are left out: 'hid'";
    let rest = source(&[hidden, without, "not in the scene, and left out: 'head'"]);
    assert_eq!((rest.positions.len(), rest.positions[0], rest.targets.len()), (6, Vec3::Z * 5.0, 1));
    file.json["meshes"] = json!([mesh("eye", &[])]);
    file.json["nodes"] = json!([]);
    assert_eq!(file.read().unwrap().into_mesh().unwrap().positions.len(), 3);
}

/// Pointers drive weights as other channels do: of a node, of all nodes that take those of a mesh, and one of several.
#[test]
fn pointers_to_weights_are_channels() {
    let mut file = arm();
    let pointer = |sampler: usize, to: &str| {
        json!({"sampler": sampler, "target": {"path": "pointer",
            "extensions": {"KHR_animation_pointer": {"pointer": to}}}})
    };
    let times = file.json["animations"][0]["samplers"][0]["input"].clone();
    let one = file.floats(&[[0.25], [0.75]]);
    let sampler = json!({"input": times, "output": one});
    file.json["animations"][0]["samplers"].as_array_mut().unwrap().push(sampler);
    file.json["nodes"].as_array_mut().unwrap().extend([json!({"mesh": 0}), json!({"mesh": 0})]);
    let mut driven = |pointers: &[(usize, &str)]| {
        let channels: Vec<_> = pointers.iter().map(|(sampler, to)| pointer(*sampler, to)).collect();
        file.json["animations"][0]["channels"] = json!(channels);
        let gltf = file.read().unwrap();
        let channels = gltf.animations[0].channels.iter();
        let driven: Vec<_> = channels.map(|c| (c.node, c.property, c.target, c.sample(1.0).len())).collect();
        let clip = gltf.clip(&gltf.animations[0], Some(1.0)).ok().map(|clip| (clip.names.join(" "), clip.values));
        (driven, clip, gltf.notes.len())
    };
    let all = |node| (node, Property::Weights, None, 2);
    let clip = |names: &str, values: &[f32]| Some((names.to_owned(), values.to_vec()));
    let turn = (1, Property::Rotation, None, 4);
    let found = driven(&[(0, "/nodes/0/weights"), (1, "/nodes/1/rotation")]);
    assert_eq!(found, (vec![all(0), turn], clip("mesh.a mesh.b", &[0.0, 1.0, 1.0, 0.0]), 0));
    let found = driven(&[(0, "/meshes/0/weights")]);
    // What stays at rest on another node is constant.
    let values = [0.0, 1.0, 0.25, 0.5, 1.0, 0.0, 0.25, 0.5];
    assert_eq!(found, (vec![all(3), all(4)], clip("mesh 2.a mesh 2.b mesh.a mesh.b", &values), 0));
    let one = |node, target| (node, Property::Weights, Some(target), 1);
    let found = driven(&[(2, "/nodes/0/weights/1"), (2, "/meshes/0/weights/0")]);
    let values = [0.25, 0.25, 0.25, 0.75, 0.75, 0.25];
    assert_eq!(found, (vec![one(0, 1), one(3, 0), one(4, 0)], clip("mesh.b mesh 2.a mesh.a", &values), 0));
    let others =
        "nodes/0/weights/2 nodes/9/weights meshes/7/weights nodes/0/rotation/1 materials/0/weights nodes/x/weights";
    for other in others.split(' ') {
        assert_eq!(driven(&[(0, &format!("/{other}"))]), (vec![], None, 1), "{other}");
    }
}

/// Nodes that draw a mesh each have a copy, as long as the file is large enough for all of them.
#[test]
fn copies_are_bounded_by_the_size_of_the_file() {
    let mut file = Written::default();
    let lots = file.floats(&vec![[1.0f32, 2.0, 3.0]; 2001]);
    file.json["meshes"] = json!([{"name": "grass", "primitives": [{"attributes": {"POSITION": lots}}]}]);
    file.json["nodes"] = json!(vec![json!({"mesh": 0}); 3000]);
    let source = file.read().unwrap().into_mesh().unwrap();
    let copies = source.positions.len() / 2001;
    assert!((10..3000).contains(&copies), "{copies}");
    let said = format!("mesh 'grass' is drawn by 3000 nodes; since the file is small, copies are fewer: {copies}");
    assert!(source.notes.contains(&said), "{:?}", source.notes);
}

/// Meshes that no target moves are a mesh of their own.
#[test]
fn what_no_target_moves_stands_beside_the_mesh() {
    let mut file = arm();
    let attributes = json!({"POSITION": file.floats(&[[0.5, 0.0, 0.0], [1.5, 0.25, 0.0], [1.0, 1.0, -1.0]])});
    let mut mesh = |name: &str, materials: &[u32]| {
        let primitive = |material: &u32| json!({"attributes": attributes, "material": material});
        let primitives: Vec<_> = materials.iter().map(primitive).collect();
        file.json["meshes"].as_array_mut().unwrap().push(json!({"name": name, "primitives": primitives}));
    };
    mesh("glasses", &[4, 0]);
    mesh("coat", &[2]);
    mesh("spare", &[0]);
    file.json["nodes"].as_array_mut().unwrap().extend([json!({"mesh": 1}), json!({"mesh": 2})]);
    let part = |name: &str, faces, material| DrawnPart { name: name.to_owned(), faces, material: Some(material) };
    let parts = [part("glasses", 0..1, 4), part("glasses", 1..2, 0), part("coat", 2..3, 2)];
    let Scene { mesh, still } = file.read().unwrap().into_scene().unwrap();
    assert_eq!(mesh.source.positions, file.read().unwrap().into_mesh().unwrap().positions);
    let said = "without targets, and no part of the mesh: 'glasses', 'coat', 'spare'";
    assert!(mesh.source.notes.iter().any(|note| note == said), "{:?}", mesh.source.notes);
    assert_eq!(still.unwrap().parts, parts);
    // Where no mesh has targets, they are the mesh.
    file.json["meshes"][0]["primitives"][0]["targets"] = json!([]);
    file.json["animations"] = json!([]);
    let scene = file.read().unwrap().into_scene().unwrap();
    assert!(scene.still.is_none() && scene.mesh.parts.len() == 4);
}

/// A joint of scale 0 flattens what it alone moves, and huge ones move it out of range.
#[test]
fn joints_that_flatten_or_move_out_of_range_are_told() {
    let mut file = arm();
    let mut scaled = |by: f32| {
        file.json["nodes"][1] = json!({"scale": [by, by, by], "children": [2]});
        file.json["nodes"][2] = json!({"scale": [by, by, by]});
        file.read().unwrap().into_mesh()
    };
    let source = scaled(0.0).unwrap();
    let said = "joints of scale 0 flatten it, as at vertex 0";
    assert!(source.notes.iter().any(|note| note.contains(said)), "{:?}", source.notes);
    source.kept(Tolerance::ZERO).unwrap();
    crate::testing::says(scaled(3e38), &["the position of vertex 1 is ["]);
}

#[test]
fn base_colours_are_read() {
    let mut file = Written::default();
    file.json["materials"] = json!([
        {},
        {"name": "skin", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0.5, 0, 1]}},
        {"alphaMode": "MASK", "doubleSided": true},
        {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.25]}},
    ]);
    let said = |m: &Material| (m.name.clone(), m.base_color, [m.is_textured, m.is_opaque, m.double_sided]);
    let found: Vec<_> = file.read().unwrap().materials.iter().map(said).collect();
    let expected = [
        ("", [1.0; 4], [false, true, false]),
        ("skin", [1.0, 0.5, 0.0, 1.0], [true, true, false]),
        ("", [1.0; 4], [false, false, true]),
        ("", [1.0, 1.0, 1.0, 0.25], [false, false, false]),
    ];
    assert_eq!(found, expected.map(|(name, color, flags)| (name.to_owned(), color, flags)));
}
