//! glTF files as INPUT and as weight clips.

use crate::cli::{fails, json, ok};
use std::path::Path;

/// A triangle with two targets, and an animation of them that has a key each second.
fn gltf_triangle(folder: &Path) -> String {
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let parts = [
        floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]),
        floats(&[0., 0., 1., 0., 0., 0., 0., 0., 0.]),
        floats(&[0., 0., 0., 0., 2., 0., 0., 0., 0.]),
        floats(&[0., 1., 2.]),
        floats(&[0., 0., 1., 0.5, 0.25, 1.]),
        floats(&[0., 0., 1., 0.25, 0., 1.]),
    ];
    let (mut views, mut offset) = (vec![], 0);
    for part in &parts {
        views.push(serde_json::json!({"buffer": 0, "byteOffset": offset, "byteLength": part.len()}));
        offset += part.len();
    }
    let accessor = |view: usize, kind: &str, count: usize| serde_json::json!({"bufferView": view, "componentType": 5126, "type": kind, "count": count});
    let file = serde_json::json!({
        "asset": {"version": "2.0"}, "buffers": [{"byteLength": offset, "uri": "buffer.bin"}], "bufferViews": views,
        "accessors": [accessor(0, "VEC3", 3), accessor(1, "VEC3", 3), accessor(2, "VEC3", 3), accessor(3, "SCALAR", 3),
            accessor(4, "SCALAR", 6), accessor(5, "VEC2", 3)],
        "meshes": [{"extras": {"targetNames": ["up", "out"]},
            "primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 5}, "targets": [{"POSITION": 1}, {"POSITION": 2}]}]}],
        "nodes": [{"mesh": 0}],
        "animations": [{"name": "nod #1", "samplers": [{"input": 3, "output": 4}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}],
    });
    std::fs::write(folder.join("buffer.bin"), parts.concat()).unwrap();
    let path = folder.join("face.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn a_gltf_file_is_an_input_and_its_animations_are_clips() {
    let dir = tempfile::tempdir().unwrap();
    let face = gltf_triangle(dir.path());
    let info = json(&["info", &face, "--json", "-"]);
    assert_eq!((&info["input"]["vertices"], &info["input"]["targets"]), (&3.into(), &2.into()));
    let [out, buffer] = ["pose.obj", "buffer.bin"].map(|name| dir.path().join(name).to_str().unwrap().to_owned());
    let (out, buffer) = (out.as_str(), buffer.as_str());
    // Of the file by name, of a file named, and the only one there is.
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
    let packed = dir.path().join("face.dmorph");
    ok(&["pack", &face, "-o", packed.to_str().unwrap()]);
    ok(&["play", packed.to_str().unwrap(), "--weights", &format!("{face}#nod #1"), "--path", "cpu"]);
    for (args, expected) in [
        (
            ["apply", &face, "--weights", "shake", "--frame", "1", "-o", out],
            "no animation of weights is called 'shake'; name one of: 'nod #1'",
        ),
        (["apply", &face, "--weights", "nod #1", "--frame", "3", "-o", out], "has 3 frames, counted from 0"),
        (["apply", &face, "--weights", "nod #1", "--frame", "1", "-o", buffer], "is part of what is read"),
    ] {
        let (_, text) = fails(&args);
        assert!(text.contains(expected), "{text}");
    }
}
