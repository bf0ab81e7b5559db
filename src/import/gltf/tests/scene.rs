//! Nodes, skins and animations.

use super::super::assemble::{flattens, transform};
use super::super::*;
use super::written::{I16, U8, Written, bytes};
use crate::asset::{MorphSource, Tolerance};
use crate::testing::head;
use deltamorph_head::HeadDesc;
use glam::{DMat4, DQuat, DVec3, Mat4, Quat, Vec3};
use proptest::prelude::*;
use serde_json::json;

fn channel(property: Property, interpolation: Interpolation, times: &[f32], values: &[f32]) -> Channel {
    Channel { node: 0, property, target: None, interpolation, times: times.to_vec(), values: values.to_vec() }
}

#[test]
fn steps_lines_and_arcs() {
    let step = channel(
        Property::Weights,
        Interpolation::Step,
        &[1.0, 2.0, 2.0, 3.0],
        &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0],
    );
    let line = Channel { interpolation: Interpolation::Linear, ..step.clone() };
    for (time, stepped, straight) in [
        (-1.0, [0.0, 1.0], [0.0, 1.0]),
        (1.0, [0.0, 1.0], [0.0, 1.0]),
        (1.75, [0.0, 1.0], [1.5, 2.5]),
        // Of two keys at one time, the later one.
        (2.0, [4.0, 5.0], [4.0, 5.0]),
        (2.5, [4.0, 5.0], [5.0, 6.0]),
        (9.0, [6.0, 7.0], [6.0, 7.0]),
        (f64::NAN, [0.0, 1.0], [0.0, 1.0]),
    ] {
        assert_eq!((step.sample(time), line.sample(time)), (stepped.to_vec(), straight.to_vec()), "{time}");
    }
    // A turn of 60° about z, the second key with the sign that means the same rotation.
    let end = Quat::from_rotation_z(60f32.to_radians()).to_array();
    let keys = [[0.0, 0.0, 0.0, 1.0], end.map(|x| -x)].concat();
    let arc = channel(Property::Rotation, Interpolation::Linear, &[0.0, 1.0], &keys);
    for t in [0.0, 0.1, 0.5, 0.9, 1.0f64] {
        let expected = DQuat::from_rotation_z(t * 60f64.to_radians());
        assert!(DQuat::from_slice(&arc.sample(t)).dot(expected).abs() > 1.0 - 1e-6, "{t}");
    }
}

proptest! {
    /// The effect of a node on a mesh: normals are those of the transformed surface, however the node mirrors and
    /// stretches.
    #[test]
    fn a_transformed_mesh_is_the_mesh_of_transformed_poses(
        scale in prop::array::uniform3(prop_oneof![-3.0f64..-0.3, 0.3f64..3.0]),
        turn in prop::array::uniform3(-3.0f64..3.0), weight in 0.0f32..1.0,
    ) {
        let source = head(&HeadDesc::default().vertices(300).targets(2));
        let triangles = source.faces.triangles(&source.positions);
        // In the form of a file: triangles, and normals with their deltas.
        let built = source.to_mesh(Tolerance::ZERO).unwrap();
        let mut moved = MorphSource { normals: Some(built.normals.clone()), texcoords: vec![], ..source };
        let corner = |position| crate::mesh::Corner { position, texcoord: None };
        moved.faces = crate::mesh::Faces { sizes: vec![3; triangles.len()],
            corners: triangles.into_iter().flatten().map(corner).collect() };
        for (target, built) in moved.targets.iter_mut().zip(&built.targets) {
            target.normals = Some(built.vertices.iter().copied().zip(built.normals.iter().copied()).collect());
        }
        let original = moved.clone();
        let rotation = DQuat::from_euler(glam::EulerRot::XYZ, turn[0], turn[1], turn[2]);
        let matrix = DMat4::from_scale_rotation_translation(DVec3::from(scale), rotation, DVec3::new(1.0, -2.0, 3.0));
        prop_assert_eq!(transform(&mut moved, |_| matrix), None);
        let pose = |source: &MorphSource| {
            crate::reference::evaluate_unpacked(&source.to_mesh(Tolerance::ZERO).unwrap(), &[weight, 0.5])
        };
        let vector = |v: &[f64]| DVec3::from_slice(v);
        let inverse = glam::DMat3::from_mat4(matrix).inverse().transpose();
        for (a, b) in pose(&original).chunks_exact(6).zip(pose(&moved).chunks_exact(6)) {
            prop_assert!((matrix.transform_point3(vector(&a[..3])) - vector(&b[..3])).length() < 1e-4);
            prop_assert!((inverse * vector(&a[3..])).normalize().dot(vector(&b[3..]).normalize()) > 1.0 - 1e-5);
        }
        // Triangles still face the way normals do.
        let computed = MorphSource { normals: None, ..moved.clone() }.to_mesh(Tolerance::ZERO).unwrap();
        let pairs = computed.normals.iter().zip(moved.normals.as_ref().unwrap());
        let agree = pairs.filter(|(a, b)| a.dot(**b) > 0.0).count();
        prop_assert!(agree * 10 > computed.normals.len() * 9, "{} of {}", agree, computed.normals.len());
    }
}

