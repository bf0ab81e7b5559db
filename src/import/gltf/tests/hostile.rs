//! Files that are damaged or made to do harm: each is refused by name, place and remedy, in memory bounded by its size,
//! or used without a panic.

use super::super::{Gltf, Result, from_bytes};
use super::written::{U8, U16, Written, base64, bytes};
use crate::asset::Tolerance;
use serde_json::{Value, json};
use std::path::Path;

/// A small file with a bit of everything.
pub(super) fn small() -> Written {
    let mut file = Written::default();
    let position = file.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
    let normal = file.floats(&[[0.0, 0.0, 1.0]; 4]);
    let uv = file.floats(&[[0.0, 0.0]; 4]);
    let indices = file.accessor(U16, "SCALAR", 6, &bytes(&[0u16, 1, 2, 1, 3, 2]));
    let (joints, weights) = (file.accessor(U8, "VEC4", 4, &[0; 16]), file.floats(&[[1.0, 0.0, 0.0, 0.0]; 4]));
    let sparse = file.floats(&[[0.0; 3]; 4]);
    let (which, values) = (file.view(&[1, 3]), file.view(&bytes(&[1.0f32, 0.0, 0.0, 0.0, 0.0, 1.0])));
    file.json["accessors"][sparse]["sparse"] =
        json!({"count": 2, "indices": {"bufferView": which, "componentType": U8}, "values": {"bufferView": values}});
    let attributes =
        json!({"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv, "JOINTS_0": joints, "WEIGHTS_0": weights});
    let targets = json!([{"POSITION": sparse, "NORMAL": sparse}, {"POSITION": sparse}]);
    file.json["meshes"] = json!([{"primitives": [{"attributes": attributes, "indices": indices, "targets": targets}]}]);
    file.json["nodes"] = json!([{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 1, 0]}]);
    let bind = file.floats(&[glam::Mat4::IDENTITY.to_cols_array()]);
    file.json["skins"] = json!([{"joints": [2], "inverseBindMatrices": bind}]);
    let (times, values) =
        (file.floats(&[[0.0], [0.5], [1.0]]), file.floats(&[[0.0], [1.0], [1.0], [0.0], [0.5], [0.5]]));
    let moves = file.floats(&[[0.0f32, 1.0, 2.0]; 3]);
    file.json["animations"] = json!([{"name": "wave",
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}},
            {"sampler": 1, "target": {"node": 1, "path": "translation"}}],
        "samplers": [{"input": times, "output": values}, {"input": times, "output": moves, "interpolation": "STEP"}]}]);
    file
}

/// Read, in a multiple of the file's size.
fn read(bytes: &[u8]) -> Result<Gltf> {
    within(bytes.len(), || from_bytes(Path::new("a.glb"), bytes.to_vec()))
}

/// Do something in the memory that files of so many bytes may take: what the documentation of the module states.
fn within<T>(size: usize, read: impl FnOnce() -> T) -> T {
    let mut result = None;
    let memory = allocation_counter::measure(|| result = Some(read()));
    // Three times the budget: what is charged, copies of it while it is made, and the JSON.
    let most = 3 * ((1 << 20) + 320 * size as u64);
    assert!(memory.bytes_max <= most, "{} bytes for files of {size}", memory.bytes_max);
    result.expect("measured")
}

fn message(bytes: &[u8]) -> String {
    let text = read(bytes).expect_err("refused").to_string();
    assert!(text.starts_with("a.glb") && text.contains("; "), "{text}");
    text
}

/// The error, or the notes on what was left out.
fn said(bytes: &[u8]) -> String {
    let Ok(gltf) = read(bytes) else { return message(bytes) };
    exercise(&gltf);
    gltf.meshes.iter().flat_map(|mesh| &mesh.source.notes).chain(&gltf.notes).map(|note| format!("{note}\n")).collect()
}

/// Use a file that was accepted in every way that a host may.
fn exercise(gltf: &Gltf) {
    for mesh in &gltf.meshes {
        let count = mesh.source.positions.len();
        assert!([&mesh.joints.len(), &mesh.joint_weights.len()].iter().all(|n| **n == mesh.joints_per_vertex * count));
        if count > 0 {
            let _ = mesh.source.kept(Tolerance::default());
        }
    }
    for animation in &gltf.animations {
        let worlds = gltf.world_matrices(Some((animation, 0.3)));
        gltf.skins.iter().for_each(|skin| assert_eq!(gltf.joint_matrices(skin, &worlds).len(), skin.joints.len()));
        if let Ok(clip) = gltf.clip(animation, None) {
            assert!(clip.values.iter().all(|w| w.is_finite()), "{clip:?}");
        }
    }
    let _ = gltf.clone().into_mesh();
}

