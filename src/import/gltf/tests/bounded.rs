//! Memory and time in proportion to the size of files, whatever they count and however often they name the same.

use super::super::meshopt::decode;
use super::hostile::{read, small, within};
use super::written::{F32, Written, bytes};
use glam::Vec3;
use serde_json::{Map, Value, json};
use std::time::{Duration, Instant};

/// Many times what is needed on a busy machine, or in QEMU; what grows with the square of these sizes takes minutes.
const SOON: Duration = Duration::from_secs(if cfg!(target_arch = "x86_64") { 20 } else { 200 });

/// `n` times the same.
fn many(n: usize, value: &Value) -> Value {
    Value::Array(vec![value.clone(); n])
}

/// Attributes of so many sets of texture coordinates and of colours besides POSITION.
fn sets([position, texcoord, color]: [usize; 3], [texcoords, colors]: [usize; 2]) -> Value {
    let texcoords = (0..texcoords).map(|i| (format!("TEXCOORD_{i}"), json!(texcoord)));
    let colors = (0..colors).map(|i| (format!("COLOR_{i}"), json!(color)));
    let stated = [("POSITION".to_owned(), json!(position))];
    Value::Object(stated.into_iter().chain(texcoords).chain(colors).collect::<Map<_, _>>())
}

/// Positions, texture coordinates and colours of `count` vertices, all of them zeros that no buffer holds.
fn zeros(file: &mut Written, count: usize) -> [usize; 3] {
    let list = file.json["accessors"].as_array_mut().unwrap();
    let kinds = ["VEC3", "VEC2", "VEC4"];
    list.extend(kinds.map(|kind| json!({"componentType": F32, "type": kind, "count": count})));
    [3, 2, 1].map(|back| list.len() - back)
}

/// Read a file, and make one mesh of it, where it is accepted.
fn take(file: &Written) -> Option<String> {
    let (glb, started) = (file.glb(), Instant::now());
    let result = read(&glb).and_then(|gltf| within(glb.len(), || gltf.into_skinned()));
    assert!(started.elapsed() < SOON, "{:?} for {} bytes", started.elapsed(), glb.len());
    result.err().map(|e| e.to_string())
}

#[test]
fn what_is_named_again_and_again_is_charged() {
    let refused = |file: &Written| {
        let text = take(file).expect("refused");
        assert!(text.contains("more than a file of this size can hold"), "{text}");
    };
    // Vertices of one primitive that lack the 512 streams of another.
    let mut file = Written::default();
    let (few, lots) = (zeros(&mut file, 3), zeros(&mut file, 30_000));
    let rich = json!({"attributes": sets(few, [256, 256]), "targets": [sets(few, [256, 256])]});
    let plain = json!({"attributes": {"POSITION": lots[0]}, "targets": [{}]});
    file.json["meshes"] = json!([{"primitives": [rich, plain]}]);
    refused(&file);
    // Targets of nothing, each with a list for each stream.
    let mut file = Written::default();
    let few = zeros(&mut file, 3);
    let targets = many(4000, &json!({}));
    file.json["meshes"] = json!([{"primitives": [{"attributes": sets(few, [256, 256]), "targets": targets}]}]);
    refused(&file);
    // Nodes with a weight for each target.
    let mut file = Written::default();
    let few = zeros(&mut file, 3);
    let targets = many(20_000, &json!({}));
    file.json["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": few[0]}, "targets": targets}]}]);
    file.json["nodes"] = many(2000, &json!({"mesh": 0, "weights": [0]}));
    refused(&file);
    // Meshes that take the name of one node above theirs; primitives whose targets have long names.
    let mut file = Written::default();
    let nodes = (0..2000).map(|i| json!({"mesh": i}));
    let root = json!({"name": "x".repeat(40_000), "children": (1..=2000).collect::<Vec<_>>()});
    file.json["nodes"] = std::iter::once(root).chain(nodes).collect();
    file.json["meshes"] = many(2000, &json!({}));
    refused(&file);
    let mut file = Written::default();
    let few = zeros(&mut file, 3);
    let primitives = many(1000, &json!({"attributes": {"POSITION": few[0]}, "targets": [{}]}));
    file.json["meshes"] = json!([{"extras": {"targetNames": ["x".repeat(40_000)]}, "primitives": primitives}]);
    refused(&file);
}

#[test]
fn a_file_beside_is_read_once_and_never_the_file_itself() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.gltf");
    let write = |buffers: &Value, count: usize| {
        let accessors = json!([{"componentType": F32, "type": "VEC3", "count": count}]);
        let meshes = json!([{"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}]}]);
        let file = json!({"asset": {"version": "2.0"}, "buffers": buffers, "accessors": accessors, "meshes": meshes});
        std::fs::write(&path, file.to_string()).unwrap();
        file.to_string().len()
    };
    for uri in ["a.gltf", "./a.gltf", "%61.gltf"] {
        write(&many(2, &json!({"uri": uri, "byteLength": 1})), 3);
        crate::testing::says(
            super::super::read(&path),
            &["buffers[0].uri: the glTF file itself, not a buffer; name the file"],
        );
    }
    std::fs::write(dir.path().join("b.bin"), vec![0; 100_000]).unwrap();
    let uris = ["b.bin", "./b.bin", "%62.bin"].map(|uri| json!({"uri": uri, "byteLength": 1}));
    let buffers = Value::Array(uris.into_iter().cycle().take(600).collect());
    let size = 100_000 + write(&buffers, 3);
    assert_eq!(within(size, || super::super::read(&path)).unwrap().meshes[0].source.positions.len(), 3);
    // Nor do they make room for values 600 times.
    let size = 100_000 + write(&buffers, 1_000_000);
    crate::testing::says(within(size, || super::super::read(&path)), &["more than a file of this size can hold"]);
}

#[test]
fn sparse_values_lie_where_their_stride_says() {
    for (stride, second) in
        [(None, [3.0, 4.0, 5.0]), (Some(12), [3.0, 4.0, 5.0]), (Some(16), [4.0, 5.0, 6.0]), (Some(4), [1.0, 2.0, 3.0])]
    {
        let mut file = small();
        let values = file.view(&bytes(&[0f32, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
        if let Some(stride) = stride {
            file.json["bufferViews"][values]["byteStride"] = json!(stride);
        }
        file.json["accessors"][6]["sparse"]["values"]["bufferView"] = json!(values);
        let deltas = &read(&file.glb()).unwrap().meshes[0].source.targets[0].positions;
        assert_eq!(deltas, &[(1, Vec3::new(0.0, 1.0, 2.0)), (3, Vec3::from(second))], "{stride:?}");
        // All bytes but the last ones of the second element.
        let needs = stride.unwrap_or(12) + 12;
        file.json["bufferViews"][values]["byteLength"] = json!(needs - 1);
        crate::testing::says(read(&file.glb()).map(|_| ()), &["sparse.values: 2 elements of 12 bytes every"]);
    }
}

#[test]
fn triangles_of_what_was_never_in_the_queues_name_no_vertex() {
    // The code names the edge before the last one, and a new vertex.
    let data = [&[0xe1, 0x10][..], &[0; 16]].concat();
    let decoded = decode(&data, 3, 4, "TRIANGLES", "").unwrap();
    assert_eq!(decoded, bytes(&[u32::MAX, u32::MAX, 0]));
}