#[test]
fn what_flattens_a_mesh_is_said_and_its_normals_stay_directions() {
    let source = head(&HeadDesc::default().vertices(300).targets(0)).to_mesh(Tolerance::ZERO).unwrap();
    for scale in [DVec3::new(1.0, 0.0, 1.0), DVec3::X, DVec3::ZERO] {
        let flat = DMat4::from_scale(scale);
        assert!(flattens(&flat));
        let normals = Some(source.normals.clone());
        let mut moved = MorphSource { positions: source.positions.clone(), normals, ..MorphSource::default() };
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
    let file = arm();
    let gltf = file.read().unwrap();
    let clip = |fps| gltf.clip(&gltf.animations[0], fps).unwrap();
    // Two keys, a second apart.
    let keys = clip(Some(1.0));
    assert_eq!(
        (keys.fps, &keys.names[..], &keys.values[..]),
        (1.0, &["a".to_owned(), "b".to_owned()][..], &[0.0, 1.0, 1.0, 0.0][..])
    );
    assert_eq!(clip(Some(4.0)).values, [0.0, 1.0, 0.25, 0.75, 0.5, 0.5, 0.75, 0.25, 1.0, 0.0]);
    // They are no frames: what is between them is.
    let frames = clip(None);
    assert_eq!((frames.fps, frames.frame_count(), frames.values[30]), (30.0, 31, 0.5));
    // The last key is there, also between two frames.
    assert_eq!(clip(Some(1.5)).values[4..], [1.0, 0.0]);
    for fps in [0.0, f32::NAN, -1.0] {
        assert!(gltf.clip(&gltf.animations[0], Some(fps)).unwrap_err().to_string().contains("frame rate"));
    }
    let refused = gltf.clip(&gltf.animations[0], Some(1e9)).unwrap_err().to_string();
    assert!(refused.starts_with("a.glb: animation 'animation 0': more than 2^24 weights; "), "{refused}");
    assert!(gltf.clip(&Animation::default(), None).unwrap_err().to_string().contains("no weights of morph targets"));

    // Steps at 30 frames per second, in single precision: each frame has its own key.
    let times: Vec<f32> = (0..200).map(|i| 0.0475 + i as f32 / 30.0).collect();
    let values: Vec<f32> = (0..400).map(|i| (i / 2) as f32).collect();
    let mut steps = gltf.clone();
    steps.animations[0].channels = vec![channel(Property::Weights, Interpolation::Step, &times, &values)];
    let clip = steps.clip(&steps.animations[0], None).unwrap();
    assert_eq!((clip.fps, &clip.values), (30.0, &values));
    for (step, expected) in [(0.05, 20.0), (0.0505, 30.0), (0.01, 100.0)] {
        let times: Vec<f32> = (0..200).map(|i| i as f32 * step).collect();
        steps.animations[0].channels = vec![channel(Property::Weights, Interpolation::Step, &times, &values)];
        assert_eq!(steps.clip(&steps.animations[0], None).unwrap().fps, expected);
    }
    let animation = &gltf.animations[0];
    assert_eq!(animation.frame_times(Some(2.0)).collect::<Vec<_>>(), [0.5, 1.0, 1.5], "as its keys are");
    assert_eq!(animation.frame_times(None).len(), 31, "keys a second apart are no frames");
    let uneven = channel(Property::Weights, Interpolation::Step, &[0.0, 0.1, 0.5], &values[..6]);
    steps.animations[0].channels = vec![uneven];
    assert_eq!(steps.clip(&steps.animations[0], None).unwrap().fps, crate::import::DEFAULT_FPS);
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
    file.json["nodes"] =
        json!([{"mesh": 0, "scale": [2, 2, 2]}, {"mesh": 1}, {"mesh": 2, "translation": [0, 0, 5]}, {"mesh": 2}]);
    let source = file.read().unwrap().into_source().unwrap();
    // The teeth are there twice.
    assert_eq!((source.positions[1], source.positions[3]), (Vec3::X * 2.0, Vec3::Z * 5.0));
    assert_eq!((source.positions[6], source.faces.triangles(&source.positions)[2]), (Vec3::ZERO, [6, 7, 8]));
    assert_eq!(
        source.targets.iter().map(|t| (t.name.as_str(), t.positions.len())).collect::<Vec<_>>(),
        [("jaw", 9), ("blink", 3)]
    );
    assert_eq!((source.targets[0].positions[0].1, source.targets[0].positions[3]), (Vec3::Z * 2.0, (3, Vec3::Z)));
    for note in [
        "without targets, and no part of the mesh: 'eye'",
        "merged, targets of one name moved together: 'head', 'teeth'",
    ] {
        assert!(source.notes.iter().any(|n| n.contains(note)), "{note}: {:?}", source.notes);
    }
    assert!(!source.notes.iter().any(|note| note.contains("drawn by")), "{:?}", source.notes);
    assert_eq!(source.welds, [0, 1, 2, 3, 4, 5, 6, 7, 8]);
    source.to_mesh(Tolerance::default()).unwrap();
    file.json["nodes"][0]["scale"] = json!([1, 0, 1]);
    file.json["nodes"][0]["name"] = json!("hid");
    let source = file.read().unwrap().into_source().unwrap();
    assert_eq!((source.positions.len(), source.positions[0], source.targets.len()), (6, Vec3::Z * 5.0, 1));
    for note in ["nodes that a scale of 0 flattens are left out: 'hid'", "not in the scene, and left out: 'head'"] {
        assert!(source.notes.iter().any(|n| n == note), "{note}: {:?}", source.notes);
    }
    file.json["meshes"] = json!([mesh("eye", &[])]);
    file.json["nodes"] = json!([]);
    assert_eq!(file.read().unwrap().into_source().unwrap().positions.len(), 3);
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
        let channels = &gltf.animations[0].channels;
        let driven: Vec<_> = channels.iter().map(|c| (c.node, c.property, c.target, c.sample(1.0))).collect();
        let clip = gltf.clip(&gltf.animations[0], Some(1.0)).ok().map(|clip| (clip.names, clip.values));
        (driven, clip, gltf.notes)
    };
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    let half = vec![0.5, 0.5];
    let (channels, clip, notes) = driven(&[(0, "/nodes/0/weights"), (1, "/nodes/1/rotation")]);
    assert_eq!(channels[0], (0, Property::Weights, None, half.clone()));
    assert_eq!((channels[1].0, channels[1].1, notes), (1, Property::Rotation, vec![]));
    assert_eq!(clip, Some((names(&["a", "b"]), vec![0.0, 1.0, 1.0, 0.0])));
    let (channels, ..) = driven(&[(0, "/meshes/0/weights")]);
    assert_eq!(channels, [3, 4].map(|node| (node, Property::Weights, None, half.clone())));
    let (channels, clip, _) = driven(&[(2, "/nodes/0/weights/1"), (2, "/meshes/0/weights/0")]);
    assert_eq!(channels[0], (0, Property::Weights, Some(1), vec![0.5]));
    assert_eq!(channels[2], (4, Property::Weights, Some(0), vec![0.5]));
    assert_eq!(clip, Some((names(&["b", "a"]), vec![0.25, 0.25, 0.75, 0.75])));
    let others = [
        "/nodes/0/weights/2",
        "/nodes/9/weights",
        "/meshes/7/weights",
        "/nodes/0/rotation/1",
        "/materials/0/weights",
        "/nodes/x/weights",
    ];
    for other in others {
        let (channels, clip, notes) = driven(&[(0, other)]);
        assert_eq!((channels.len(), clip, notes.len()), (0, None, 1), "{other}");
    }
}

