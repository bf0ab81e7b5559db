//! Files of several clips, skins, meshes and scenes, of many targets and of none: what a user finds of them.

use super::written::{F32, Written, bytes};
use super::*;

const CORNERS: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// A mesh of one triangle, whose targets each move a corner by so much.
fn triangle(file: &mut Written, name: &str, targets: &[(&str, f32)]) -> Value {
    let corners = file.floats(&CORNERS);
    let mut morph = |(i, (_, by)): (usize, &(&str, f32))| {
        let mut deltas = [[0.0; 3]; 3];
        deltas[i % 3][2] = *by;
        json!({"POSITION": file.floats(&deltas)})
    };
    let morphs: Vec<Value> = targets.iter().enumerate().map(&mut morph).collect();
    let names: Vec<&str> = targets.iter().map(|(name, _)| *name).collect();
    json!({"name": name, "extras": {"targetNames": names},
        "primitives": [{"attributes": {"POSITION": corners}, "targets": morphs}]})
}

/// A clip of the weights of a node: two keys, a second apart.
fn clip(file: &mut Written, name: &str, node: usize, from: &[f32], to: &[f32]) -> Value {
    let times = file.floats(&[[0.0], [1.0]]);
    let values = file.accessor(F32, "SCALAR", 2 * from.len(), &bytes(&[from, to].concat()));
    json!({"name": name, "samplers": [{"input": times, "output": values}],
        "channels": [{"sampler": 0, "target": {"node": node, "path": "weights"}}]})
}

fn names(source: &MorphSource) -> Vec<&str> {
    source.targets.iter().map(|target| target.name.as_str()).collect()
}

/// Whether a remark contains each of these.
fn assert_noted(source: &MorphSource, texts: &[&str]) {
    for text in texts {
        assert!(source.notes.iter().any(|note| note.contains(text)), "{text}: {:?}", source.notes);
    }
}

#[test]
fn each_clip_is_found_by_its_name() {
    let mut file = Written::default();
    file.json["meshes"] = json!([triangle(&mut file, "head", &[("jaw", 1.0), ("blink", 2.0)])]);
    file.json["nodes"] = json!([{"mesh": 0}]);
    let clips = [
        clip(&mut file, "walk", 0, &[0.0, 0.0], &[1.0, 0.5]),
        clip(&mut file, "talk", 0, &[0.25, 0.0], &[0.75, 1.0]),
        clip(&mut file, "talk", 0, &[0.5, 0.5], &[0.0, 0.0]),
        clip(&mut file, "a#b", 0, &[0.125, 0.0], &[0.0, 0.0]),
    ];
    file.json["animations"] = json!(clips);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("head.glb");
    std::fs::write(&path, file.glb()).unwrap();
    let listed = crate::import::open(&path, &crate::import::ImportDesc::default()).unwrap().clips;
    let names: Vec<&str> = listed.iter().map(|clip| clip.to_str().unwrap().split_once('#').unwrap().1).collect();
    assert_eq!(names, ["walk", "talk", "talk 2", "a#b"]);
    for (clip, first) in listed.iter().zip([0.0, 0.25, 0.5, 0.125]) {
        let clip = crate::import::open_clip(clip, None).unwrap();
        assert_eq!((clip.values[0], &clip.names[..]), (first, &["jaw".to_owned(), "blink".to_owned()][..]));
        let bound = clip.bind(&["blink", "jaw"]).unwrap();
        assert_eq!(bound.frames().next().unwrap()[1], first, "{}", clip.name);
    }
    let refused = crate::import::open_clip(&path, None).unwrap_err().to_string();
    let expected = "head.glb: a glTF file with 4 animations of weights where one clip is wanted; name one as \
                    FILE#NAME: 'walk', 'talk', 'talk 2', 'a#b'";
    assert!(refused.ends_with(expected), "{refused}");
    // The only one needs no name; and a VRM avatar is a GLB file.
    file.json["animations"].as_array_mut().unwrap().truncate(1);
    let path = folder.path().join("head.vrm");
    std::fs::write(&path, file.glb()).unwrap();
    assert_eq!(crate::import::open(&path, &crate::import::ImportDesc::default()).unwrap().clips.len(), 1);
    assert_eq!(crate::import::open_clip(&path, None).unwrap().name, "walk");
    file.json["animations"] = json!([]);
    std::fs::write(&path, file.glb()).unwrap();
    let refused = crate::import::open_clip(&path, None).unwrap_err().to_string();
    assert!(refused.ends_with("it has none: give a CSV file"), "{refused}");
}

