//! Files of several clips, skins, meshes and scenes, of many targets and of none: what a user finds of them.

use super::written::{F32, U8, Written, bytes};
use super::*;
use glam::{DMat4, DQuat, DVec3, Mat4};

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

/// Bound by two influences to the joints of a skin.
fn bind(file: &mut Written, mesh: &mut Value, first: u8) {
    let joints = file.accessor(U8, "VEC4", 3, &[first, 1 - first, 0, 0].repeat(3));
    let weights = file.floats(&[[0.75f32, 0.25, 0.0, 0.0]; 3]);
    let attributes = &mut mesh["primitives"][0]["attributes"];
    (attributes["JOINTS_0"], attributes["WEIGHTS_0"]) = (json!(joints), json!(weights));
}

/// Two meshes, each with a skin.
fn dressed() -> Written {
    let mut file = Written::default();
    let mut meshes = [triangle(&mut file, "head", &[("jaw", 1.0)]), triangle(&mut file, "coat", &[("wind", 1.0)])];
    meshes.iter_mut().zip([0, 1]).for_each(|(mesh, first)| bind(&mut file, mesh, first));
    file.json["meshes"] = json!(meshes);
    // The skeleton of the second skin is in no scene, and its root no joint.
    file.json["nodes"] = json!([
        {"mesh": 0, "skin": 0}, {"mesh": 1, "skin": 1, "scale": [5, 5, 5]},
        {"translation": [1, 0, 0], "children": [3]}, {"translation": [0, 1, 0]},
        {"translation": [0, 0, 4], "scale": [2, 2, 2], "children": [5]}, {"children": [6]}, {"translation": [0, 0, 0]},
    ]);
    let back = |t: glam::Vec3| glam::Mat4::from_translation(-t).to_cols_array();
    let bind = file.floats(&[back(glam::Vec3::X), back(glam::Vec3::X)]);
    file.json["skins"] = json!([
        {"joints": [2, 3], "inverseBindMatrices": bind}, {"joints": [6, 5], "skeleton": 4, "name": "coat"},
    ]);
    file.json["scenes"] = json!([{"nodes": [0, 1, 2]}]);
    file.json["scene"] = json!(0);
    file
}

#[test]
fn each_skin_has_its_own_joints_wherever_its_skeleton_is() {
    let read = dressed().read().unwrap();
    let shown: Vec<bool> = read.nodes.iter().map(|node| node.is_shown).collect();
    assert_eq!(shown, [true, true, true, true, false, false, false]);
    let worlds = read.world_matrices(None);
    let moved = |skin: usize, joint: usize| read.joint_matrices(&read.skins[skin], &worlds)[joint];
    let at = |x: f64, y: f64, z: f64| glam::DVec3::new(x, y, z);
    assert_eq!(moved(0, 0).transform_point3(at(0.5, 0.0, 0.0)), at(0.5, 0.0, 0.0));
    assert_eq!(moved(0, 1).transform_point3(at(0.5, 0.0, 0.0)), at(0.5, 1.0, 0.0));
    // Without inverse bind matrices joints are bound where the mesh is.
    assert_eq!(moved(1, 0).transform_point3(at(0.5, 0.0, 0.0)), at(1.0, 0.0, 4.0));
    assert_eq!(read.meshes[1].influences.as_ref().unwrap().joints[..2], [1, 0]);
    let source = read.into_source().unwrap();
    assert_eq!((source.positions[1], source.positions[4]), (Vec3::new(1.0, 0.25, 0.0), Vec3::new(2.0, 0.0, 4.0)));
    assert_eq!(source.targets[1].positions, [(3, Vec3::Z * 2.0)]);
}

/// The positions that glTF says: of each vertex, the sum of what its joints make of it.
fn blended(influences: &Influences, v: usize, matrices: &[DMat4], p: DVec3) -> DVec3 {
    let of_vertex = v * influences.per_vertex..(v + 1) * influences.per_vertex;
    let joints = influences.joints[of_vertex.clone()].iter().zip(&influences.weights[of_vertex]);
    joints.map(|(j, w)| matrices[usize::from(*j)].transform_point3(p) * f64::from(*w)).sum()
}