#[test]
fn avatars_of_vrm_0_are_turned_to_look_forwards() {
    let mut file = arm();
    let mut read = |extension: &str| {
        file.json["extensions"] = json!({extension: {}});
        file.read().unwrap()
    };
    let (as_is, turned) = (read("VRMC_vrm"), read("VRM"));
    let back = DMat4::from_rotation_y(std::f64::consts::PI);
    for playing in [None, Some((&as_is.animations[0], 1.2))] {
        for (a, b) in as_is.world_matrices(playing).into_iter().zip(turned.world_matrices(playing)) {
            assert!((back * a).abs_diff_eq(b, 1e-12), "{a} {b}");
        }
    }
}

/// Nodes that draw a mesh each have a copy, as long as the file is large enough for all of them.
#[test]
fn copies_are_bounded_by_the_size_of_the_file() {
    let mut file = Written::default();
    let lots = file.floats(&vec![[1.0f32, 2.0, 3.0]; 2001]);
    file.json["meshes"] = json!([{"name": "grass", "primitives": [{"attributes": {"POSITION": lots}}]}]);
    file.json["nodes"] = json!(vec![json!({"mesh": 0}); 3000]);
    let source = file.read().unwrap().into_source().unwrap();
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
    let gltf = file.read().unwrap();
    let scene = gltf.clone().into_scene(true).unwrap();
    let (source, _) = gltf.clone().into_skinned().unwrap();
    assert_eq!((scene.mesh.source.positions, scene.mesh.source.notes), (source.positions, source.notes.clone()));
    let said = "without targets, and no part of the mesh: 'glasses', 'coat', 'spare'";
    assert!(source.notes.iter().any(|note| note == said), "{:?}", source.notes);
    let part = |name: &str, faces, material| DrawnPart { name: name.to_owned(), faces, material: Some(material) };
    let parts = [part("glasses", 0..1, 4), part("glasses", 1..2, 0), part("coat", 2..3, 2)];
    let still = scene.still.unwrap();
    assert_eq!((&still.parts[..], still.source.targets.len()), (&parts[..], 0));
    let posed = gltf.into_scene(false).unwrap().still.unwrap();
    assert!(posed.skeleton.is_none() && posed.parts == still.parts);
    // Where no mesh has targets, they are the mesh.
    file.json["meshes"][0]["primitives"][0]["targets"] = json!([]);
    file.json["meshes"][0]["extras"] = json!({});
    file.json["nodes"][0]["weights"] = json!([]);
    file.json["animations"] = json!([]);
    let scene = file.read().unwrap().into_scene(true).unwrap();
    assert!(scene.still.is_none() && scene.mesh.parts.len() == 4);
}

