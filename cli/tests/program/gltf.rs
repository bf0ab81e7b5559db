//! glTF files as INPUT and as weight clips.

use crate::arm::{Written, gltf_arm, write};
use crate::cli::{Folder, deltamorph, json, ok, pixels, refused};
use serde_json::{Value, json};
use std::path::Path;

/// Writes a triangle with two targets, and an animation of them with 25 keys a second.
fn gltf_triangle(folder: &Path) -> String {
    let mut file = Written::default();
    let position = file.floats(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
    let up = file.floats(&[[0., 0., 1.], [0.; 3], [0.; 3]]);
    let out = file.floats(&[[0.; 3], [0., 2., 0.], [0.; 3]]);
    let times = file.floats(&[[0.], [0.04], [0.08]]);
    let weights = file.floats(&[[0.], [0.], [1.], [0.5], [0.25], [1.]]);
    let texcoords = file.floats(&[[0., 0.], [1., 0.25], [0., 1.]]);
    file.json["meshes"] = json!([{"extras": {"targetNames": ["up", "out"]}, "primitives": [{
        "attributes": {"POSITION": position, "TEXCOORD_0": texcoords},
        "targets": [{"POSITION": up}, {"POSITION": out}]}]}]);
    file.json["nodes"] = json!([{"mesh": 0}]);
    file.json["animations"] = json!([{"name": "nod #1", "samplers": [{"input": times, "output": weights}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}]);
    write(folder, file)
}

#[test]
fn a_gltf_file_is_an_input_and_its_animations_are_clips() {
    let dir = Folder::new();
    let face = gltf_triangle(dir.0.path());
    let info = json(&["info", &face, "--json", "-"]);
    assert_eq!((&info["input"]["vertices"], &info["input"]["targets"]), (&3.into(), &2.into()));
    let out = &*dir.at("pose.obj");
    // Clips: of the input by name, of a named file by name, and the only one of a file.
    for weights in ["nod #1".to_owned(), format!("{face}#nod #1"), face.clone()] {
        ok(&["apply", &face, "--weights", &weights, "--frame", "1", "--path", "cpu", "-o", out]);
        let text = std::fs::read_to_string(out).unwrap();
        let of = |keyword: &str| -> Vec<Vec<f64>> {
            let rows = text.lines().filter_map(|line| line.strip_prefix(keyword));
            rows.map(|row| row.split_whitespace().map(|x| x.parse().unwrap()).collect()).collect()
        };
        assert_eq!(of("v "), [[0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
        // OBJ counts texture coordinates from the bottom.
        assert_eq!(of("vt "), [[0.0, 1.0], [1.0, 0.75], [0.0, 0.0]]);
    }
    let played = json(&["play", &face, "--path", "cpu", "--every", "1", "--json", "-"]);
    assert_eq!((played["clip"].as_str(), &played["summary"]["frames"]), (Some("nod #1"), &3.into()));
    let (packed, again) = (&*dir.at("face.dmorph"), &*dir.at("again.dmorph"));
    ok(&["pack", &face, "-o", packed]);
    ok(&["pack", packed, "-o", again]);
    // Clips of packed files: the only one, by name, and by the name of the file.
    let its = format!("{packed}#nod #1");
    for args in [&[packed][..], &[again], &[packed, "--weights", "nod #1"], &[again, "--weights", &its]] {
        let again = json(&[&["play", "--path", "cpu", "--every", "1", "--json", "-"], args].concat());
        assert_eq!((&again["clip"], &again["frames"][1]["active"]), (&"nod #1".into(), &2.into()));
    }
    ok(&["play", packed, "--weights", &format!("{face}#nod #1"), "--path", "cpu"]);
    let buffer = dir.at("buffer.bin");
    refused(&["apply", &face, "--set", "up=1", "-o", &buffer], 2, "is an input");
    for (input, what) in [(&*face, "no animation of weights"), (packed, "no clip")] {
        let words = format!("{what} is called 'shake'; name one of: 'nod #1'");
        refused(&["apply", input, "--weights", "shake", "--frame", "1", "-o", out], 2, &words);
    }
}

/// Of the clip's three frames, the first two differ only in joints, which pictures have at rest.
#[test]
fn a_character_is_drawn_with_joints_at_rest() {
    let dir = Folder::new();
    let arm = gltf_arm(dir.0.path());
    let out = &*dir.at("out.png");
    let drawn = |args: &[&str]| {
        ok(&[&["render", &arm, "-o", out, "--size", "128x96", "--camera", "0,0"], args].concat());
        std::fs::read(out).unwrap()
    };
    let [first, second, third] = ["0", "1", "2"].map(|frame| drawn(&["--weights", "wave", "--frame", frame]));
    assert!(first == second && second != third);
    assert!(drawn(&["--set", "up=0.25"]) == first);
    let nod = deltamorph(&["render", &arm, "--weights", "nod", "--frame", "1", "-o", out]);
    let said = String::from_utf8(nod.stderr).unwrap();
    assert!(nod.status.success() && said.contains("clip 'nod': joints alone move: weights stay at rest"), "{said}");
    let mut bent: Value = serde_json::from_slice(&std::fs::read(&arm).unwrap()).unwrap();
    bent["nodes"][2]["rotation"] = json!([0.0, 0.0, 0.6, 0.8]);
    std::fs::write(&arm, bent.to_string()).unwrap();
    assert!(drawn(&["--set", "up=0.25"]) != first, "the joint is bent at rest");
}

/// A part that no target moves is drawn in the colour of its material, where its joint is at rest.
#[test]
fn still_parts_are_drawn_in_their_colours() {
    let dir = Folder::new();
    let arm = gltf_arm(dir.0.path());
    let mut file: Value = serde_json::from_slice(&std::fs::read(&arm).unwrap()).unwrap();
    let flag = json!({"name": "flag", "primitives": [{"attributes": {"POSITION": 0}, "material": 0}]});
    file["meshes"].as_array_mut().unwrap().push(flag);
    file["nodes"].as_array_mut().unwrap().push(json!({"mesh": 1, "translation": [1, 2, 0]}));
    file["nodes"][2]["children"] = json!([3]);
    file["materials"] = json!([{"doubleSided": true, "pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}}]);
    std::fs::write(&arm, file.to_string()).unwrap();
    let out = &*dir.at("out.png");
    let drawn = |args: &[&str]| {
        let fixed = ["render", &arm, "--whole", "-o", out, "--size", "128x96", "--camera", "0,0"];
        ok(&[&fixed, args].concat());
        let is_green = |pixel: &[u8]| pixel[1] > 80 && pixel[0] < 50;
        pixels(Path::new(out)).1.chunks_exact(4).map(is_green).collect::<Vec<bool>>()
    };
    let count = |green: &[bool]| green.iter().filter(|is_green| **is_green).count();
    let [before, after] = ["0", "1"].map(|frame| drawn(&["--weights", "wave", "--frame", frame]));
    assert!(count(&before) > 100 && before == after, "{} and {} pixels", count(&before), count(&after));
    file["nodes"][2]["translation"] = json!([1, 0, 0]);
    std::fs::write(&arm, file.to_string()).unwrap();
    assert!(drawn(&[]) != before, "the flag goes with its joint");
}

/// An avatar of VRM 0 looks along -z: poses have its coordinates, and pictures are taken from where it looks.
#[test]
fn avatars_of_vrm_0_stay_as_they_are_and_are_seen_from_the_front() {
    let dir = Folder::new();
    let arm = gltf_arm(dir.0.path());
    let [obj, png] = ["out.obj", "out.png"].map(|name| dir.at(name));
    let made = |camera: &str| {
        let pose = ["--set", "up=0.5", "--path", "cpu", "-o"];
        ok(&[&["apply", &arm], &pose[..], &[&obj]].concat());
        let look = ["--size", "128x96", "--camera", camera];
        ok(&[&["render", &arm], &pose[..], &[&png], &look].concat());
        [&obj, &png].map(|file| std::fs::read(file).unwrap())
    };
    let [pose, from_behind] = made("180,0");
    let mut file: Value = serde_json::from_slice(&std::fs::read(&arm).unwrap()).unwrap();
    file["extensions"] = json!({"VRM": {}});
    std::fs::write(&arm, file.to_string()).unwrap();
    assert!(made("0,0") == [pose, from_behind]);
}
