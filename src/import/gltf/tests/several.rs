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
    }
    let expected = "head.glb: a glTF file with 4 animations of weights where one clip is wanted; name one as \
                    FILE#NAME: 'walk', 'talk', 'talk 2', 'a#b'";
    crate::testing::says(crate::import::open_clip(&path, None), &[expected]);
    // The only one needs no name; and a VRM avatar is a GLB file.
    file.json["animations"].as_array_mut().unwrap().truncate(1);
    let path = folder.path().join("head.vrm");
    std::fs::write(&path, file.glb()).unwrap();
    assert_eq!(crate::import::open(&path, &crate::import::ImportDesc::default()).unwrap().clips.len(), 1);
    assert_eq!(crate::import::open_clip(&path, None).unwrap().name, "walk");
    file.json["animations"] = json!([]);
    std::fs::write(&path, file.glb()).unwrap();
    crate::testing::says(crate::import::open_clip(&path, None), &["it has none: give a CSV file"]);
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
    let said = "animation 'walk': weights left out: 1, first of node 1 'B', 'blink', which another node animates, too";
    assert_eq!(file.read().unwrap().notes, [said]);
    let named = meshes[1].clone();
    meshes.iter_mut().for_each(|mesh| mesh["extras"] = json!({}));
    meshes[1]["extras"] = json!({"targetNames": ["jaw"]});
    file.json["meshes"] = json!(meshes);
    let read = file.read().unwrap();
    assert!(read.notes.is_empty(), "{:?}", read.notes);
    let clip = read.clip(&read.animations[0], Some(1.0)).unwrap();
    assert_eq!(clip.names.join(", "), "head target 0, head target 1, jaw, eye target 1");
    assert_eq!(clip.values[4..], [1.0, 0.5, 1.0, 0.75]);
    assert_eq!(names(&read.meshes[2].source), ["eye 2 target 0", "eye 2 target 1"]);
    let all = read.into_mesh(false).unwrap().source;
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
    for (stated, weights, note) in [
        (json!([0.0, 0.75]), &[0.0, 0.75][..], "blink 0.75"),
        (json!([1.0]), &[1.0, 0.0], "jaw 1"),
        (json!([]), &[], "jaw 0.5, blink 0.25"),
        (json!([0, 0]), &[0.0, 0.0], ""),
    ] {
        file.json["nodes"] = json!([{"mesh": 0, "weights": stated}]);
        let read = file.read().unwrap();
        assert_eq!((&read.meshes[0].weights[..], &read.nodes[0].weights[..]), (&[0.5, 0.25][..], weights));
        let said = format!("mesh 'head' has weights at rest, which are left out: {note}");
        let expected = if note.is_empty() { vec![] } else { vec![said] };
        assert_eq!(read.into_mesh(false).unwrap().source.notes, expected);
    }
}

#[test]
fn the_scene_that_is_shown_says_which_meshes_are_taken() {
    let mut file = Written::default();
    let meshes = ["head", "spare", "teeth"].map(|name| triangle(&mut file, name, &[(name, 1.0)]));
    file.json["meshes"] = json!(meshes);
    file.json["nodes"] = json!([{"mesh": 0, "children": [2]}, {"mesh": 1}, {"mesh": 2}, {"mesh": 0}]);
    let both = json!([{"nodes": [0]}, {"nodes": [1, 3]}]);
    // No default scene: the first. No scene, or none that draws: all, and two heads.
    for (scene, scenes, expected) in [
        (json!({"scene": 0}), both.clone(), Ok(("head teeth", 6, "'spare'"))),
        (json!({"scene": 1}), both.clone(), Ok(("head spare", 6, "'teeth'"))),
        (json!({}), both.clone(), Ok(("head teeth", 6, "'spare'"))),
        (json!({}), json!([]), Ok(("head spare teeth", 12, ""))),
        (json!({"scene": 0}), json!([{}]), Ok(("head spare teeth", 9, ""))),
        (json!({}), json!({}), Err("a.glb: scenes: no array; ")),
        (json!({"scene": 2}), both, Err("a.glb: scene: 2, but there are 2 scenes, ")),
        (json!({"scene": 0}), json!([{"nodes": [9]}]), Err("scenes[0].nodes[0]: 9, but there are 4 nodes")),
    ] {
        file.json.as_object_mut().unwrap().remove("scene");
        file.json.as_object_mut().unwrap().extend(scene.as_object().unwrap().clone());
        file.json["scenes"] = scenes;
        match (file.read().and_then(|file| file.into_mesh(false)), expected) {
            (Ok(Drawn { source, .. }), Ok((targets, vertices, left_out))) => {
                assert_eq!((names(&source).join(" ").as_str(), source.positions.len()), (targets, vertices));
                let said = format!("not in the scene, and left out: {left_out}");
                assert_eq!(source.notes.contains(&said), !left_out.is_empty(), "{:?}", source.notes);
            }
            (source, expected) => crate::testing::says(source, &[expected.unwrap_err()]),
        }
    }
}
