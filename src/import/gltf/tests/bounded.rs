//! Memory and time in proportion to the size of files, whatever they count and however often they name the same.

use super::super::meshopt::decode;
use super::hostile::{read, within};
use super::written::{F32, Written, bytes};
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
    let result = read(&glb).and_then(|gltf| within(glb.len(), || gltf.into_mesh()));
    assert!(started.elapsed() < SOON, "{:?} for {} bytes", started.elapsed(), glb.len());
    result.err().map(|e| e.to_string())
}

#[test]
fn what_is_named_again_and_again_is_charged() {
    let mut file = Written::default();
    let [few, lots] = [3, 30_000].map(|count| zeros(&mut file, count));
    let primitives = |list: Value| json!([{"primitives": list}]);
    let mut refused = |meshes: Value, nodes: Value| {
        file.json["meshes"] = meshes;
        file.json["nodes"] = nodes;
        let text = take(&file).expect("refused");
        assert!(text.contains("more than a file of this size can hold"), "{text}");
    };
    // Vertices of one primitive that lack the 512 streams of another.
    let rich = json!({"attributes": sets(few, [256, 256]), "targets": [sets(few, [256, 256])]});
    refused(primitives(json!([rich, {"attributes": {"POSITION": lots[0]}, "targets": [{}]}])), json!([]));
    // Targets of nothing, each with a list for each stream.
    let targets = many(4000, &json!({}));
    refused(primitives(json!([{"attributes": sets(few, [256, 256]), "targets": targets}])), json!([]));
    // Nodes with a weight for each target.
    let targets = many(20_000, &json!({}));
    let nodes = many(2000, &json!({"mesh": 0, "weights": [0]}));
    refused(primitives(json!([{"attributes": {"POSITION": few[0]}, "targets": targets}])), nodes);
    // Meshes that take the name of one node above theirs; primitives whose targets have long names.
    let nodes = (0..2000).map(|i| json!({"mesh": i}));
    let root = json!({"name": "x".repeat(40_000), "children": (1..=2000).collect::<Vec<_>>()});
    refused(many(2000, &json!({})), std::iter::once(root).chain(nodes).collect());
    let list = many(1000, &json!({"attributes": {"POSITION": few[0]}, "targets": [{}]}));
    refused(json!([{"extras": {"targetNames": ["x".repeat(40_000)]}, "primitives": list}]), json!([]));
    // Copies of a mesh of many parts, all of its name, are as many as there is room for.
    let list = many(200, &json!({"attributes": {"POSITION": few[0]}}));
    file.json["meshes"] = json!([{"name": "x".repeat(9000), "primitives": list}]);
    file.json["nodes"] = many(1000, &json!({"mesh": 0}));
    assert_eq!(take(&file), None);
}

#[test]
fn a_file_beside_is_read_once_and_never_the_file_itself() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.gltf");
    let write = |uris: &[&str], count: usize| {
        let all = 0..uris.len();
        let buffers: Vec<Value> = uris.iter().map(|uri| json!({"uri": uri, "byteLength": 36})).collect();
        let views: Vec<Value> = all.clone().map(|i| json!({"buffer": i, "byteLength": 36})).collect();
        let accessor = |view| json!({"componentType": F32, "type": "VEC3", "count": 3, "bufferView": view});
        let mut accessors: Vec<Value> = all.clone().map(accessor).collect();
        accessors.push(json!({"componentType": F32, "type": "VEC3", "count": count}));
        let primitives: Vec<Value> = (0..=uris.len()).map(|i| json!({"attributes": {"POSITION": i}})).collect();
        let file = json!({"asset": {"version": "2.0"}, "buffers": buffers, "bufferViews": views,
            "accessors": accessors, "meshes": [{"primitives": primitives}]});
        std::fs::write(&path, file.to_string()).unwrap();
        file.to_string().len()
    };
    for uri in ["a.gltf", "./a.gltf", "%61.gltf"] {
        write(&[uri], 0);
        let expected = "buffers[0].uri: the glTF file itself, not a buffer; name the file";
        crate::testing::says(super::super::read(&path), &[expected]);
    }
    std::fs::write(dir.path().join("b.bin"), vec![0; 100_000]).unwrap();
    let uris: Vec<&str> = ["b.bin", "./b.bin", "%62.bin"].into_iter().cycle().take(600).collect();
    let size = 100_000 + write(&uris, 3);
    assert_eq!(within(size, || super::super::read(&path)).unwrap().meshes[0].source.positions.len(), 1803);
    // Nor do they make room for values 600 times.
    let size = 100_000 + write(&uris, 50_000_000);
    let notes = within(size, || super::super::read(&path)).unwrap().meshes[0].source.notes.join(" ");
    assert!(notes.contains("more than a file of this size can hold; the primitive is left out"), "{notes}");
}

#[test]
fn triangles_of_what_was_never_in_the_queues_name_no_vertex() {
    // The code names the edge before the last one, and a new vertex.
    let data = [&[0xe1, 0x10][..], &[0; 16]].concat();
    let decoded = decode(&data, 3, 4, "TRIANGLES", "").unwrap();
    assert_eq!(decoded, bytes(&[u32::MAX, u32::MAX, 0]));
}