#[test]
fn a_file_that_is_cut_off_anywhere_is_refused() {
    let file = small();
    let (glb, gltf) = (file.glb(), file.stored(5));
    exercise(&read(&glb).unwrap());
    exercise(&read(&gltf).unwrap());
    // The last bytes are padding.
    (0..glb.len() - 3).for_each(|n| _ = message(&glb[..n]));
    (0..gltf.len()).for_each(|n| _ = message(&gltf[..n]));
    // Lengths that agree with what is left: the buffer is too short, or the views of it are.
    for n in 0..file.bytes.len() {
        let mut cut = Written { json: file.json.clone(), bytes: file.bytes[..n].to_vec() };
        // GLB pads the buffer to four bytes, and three more may be padding.
        if n + 7 <= file.bytes.len() {
            assert!(message(&cut.glb()).contains(": buffers[0]: "));
        }
        // What need not be there is left out.
        cut.json["buffers"][0]["byteLength"] = json!(n);
        let text = said(&cut.glb());
        assert!(text.contains(&format!("but the buffer has {n}; ")), "{text}");
    }
}

#[test]
fn what_is_wrong_is_named_with_its_place() {
    let all = u32::MAX;
    let cases: &[(&str, Value, &str)] = &[
        ("/asset/version", json!("1.0"), "asset.version: version \"1.0\", only 2 is read"),
        (
            "/extensionsRequired",
            json!(["VRMC_vrm", "KHR_x"]),
            "the extension KHR_x is required, and not read; what uses",
        ),
        ("/asset/version", json!(1.0), "asset.version: version 1.0, only 2 is read"),
        ("/nodes", json!({}), "nodes: no array"),
        ("/scene", json!(0), "scene: 0, but there are 0 scenes"),
        ("/meshes/0/primitives/0/attributes", json!({}), "meshes[0].primitives[0]: no vertices (POSITION), left out"),
        ("/accessors/3/count", json!(5), "primitives[0]: the last indices are no triangle, and left out: 5 in all"),
        ("/accessors/3/count", json!(2), "meshes[0].primitives[0]: no triangles, left out"),
        ("/accessors/0/count", json!(0), "meshes[0].primitives[0]: no vertices (POSITION), left out"),
        ("/meshes/0/name", json!("face"), "meshes[0] 'face'.primitives[0]: targets without normals, computed from"),
        ("/meshes/0/primitives/0/mode", json!(1), "meshes[0].primitives[0]: points or lines, left out"),
        ("/accessors/0/count", json!(all), "accessors[0]: 4294967295 elements of 12 bytes every 12 bytes"),
        ("/accessors/0/count", json!(u64::MAX), "accessors[0]: 18446744073709551615 elements"),
        ("/accessors/0/count", json!(-3), "accessors[0].count: -3 is no whole number"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "accessors[0]: 4 elements of 12 bytes"),
        ("/accessors/0/componentType", json!(5124), "accessors[0].componentType: 5124 is no component type"),
        ("/accessors/0/type", json!("MAT2"), "accessors[0].type: type 'MAT2'"),
        ("/accessors/0/type", json!("VEC2"), "accessors[0]: elements of 2 numbers, 3 expected"),
        ("/accessors/0/bufferView", json!(99), "accessors[0].bufferView: 99, but there are 13 bufferViews"),
        ("/accessors/1/count", json!(3), "3 elements, but there are 4 vertices (POSITION); the attribute is left out"),
        ("/accessors/5/count", json!(3), "attributes.WEIGHTS_0: accessors[5]: 3 elements, but there are 4 vertices"),
        ("/bufferViews/0/byteStride", json!(u64::MAX), "elements of 12 bytes every 18446744073709551615 bytes"),
        ("/bufferViews/0/byteLength", json!(all), "bufferViews[0]: 4294967295 bytes from byte 0 on"),
        ("/bufferViews/0/buffer", json!(7), "bufferViews[0].buffer: 7, but there are 1 buffers"),
        ("/buffers/0/byteLength", json!(all), "buffers[0]: 4294967295 bytes, but there are "),
        ("/buffers/0/uri", json!("data:;base64,A"), "buffers[0].uri: a data URI that is not base64"),
        ("/buffers/0/uri", json!("../a.bin"), "buffers[0].uri: '../a.bin' names no file beside"),
        ("/buffers/0/uri", json!("/etc/passwd"), "buffers[0].uri: '/etc/passwd' names no file beside"),
        ("/buffers/0/uri", json!("%2e%2e/../a"), "buffers[0].uri: '%2e%2e/../a' names no file beside"),
        ("/buffers/0/uri", json!("file:a.bin"), "buffers[0].uri: 'file:a.bin' names no file beside"),
        ("/accessors/6/sparse/count", json!(0), "targets[0].POSITION: accessors[6].sparse: no elements, left out"),
        ("/accessors/6/sparse/count", json!(5), "sparse.count: 5 of 4 elements"),
        ("/accessors/6/sparse/indices/byteOffset", json!(1), "sparse.indices: 2 elements of 1 bytes"),
        ("/meshes/0/primitives/0/indices", json!(0), "accessors[0]: elements of 3 numbers, 1 expected"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!("x"), "attributes.POSITION: \"x\" is no whole number"),
        ("/meshes/0/primitives/0/targets/1", json!({"TANGENT": 0}), "targets[1].TANGENT: the base pose has no tangent"),
        ("/nodes/2/children", json!([1]), "nodes[1]: a node below itself"),
        ("/nodes/0/children", json!([0]), "nodes[0]: a node below itself"),
        ("/nodes/0/children", json!([2]), "nodes[1].children[0]: node 2 is a child of node 0, too"),
        ("/nodes/0/children", json!([3]), "nodes[0].children[0]: 3, but there are 3 nodes"),
        ("/nodes/0/mesh", json!(1), "nodes[0].mesh: 1, but there are 1 meshes"),
        ("/nodes/2/translation", json!([0, 1]), "nodes[2].translation: 2 numbers, 3 expected"),
        ("/nodes/2/translation", json!([0, 1, 1e300]), "nodes[2].translation[2]: 1e"),
        ("/skins/0/joints", json!([9]), "skins[0].joints[0]: 9, but there are 3 nodes"),
        ("/skins/0/joints", json!([1, 2]), "1 matrices for 2 joints"),
        ("/accessors/6/count", json!(0), "targets[0].POSITION: accessors[6]: no elements, left out"),
        ("/accessors/7/count", json!(0), "accessors[7]: 0 matrices for 1 joints; the others have none"),
        ("/skins/0/joints", json!([]), "node 0 '' has a skin, but a vertex names joint 0 of 0: it stands"),
        ("/animations/0/samplers/0/interpolation", json!("BEZIER"), "samplers[0]: interpolation 'BEZIER'"),
        ("/animations/0/samplers/0/interpolation", json!("CUBICSPLINE"), "6 elements, but there are 18 values for all"),
        ("/animations/0/channels/0/sampler", json!(2), "channels[0].sampler: 2, but there are 2 samplers, counted"),
        ("/accessors/8/count", json!(0), "animations[0] 'wave'.channels[0]: no keys, left out"),
        (
            "/accessors/0",
            json!({"componentType": 5126, "type": "VEC3", "count": 1_000_000_000}),
            "1000000000 values of 12",
        ),
        (
            "/meshes/0/primitives/0/attributes",
            json!({"POSITION": 0}),
            "node 0 '' has a skin, but its mesh no joints: it stands as the node",
        ),
    ];
    let mut missed = vec![];
    for (at, value, expected) in cases {
        let mut file = small();
        file.set(at, value.clone());
        let text = said(&file.glb());
        if !text.contains(expected) {
            missed.push(format!("{at} = {value}: {text}"));
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
    // Draco, with the same values uncompressed, and without.
    let mut file = small();
    file.json["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_draco_mesh_compression": {}});
    assert_eq!(read(&file.glb()).unwrap().meshes[0].source.positions.len(), 4);
    file.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    let expected = "primitives[0]: compressed by Draco, which is not read; decompress the file";
    crate::testing::says(read(&file.glb()), &[expected]);
    file.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    let expected = "KHR_draco_mesh_compression is required, and not read; decompress the file: `gltf-transform copy";
    crate::testing::says(read(&file.glb()), &[expected]);
    for (at, byte, expected) in [
        (4, 1, "a.glb: GLB version 1, only 2 is read"),
        (16, b'X', "a.glb: byte 12: no chunk 'JSON' that fits the file"),
        (15, 0x7f, "a.glb: byte 12: no chunk 'JSON' that fits the file"),
    ] {
        let mut glb = small().glb();
        glb[at] = byte;
        crate::testing::says(read(&glb), &[expected]);
    }
    // What is wrong in the buffer, by view.
    let [nan, infinite, negative, two] = [f32::NAN, f32::INFINITY, -1.0, 2.0].map(|x: f32| x.to_le_bytes().to_vec());
    let not_finite = "elements that are not finite, and count as missing: 1 of 4";
    for (view, bytes, expected) in [
        (0, nan.clone(), "accessors[0]: element 0 is [NaN, 0.0, 0.0]; replace values"),
        (1, nan, &format!("NORMAL: accessors[1]: {not_finite}")),
        (2, infinite, &format!("TEXCOORD_0: accessors[2]: {not_finite}")),
        (3, vec![9, 0], "accessors[3]: index 0 names vertex 9, but there are 4"),
        (5, negative, "primitives[0]: weights of joints below 0, taken for 0: 1"),
        (10, two, "accessors[8]: key 1 at 0.5 s comes after key 0 at 2 s; the channel is left out"),
        (7, vec![3, 1], "accessors[6].sparse.indices: index 1 is 1, after 3, of 4 elements"),
        (7, vec![1, 1], "accessors[6].sparse.indices: index 1 is 1"),
        (7, vec![1, 4], "accessors[6].sparse.indices: index 1 is 4"),
    ] {
        let mut file = small();
        let offset = file.json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
        file.bytes[offset..offset + bytes.len()].copy_from_slice(&bytes);
        let text = said(&file.glb());
        assert!(text.contains(expected), "{expected}: {text}");
    }
}

#[test]
fn counts_without_bytes_take_bounded_memory() {
    // JSON that is all brackets, or deep.
    let brackets = "{\"a\":{}},".repeat(1 << 20);
    let text = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}]}}", brackets.trim_end_matches(','));
    assert!(message(text.as_bytes()).contains("so many values that they would take"));
    assert!(message(format!("{{\"a\":{}", "[".repeat(100_000)).as_bytes()).contains("recursion limit"));
    // A view that decompresses to more than its bytes can hold.
    for (count, expected) in [
        (1_000_000_000, "1000000000 values of 12 bytes, which is more than a file of this size"),
        (10_000, "10000 elements of 12 bytes, more than 48 compressed"),
    ] {
        let mut file = small();
        let packed = json!({"buffer": 0, "byteLength": 48, "byteStride": 12, "count": count, "mode": "ATTRIBUTES"});
        file.json["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": packed});
        let text = message(&file.glb());
        assert!(text.contains(&format!("EXT_meshopt_compression: {expected}")), "{text}");
    }
}