#[test]
fn a_mesh_of_targets_of_nothing_alone_is_a_mesh() {
    let mut file = Written::default();
    let mut mesh = triangle(&mut file, "still", &[("a", 1.0), ("b", 1.0)]);
    mesh["primitives"][0]["targets"] = json!([{}, {}]);
    file.json["meshes"] = json!([mesh]);
    let source = file.read().unwrap().into_source().unwrap();
    assert_eq!(names(&source), ["a", "b"]);
    let mesh = source.to_mesh(Tolerance::default()).unwrap();
    for format in [DeltaFormat::Float32, DeltaFormat::Fast, DeltaFormat::Small] {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).unwrap();
        assert!(crate::reference::evaluate(&packed, &[0.5, 1.0]).iter().all(|x| x.is_finite()));
    }
}

#[test]
fn targets_without_names_belong_to_one_mesh_and_what_a_clip_leaves_out_is_said() {
    let mut file = Written::default();
    let mut meshes = ["head", "eye", "eye"].map(|name| triangle(&mut file, name, &[("jaw", 1.0), ("blink", 2.0)]));
    file.json["nodes"] = json!([{"mesh": 0, "name": "A"}, {"mesh": 1, "name": "B"}]);
    file.json["meshes"] = json!(meshes);
    let mut animation = clip(&mut file, "walk", 0, &[0.0, 0.5], &[1.0, 0.5]);
    let other = clip(&mut file, "", 1, &[0.0, 0.5], &[1.0, 0.75]);
    animation["samplers"].as_array_mut().unwrap().push(other["samplers"][0].clone());
    animation["channels"].as_array_mut().unwrap().push(json!({"sampler": 1, "target": {"node": 1, "path": "weights"}}));
    file.json["animations"] = json!([animation]);
    // Of one name, with other weights of the second target alone.
    let said = "animation 'walk': weights left out: 1, first of node 1 'B', 'blink', which node 0 'A' animates, too";
    assert_eq!(file.read().unwrap().notes, [said]);
    let named = meshes[1].clone();
    meshes.iter_mut().for_each(|mesh| mesh["extras"] = json!({}));
    meshes[1]["extras"] = json!({"targetNames": ["jaw"]});
    file.json["meshes"] = json!(meshes);
    let read = file.read().unwrap();
    assert!(read.notes.is_empty(), "{:?}", read.notes);
    let clip = read.clip(&read.animations[0], Some(1.0)).unwrap();
    assert_eq!(
        (clip.names.join(", ").as_str(), &clip.values[4..]),
        ("head target 0, head target 1, jaw, eye target 1", &[1.0, 0.5, 1.0, 0.75][..])
    );
    assert_eq!(names(&read.meshes[2].source), ["eye 2 target 0", "eye 2 target 1"]);
    let all = read.into_source().unwrap();
    assert_eq!(names(&all), ["head target 0", "head target 1", "jaw", "eye target 1"]);
    // Those of a single mesh have no need of its name.
    file.json["meshes"] = json!([meshes[0], named]);
    assert_eq!(names(&file.read().unwrap().meshes[0].source), ["target 0", "target 1"]);
}

