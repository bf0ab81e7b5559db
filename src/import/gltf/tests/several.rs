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

fn names(source: &Mesh) -> Vec<&str> {
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
    let listed = crate::import::open(&path).unwrap().clips;
    let names: Vec<&str> = listed.iter().map(|clip| clip.to_str().unwrap().split_once('#').unwrap().1).collect();
    assert_eq!(names, ["walk", "talk", "talk 2", "a#b"]);
    for (clip, first) in listed.iter().zip([0.0, 0.25, 0.5, 0.125]) {
        let clip = crate::import::open_clip(clip, None).unwrap();
        assert_eq!((clip.values[0], &clip.names[..]), (first, &["jaw".to_owned(), "blink".to_owned()][..]));
    }
    let expected = "4 animations of weights where one clip is wanted; name one as FILE#NAME: 'walk', 'talk', 'talk 2'";
    crate::testing::says(crate::import::open_clip(&path, None), &[expected]);
    // The only one needs no name; and a VRM avatar is a GLB file.
    let path = folder.path().join("head.vrm");
    for (count, expected) in [(1, Ok("walk")), (0, Err("it has none: give a CSV file"))] {
        file.json["animations"].as_array_mut().unwrap().truncate(count);
        std::fs::write(&path, file.glb()).unwrap();
        match expected {
            Ok(name) => assert_eq!(crate::import::open_clip(&path, None).unwrap().name, name),
            Err(words) => crate::testing::says(crate::import::open_clip(&path, None), &[words]),
        }
    }
}

/// Each node has weights of its own: targets of one name are one as long as all nodes that draw them agree.
#[test]
fn targets_move_together_where_nodes_have_the_same_weights() {
    let mut file = Written::default();
    let two: &[(&str, f32)] = &[("jaw", 1.0), ("blink", 2.0)];
    let [head, eye] = ["head", "eye"].map(|name| triangle(&mut file, name, two));
    let unnamed = |mesh: &Value| {
        let mut mesh = mesh.clone();
        mesh["extras"] = json!({});
        // The first primitive has no targets.
        let still = json!({"attributes": mesh["primitives"][0]["attributes"]});
        mesh["primitives"].as_array_mut().unwrap().insert(0, still);
        mesh
    };
    let with = |mesh: &Value, key: &str, value: Value| {
        let mut mesh = mesh.clone();
        mesh[key] = value;
        mesh
    };
    let resting = |mesh: &Value, weights: [f32; 2]| with(mesh, "weights", json!(weights));
    let (half, unnamed) = (resting(&eye, [0.5, 0.0]), json!([unnamed(&head), unnamed(&eye)]));
    let doubled = triangle(&mut file, "head", &[("jaw", 1.0), ("jaw", 2.0)]);
    let second = triangle(&mut file, "eye", &[("jaw 2", 1.0)]);
    let nodes = |second: Value| json!([{"mesh": 0, "name": "A"}, second]);
    let [one, other] = [json!({"mesh": 0, "name": "B"}), json!({"mesh": 1, "name": "B"})];
    let moving: &[f32] = &[0.0, 0.25];
    let drive = |file: &mut Written, node: usize, to: &[f32]| clip(file, "act", node, moving, to);
    for (meshes, second, to, expected) in [
        // One mesh, drawn twice: alike, one at rest, one with weights of its own.
        (json!([head]), one.clone(), [Some([1.0, 0.5]), Some([1.0, 0.5])], "jaw 1, blink 0.5"),
        (json!([head]), one.clone(), [Some([1.0, 0.5]), None], "A.jaw 1, A.blink 0.5"),
        (json!([head]), with(&one, "name", json!("")), [Some([1.0, 0.5]), None], "A.jaw 1, A.blink 0.5"),
        (json!([head]), resting(&one, [0.0, 1.0]), [Some([1.0, 0.5]), None], "A.jaw 1, A.blink 0.5, B.blink 1"),
        (json!([head]), resting(&one, [0.0, 1.0]), [None, Some([0.0, 0.5])], "jaw 0, B.blink 0.5"),
        // Two meshes with targets of the same names.
        (json!([head, eye]), other.clone(), [Some([1.0, 0.5]), Some([1.0, 0.5])], "jaw 1, blink 0.5"),
        (json!([head, eye]), other.clone(), [Some([1.0, 0.5]), Some([1.0, 0.75])], "jaw 1, A.blink 0.5, B.blink 0.75"),
        (json!([head, eye]), other.clone(), [None, Some([0.0, 0.25])], "jaw 0, B.blink 0.25"),
        (json!([head, half]), other.clone(), [Some([1.0, 0.25]), None], "A.jaw 1, A.blink 0.25, B.jaw 0.5"),
        // Without names, or with such as are made.
        (unnamed, other.clone(), [Some([1.0, 0.5]), None], "head.target 0 1, head.target 1 0.5"),
        (json!([doubled, second]), other, [Some([1.0, 0.5]), None], "jaw 1, jaw 3 0.5"),
    ] {
        file.json["meshes"] = meshes;
        file.json["nodes"] = nodes(second);
        let mut animation = json!({"name": "act", "channels": [], "samplers": []});
        for (node, to) in to.iter().enumerate().filter_map(|(node, to)| Some((node, to.as_ref()?))) {
            let mut own = drive(&mut file, node, to);
            let count = animation["samplers"].as_array().unwrap().len();
            own["channels"][0]["sampler"] = json!(count);
            animation["samplers"].as_array_mut().unwrap().push(own["samplers"][0].clone());
            animation["channels"].as_array_mut().unwrap().push(own["channels"][0].clone());
        }
        file.json["animations"] = json!([animation]);
        let read = file.read().unwrap();
        let clip = read.clip(&read.animations[0], Some(1.0)).unwrap();
        let last = clip.names.iter().zip(&clip.values[clip.names.len()..]);
        let last: Vec<String> = last.map(|(name, weight)| format!("{name} {weight}")).collect();
        assert_eq!(last.join(", "), expected);
        let of_nodes: Vec<String> = (0..2).flat_map(|node| read.target_names(node)).map(str::to_owned).collect();
        let source = read.into_mesh().unwrap();
        let names = names(&source);
        assert!(clip.names.iter().all(|name| names.contains(&name.as_str())), "{names:?} {clip:?}");
        assert!(of_nodes.iter().all(|name| names.contains(&name.as_str())), "{names:?} {of_nodes:?}");
        let merged = source.notes.iter().any(|note| note.starts_with("merged, targets of one name"));
        let is_shared = names.len() < of_nodes.len() && file.json["meshes"].as_array().unwrap().len() == 2;
        assert_eq!(merged, is_shared, "{names:?}");
    }
}

