//! glTF files written by hand.

#[allow(dead_code, reason = "these tests write less than those of the reader")]
#[path = "../../../src/import/gltf/tests/written.rs"]
mod written;

use serde_json::json;
use std::path::Path;
pub use written::{U8, Written};

/// Writes a file, and its buffer beside it; returns its path.
pub fn write(folder: &Path, mut file: Written) -> String {
    file.json["buffers"][0]["uri"] = json!("buffer.bin");
    std::fs::write(folder.join("buffer.bin"), &file.bytes).unwrap();
    let path = folder.join("face.gltf");
    std::fs::write(&path, file.json.to_string()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Writes a strip of triangles from x = 0 to 4 that bulges by a target, and bends by the joint of its upper end. Of the
/// three frames of its clip, the first two differ only in joints, the last two only in the weight.
pub fn gltf_arm(folder: &Path) -> String {
    let mut file = Written::default();
    let corners: Vec<[f32; 3]> = (0..8u8)
        .flat_map(|i| [(i, 0u8), (i + 1, 0), (i, 1), (i + 1, 0), (i + 1, 1), (i, 1)])
        .map(|(x, y)| [f32::from(x) / 2.0, f32::from(y), 0.0])
        .collect();
    let each = |shares: fn(f32) -> [f32; 4]| corners.iter().map(|p| shares(p[0])).collect::<Vec<_>>();
    let bulge: Vec<[f32; 3]> = corners.iter().map(|p| [0.0, 0.5 * p[0], 0.0]).collect();
    let [position, bulge] = [&corners, &bulge].map(|vectors| file.floats(vectors));
    let joints = file.accessor(U8, "VEC4", corners.len(), &[0, 1, 0, 0].repeat(corners.len()));
    let weights = file.floats(&each(|x| [1.0 - x / 4.0, x / 4.0, 0.0, 0.0]));
    let bind = file.floats(&[0.0, -2.0].map(|x| [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., x, 0., 0., 1.]));
    let times = file.floats(&[[0.0], [0.04], [0.08]]);
    let up = file.floats(&[[0.25], [0.25], [1.0]]);
    let (straight, bent) = ([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.5f32.sqrt(), 0.5f32.sqrt()]);
    let turns = file.floats(&[straight, bent, bent]);
    file.json["meshes"] = json!([{"extras": {"targetNames": ["up"]}, "primitives": [{"targets": [{"POSITION": bulge}],
        "attributes": {"POSITION": position, "JOINTS_0": joints, "WEIGHTS_0": weights}}]}]);
    file.json["skins"] = json!([{"joints": [1, 2], "inverseBindMatrices": bind}]);
    file.json["nodes"] = json!([{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [2, 0, 0]}]);
    let turning = json!({"node": 2, "path": "rotation"});
    file.json["animations"] = json!([
        {"name": "wave", "samplers": [{"input": times, "output": up}, {"input": times, "output": turns}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}, {"sampler": 1, "target": turning}]},
        {"name": "nod", "samplers": [{"input": times, "output": turns}],
            "channels": [{"sampler": 0, "target": turning}]},
    ]);
    write(folder, file)
}