/// Avatars that tools quantise: the inverse bind matrices of each mesh hold its own scale and origin.
#[test]
fn meshes_of_skins_stand_in_one_space_however_they_are_stored() {
    let mut file = Written::default();
    let (size, origin) = (Vec3::new(2e-4, 3e-4, 1e-3), Vec3::new(-1.0, 0.5, 7.0));
    let undo = Mat4::from_translation(origin) * Mat4::from_scale(size);
    let mut meshes = ["head", "teeth"].map(|name| triangle(&mut file, name, &[("jaw", 0.5)]));
    meshes.iter_mut().for_each(|mesh| bind(&mut file, mesh, 1));
    let stored = |points: &[[f32; 3]], from: Vec3| -> Vec<[f32; 3]> {
        points.iter().map(|p| ((Vec3::from(*p) - from) / size).to_array()).collect()
    };
    let (along, across) = (file.floats(&[[1.0, 0.0, 0.0, 1.0]; 3]), file.floats(&[[0.0, 0.5, 0.0]; 3]));
    for mesh in &mut meshes {
        let primitive = &mut mesh["primitives"][0];
        (primitive["attributes"]["TANGENT"], primitive["targets"][0]["TANGENT"]) = (json!(along), json!(across));
    }
    let primitive = &mut meshes[1]["primitives"][0];
    primitive["attributes"]["POSITION"] = json!(file.floats(&stored(&CORNERS, origin)));
    primitive["targets"][0]["POSITION"] =
        json!(file.floats(&stored(&[[0.0, 0.0, 0.5], [0.0; 3], [0.0; 3]], Vec3::ZERO)));
    file.json["meshes"] = json!(meshes);
    let binds = [
        Mat4::from_rotation_x(0.3) * Mat4::from_translation(Vec3::new(0.25, -1.0, 0.0)),
        Mat4::from_scale(Vec3::new(-1.0, 2.0, 0.5)),
    ];
    let mut skin = |undo: Mat4| {
        let binds = file.floats(&binds.map(|bind| (bind * undo).to_cols_array()));
        json!({"joints": [2, 3], "inverseBindMatrices": binds})
    };
    let skins = [skin(Mat4::IDENTITY), skin(undo)];
    file.json["skins"] = json!(skins);
    file.json["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [9, 9, 9]}, {"mesh": 1, "skin": 1, "scale": [0, 0, 0]},
        {"translation": [1, 2, 3], "rotation": [0.0, 0.6, 0.0, 0.8], "scale": [1, 3, 2], "children": [3]},
        {"translation": [0, 0.5, 0], "rotation": [0.6, 0.0, 0.0, 0.8]},
    ]);
    let world =
        |rotation: DQuat, scale, t: [f64; 3]| DMat4::from_scale_rotation_translation(scale, rotation, DVec3::from(t));
    let root = world(DQuat::from_xyzw(0.0, 0.6, 0.0, 0.8), DVec3::new(1.0, 3.0, 2.0), [1.0, 2.0, 3.0]);
    let child = root * world(DQuat::from_xyzw(0.6, 0.0, 0.0, 0.8), DVec3::ONE, [0.0, 0.5, 0.0]);
    let joints = [root * binds[0].as_dmat4(), child * binds[1].as_dmat4()];
    let read = file.read().unwrap();
    let source = read.clone().into_source().unwrap();
    assert_eq!(
        (source.positions.len(), &source.notes[..]),
        (
            6,
            &["merged, targets of one name moved together: 'head', \
        'teeth'"
                .to_owned()][..]
        )
    );
    let influences = read.meshes[0].influences.as_ref().unwrap();
    let expected = |v: usize, w: f64| {
        blended(
            influences,
            v,
            &joints,
            Vec3::from(CORNERS[v]).as_dvec3() + DVec3::Z * if v == 0 { 0.5 * w } else { 0.0 },
        )
    };
    let rest = [0, 1, 2].map(|v| expected(v, 0.0));
    let diagonal =
        rest.iter().copied().reduce(DVec3::max).unwrap().distance(rest.iter().copied().reduce(DVec3::min).unwrap());
    let mesh = source.to_mesh(Tolerance::ZERO).unwrap();
    for weight in [0.0, 1.0, -0.5] {
        let pose = evaluate_unpacked(&mesh, &[weight as f32]);
        for (v, found) in pose.chunks_exact(6).enumerate() {
            let off = expected(v % 3, weight).distance(DVec3::from_slice(found)) / diagonal;
            assert!(off < 5e-6, "{v} {weight}: {off:e}");
        }
    }
    // Tangents of the one that is stored as it is; the other ones are along quantised axes.
    let blend = joints[1] * 0.75 + joints[0] * 0.25;
    let (base, delta) = (&source.streams[0].values[..4], &source.targets[0].streams[0].deltas[..3]);
    let found = (Vec3::from_slice(base) - Vec3::from_slice(delta) * 0.5).as_dvec3().normalize();
    let expected = blend.transform_vector3(DVec3::new(1.0, -0.25, 0.0)).normalize();
    assert!(found.distance(expected) < 1e-6 && base[3] == blend.determinant().signum() as f32, "{found} {expected}");
    // A joint of scale 0 flattens what it alone moves, and a huge one moves it out of range.
    file.json["nodes"][2]["scale"] = json!([0, 0, 0]);
    let source = file.read().unwrap().into_source().unwrap();
    assert_noted(&source, &["mesh 'head': joints of scale 0 flatten it, as at vertex 0"]);
    assert_eq!(source.positions, [Vec3::new(1.0, 2.0, 3.0); 6]);
    source.to_mesh(Tolerance::ZERO).unwrap();
    file.json["nodes"][2]["scale"] = json!([3e38, 3e38, 3e38]);
    crate::testing::says(file.read().unwrap().into_source(), &["a.glb: head: the position of vertex 2 is [inf, "]);
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
