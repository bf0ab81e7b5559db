//! glTF files written by hand.

use serde_json::{Value, json};
use std::path::Path;

pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

pub fn accessor(view: usize, kind: &str, count: usize) -> Value {
    json!({"bufferView": view, "componentType": 5126, "type": kind, "count": count})
}

/// Writes a file whose buffer has a view for each of `parts`.
pub fn write(folder: &Path, parts: &[Vec<u8>], mut file: Value) -> String {
    let (mut views, mut offset) = (vec![], 0);
    for part in parts {
        views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": part.len()}));
        offset += part.len();
    }
    file["asset"] = json!({"version": "2.0"});
    file["buffers"] = json!([{"byteLength": offset, "uri": "buffer.bin"}]);
    file["bufferViews"] = json!(views);
    std::fs::write(folder.join("buffer.bin"), parts.concat()).unwrap();
    let path = folder.join("face.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Writes a strip of triangles from x = 0 to 4 that bulges by a target, and bends by the joint of its upper end. Of the
/// three frames of its clip, the first two differ only in joints, the last two only in the weight.
pub fn gltf_arm(folder: &Path) -> String {
    let corners: Vec<[f32; 3]> = (0..8u8)
        .flat_map(|i| [(i, 0u8), (i + 1, 0), (i, 1), (i + 1, 0), (i + 1, 1), (i, 1)])
        .map(|(x, y)| [f32::from(x) / 2.0, f32::from(y), 0.0])
        .collect();
    let count = corners.len();
    let each = |f: &dyn Fn(f32) -> Vec<f32>| floats(&corners.iter().flat_map(|p| f(p[0])).collect::<Vec<f32>>());
    let (half, column) = (0.5f32.sqrt(), |x: f32| [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., x, 0., 0., 1.]);
    let parts = [
        floats(corners.as_flattened()),
        each(&|x| vec![0.0, 0.5 * x, 0.0]),
        [0u8, 1, 0, 0].repeat(count),
        each(&|x| vec![1.0 - x / 4.0, x / 4.0, 0.0, 0.0]),
        floats(&[column(0.0), column(-2.0)].concat()),
        floats(&[0.0, 0.04, 0.08]),
        floats(&[0.25, 0.25, 1.0]),
        floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half, 0.0, 0.0, half, half]),
    ];
    let mut joints = accessor(2, "VEC4", count);
    joints["componentType"] = json!(5121);
    let file = json!({
        "accessors": [accessor(0, "VEC3", count), accessor(1, "VEC3", count), joints, accessor(3, "VEC4", count),
            accessor(4, "MAT4", 2), accessor(5, "SCALAR", 3), accessor(6, "SCALAR", 3), accessor(7, "VEC4", 3)],
        "meshes": [{"extras": {"targetNames": ["up"]}, "primitives": [{"targets": [{"POSITION": 1}],
            "attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}}]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": 4}],
        "nodes": [{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [2, 0, 0]}],
        "animations": [{"name": "wave", "samplers": [{"input": 5, "output": 6}, {"input": 5, "output": 7}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}},
                {"sampler": 1, "target": {"node": 2, "path": "rotation"}}]},
            {"name": "nod", "samplers": [{"input": 5, "output": 7}],
                "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}]}],
    });
    write(folder, &parts, file)
}