#[test]
fn base64_and_files_beside_are_read() {
    for n in 0..20u8 {
        let bytes: Vec<u8> = (0..n).map(|i| i.wrapping_mul(57) ^ n).collect();
        let text = base64(&bytes);
        assert_eq!(super::super::container::base64(&text).as_ref(), Some(&bytes));
        assert_eq!(super::super::container::base64(text.trim_end_matches('=')), Some(bytes));
    }
    assert_eq!(super::super::container::base64("AA*A"), None);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.gltf");
    std::fs::create_dir(dir.path().join("my buffers")).unwrap();
    let mut file = small();
    for (uri, name) in [
        ("my%20buffers/a.bin", "my buffers/a.bin"),
        ("./10%.bin", "10%.bin"),
        ("10%ab.bin", "10%ab.bin"),
        ("g%20h.bin", "g%20h.bin"),
        ("ä ö.bin", "ä ö.bin"),
    ] {
        file.json["buffers"][0]["uri"] = json!(uri);
        std::fs::write(dir.path().join(name), &file.bytes).unwrap();
        std::fs::write(&path, file.json.to_string()).unwrap();
        let gltf = super::super::read(&path).unwrap();
        assert_eq!((gltf.name.as_str(), gltf.meshes[0].source.positions.len()), ("a", 4));
        std::fs::remove_file(dir.path().join(name)).unwrap();
        crate::testing::says(super::super::read(&path), &[".bin: cannot read"]);
    }
    file.json["buffers"][0]["uri"] = json!("%61.gltf");
    std::fs::write(&path, file.json.to_string()).unwrap();
    crate::testing::says(super::super::read(&path), &["buffers[0].uri: the glTF file itself, not a buffer; name the"]);
}