#[test]
fn weights_of_a_node_come_before_those_of_its_mesh() {
    let mut file = Written::default();
    let mut mesh = triangle(&mut file, "head", &[("jaw", 1.0), ("blink", 2.0)]);
    mesh["weights"] = json!([0.5, 0.25]);
    file.json["meshes"] = json!([mesh]);
    file.json["nodes"] = json!([{"mesh": 0, "weights": [0.0, 0.75]}, {"mesh": 0}, {"mesh": 0, "weights": [1.0]}]);
    let read = file.read().unwrap();
    assert_eq!(read.meshes[0].weights, [0.5, 0.25]);
    let of_nodes: Vec<&[f32]> = read.nodes.iter().map(|node| &node.weights[..]).collect();
    assert_eq!(of_nodes, [&[0.0, 0.75][..], &[], &[1.0, 0.0]]);
    assert_noted(&read.into_source().unwrap(), &["mesh 'head' has weights at rest, which are left out: blink 0.75"]);
    file.json["nodes"] = json!([{"mesh": 0}]);
    let source = file.read().unwrap().into_source().unwrap();
    assert_noted(&source, &["which are left out: jaw 0.5, blink 0.25"]);
    file.json["nodes"] = json!([{"mesh": 0, "weights": [0, 0]}]);
    assert_eq!(file.read().unwrap().into_source().unwrap().notes, [""; 0]);
}

#[test]
fn the_scene_that_is_shown_says_which_meshes_are_taken() {
    let mut file = Written::default();
    let meshes = ["head", "spare", "teeth"].map(|name| triangle(&mut file, name, &[(name, 1.0)]));
    file.json["meshes"] = json!(meshes);
    file.json["nodes"] = json!([{"mesh": 0, "children": [2]}, {"mesh": 1}, {"mesh": 2}, {"mesh": 0}]);
    let mut found = |scene: Value, scenes: Value| {
        (file.json["scene"], file.json["scenes"]) = (scene, scenes);
        if file.json["scene"].is_null() {
            file.json.as_object_mut().unwrap().remove("scene");
        }
        file.read().and_then(Gltf::into_source)
    };
    let scenes = json!([{"nodes": [0]}, {"nodes": [1, 3]}]);
    let first = found(json!(0), scenes.clone()).unwrap();
    assert_eq!(names(&first), ["head", "teeth"]);
    assert_noted(&first, &["not in the scene, and left out: 'spare'"]);
    assert!(!first.notes.iter().any(|note| note.contains("drawn by")), "{:?}", first.notes);
    assert_eq!(names(&found(json!(1), scenes.clone()).unwrap()), ["head", "spare"]);
    // No default scene: the first. No scene, or none that draws: all.
    assert_eq!(names(&found(Value::Null, scenes.clone()).unwrap()), ["head", "teeth"]);
    let all = found(Value::Null, json!([])).unwrap();
    assert_eq!(names(&all), ["head", "spare", "teeth"]);
    assert_eq!(all.positions.len(), 12, "two heads");
    assert_eq!(names(&found(json!(0), json!([{}])).unwrap()), ["head", "spare", "teeth"]);
    let mut refused = |scene, scenes| found(scene, scenes).unwrap_err().to_string();
    let text = refused(Value::Null, json!({}));
    assert!(text.starts_with("a.glb: scenes: no array; "), "{text}");
    assert!(refused(json!(2), scenes.clone()).starts_with("a.glb: scene: 2, but there are 2 scenes, "));
    assert!(
        refused(json!(0), json!([{"nodes": [9]}])).starts_with("a.glb: scenes[0].nodes[0]: 9, but there are 4 nodes")
    );
}

#[test]
fn a_file_of_points_has_no_mesh() {
    let mut file = Written::default();
    let mut mesh = triangle(&mut file, "dust", &[("wind", 1.0)]);
    mesh["primitives"][0]["mode"] = json!(0);
    file.json["meshes"] = json!([mesh]);
    let read = file.read().unwrap();
    assert!(read.meshes[0].source.notes[0].contains("is points or lines, and left out"));
    let text = read.into_source().unwrap_err().to_string();
    assert_eq!(text, "a.glb: no mesh has triangles; give a file with a mesh of triangles");
}