#[test]
fn names_are_found_wherever_exporters_put_them() {
    let mut file = Written::default();
    let mesh = triangle(&mut file, "head", &[("", 1.0), ("", 2.0)]);
    file.json["nodes"] = json!([{"mesh": 0}]);
    let targets: Vec<u64> = (0..2).map(|i| mesh["primitives"][0]["targets"][i]["POSITION"].as_u64().unwrap()).collect();
    for (extras, of_primitive, accessors, expected) in [
        (json!(["a", "b"]), json!(["c", "d"]), ["e", "f"], ["a", "b"]),
        (json!([]), json!(["c", ""]), ["e", "f"], ["c", "target 1"]),
        (json!(null), json!(null), ["e", "f"], ["e", "f"]),
        (json!(null), json!(null), ["e", "e"], ["target 0", "target 1"]),
    ] {
        let mut mesh = mesh.clone();
        mesh["extras"]["targetNames"] = extras;
        mesh["primitives"][0]["extras"] = json!({"targetNames": of_primitive});
        let still = json!({"attributes": mesh["primitives"][0]["attributes"]});
        mesh["primitives"].as_array_mut().unwrap().insert(0, still);
        file.json["meshes"] = json!([mesh]);
        targets.iter().zip(accessors).for_each(|(i, name)| file.json["accessors"][*i as usize]["name"] = json!(name));
        assert_eq!(names(&file.read().unwrap().meshes[0].source), expected);
    }
}

#[test]
fn weights_of_a_node_come_before_those_of_its_mesh() {
    let mut file = Written::default();
    let mut mesh = triangle(&mut file, "head", &[("jaw", 1.0), ("blink", 2.0)]);
    mesh["weights"] = json!([0.5, 0.25]);
    file.json["meshes"] = json!([mesh]);
    let turns = file.floats(&[[0.0, 0.0, 0.0, 1.0]; 2]);
    file.json["animations"] = json!([clip(&mut file, "turn", 0, &[], &[])]);
    file.json["animations"][0]["samplers"][0]["output"] = json!(turns);
    file.json["animations"][0]["channels"][0]["target"]["path"] = json!("rotation");
    for (stated, weights, note, columns) in [
        (json!([0.0, 0.75]), &[0.0, 0.75][..], "blink 0.75", &[0.75][..]),
        (json!([1.0]), &[1.0, 0.0], "jaw 1", &[1.0]),
        (json!([]), &[], "blink 0.25, jaw 0.5", &[0.5, 0.25]),
        (json!([0, 0]), &[0.0, 0.0], "", &[0.0]),
    ] {
        file.json["nodes"] = json!([{"mesh": 0, "weights": stated}]);
        let read = file.read().unwrap();
        assert_eq!((&read.meshes[0].weights[..], &read.nodes[0].weights[..]), (&[0.5, 0.25][..], weights));
        // Clips have them, those of joints alone, too.
        assert_eq!(read.clip(&read.animations[0], Some(1.0)).unwrap().values, columns.repeat(2));
        let said = format!("weights at rest, which only clips of the file have: {note}");
        let expected = if note.is_empty() { vec![] } else { vec![said] };
        assert_eq!(read.into_mesh().unwrap().notes, expected);
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
        // What there is not is left out.
        (json!({"scene": 2}), both, Ok(("head teeth", 6, "'spare'"))),
        (json!({"scene": 0}), json!([{"nodes": [9, 1]}]), Ok(("spare", 3, "'head', 'teeth'"))),
    ] {
        file.json.as_object_mut().unwrap().remove("scene");
        file.json.as_object_mut().unwrap().extend(scene.as_object().unwrap().clone());
        file.json["scenes"] = scenes;
        match (file.read().and_then(|file| file.into_mesh()), expected) {
            (Ok(source), Ok((targets, vertices, left_out))) => {
                assert_eq!((names(&source).join(" ").as_str(), source.positions.len()), (targets, vertices));
                let said = format!("not in the scene, and left out: {left_out}");
                assert_eq!(source.notes.contains(&said), !left_out.is_empty(), "{:?}", source.notes);
            }
            (source, expected) => crate::testing::says(source, &[expected.unwrap_err()]),
        }
    }
}