/// A joint of scale 0 flattens what it alone moves, and huge ones move it out of range.
#[test]
fn joints_that_flatten_or_move_out_of_range_are_told() {
    let mut file = arm();
    let mut scaled = |by: f32| {
        file.json["nodes"][1] = json!({"scale": [by, by, by], "children": [2]});
        file.json["nodes"][2] = json!({"scale": [by, by, by]});
        file.read().unwrap().into_source()
    };
    let source = scaled(0.0).unwrap();
    let said = "joints of scale 0 flatten it, as at vertex 0";
    assert!(source.notes.iter().any(|note| note.contains(said)), "{:?}", source.notes);
    source.to_mesh(Tolerance::ZERO).unwrap();
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
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let read = |file: &Written| {
        std::fs::write(&path, file.glb()).unwrap();
        read_materials(&path)
    };
    let materials = read(&file).unwrap();
    assert!(materials[0].base_color == [1.0; 4] && !materials[0].is_textured && !materials[0].double_sided);
    assert_eq!((materials[1].name.as_str(), materials[1].base_color), ("skin", [1.0, 0.5, 0.0, 1.0]));
    assert_eq!([0, 1, 2, 3].map(|number| materials[number].is_textured), [false, true, false, false]);
    assert_eq!([0, 1, 2, 3].map(|number| materials[number].is_opaque), [true, true, false, false]);
    assert!(materials[2].double_sided && materials[3].base_color[3] == 0.25);
    file.json["materials"][0]["alphaMode"] = json!("GLASS");
    crate::testing::says(read(&file), &["materials[0]: alphaMode 'GLASS'; use OPAQUE, MASK or BLEND"]);
}
