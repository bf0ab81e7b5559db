//! Files made here, piece by piece: what is read of them.

mod bounded;
mod hostile;
mod meshopt;
mod scene;
mod several;
mod written;

use super::*;
use crate::asset::{Semantic, Tolerance};
use crate::{DeltaFormat, PackDesc, PackedMesh};
use glam::Vec3;
use proptest::prelude::*;
use serde_json::{Value, json};
use written::{F32, I8, I16, U8, U16, Written, bytes};

impl Written {
    fn read(&self) -> Result<Gltf> {
        from_bytes(Path::new("a.glb"), self.glb())
    }
}

/// The deltas of the only target of the only mesh.
fn deltas(file: &Written) -> Vec<(u32, Vec3)> {
    file.read().unwrap().meshes[0].source.targets[0].positions.clone()
}

/// Vertices in a row, and a target whose POSITION is to be set.
fn row(count: usize) -> Written {
    let mut file = Written::default();
    let positions: Vec<[f32; 3]> = (0..count).map(|i| [i as f32, (i * i % 7) as f32, 0.0]).collect();
    let position = file.floats(&positions);
    file.json["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": position}, "targets": [{}]}]}]);
    file
}

fn set_target(file: &mut Written, accessor: usize) {
    file.json["meshes"][0]["primitives"][0]["targets"][0]["POSITION"] = json!(accessor);
}

proptest! {
    /// The same deltas are read from accessors of every kind.
    #[test]
    fn accessors_of_every_kind_say_the_same(
        values in prop::collection::vec(prop::array::uniform3(prop_oneof![2 => Just(0i8), 1 => -127i8..=127]), 1..40),
    ) {
        let count = values.len() * 3;
        let dense: Vec<[i8; 3]> = values.iter().flat_map(|v| [*v, [0; 3], v.map(|x| x / 2)]).collect();
        let expected = |scale: f32| -> Vec<(u32, Vec3)> {
            let all = dense.iter().enumerate().map(|(i, v)| (i as u32, Vec3::from(v.map(|x| f32::from(x) / scale))));
            all.filter(|(_, d)| *d != Vec3::ZERO).collect()
        };
        let moved: Vec<(u32, [i8; 3])> = (0..).zip(dense.iter().copied()).filter(|(_, v)| *v != [0; 3]).collect();
        let shorts = dense.iter().flatten().flat_map(|x| i16::from(*x).to_le_bytes()).collect::<Vec<u8>>();
        let floats = dense.iter().flatten().flat_map(|x| f32::from(*x).to_le_bytes()).collect::<Vec<u8>>();
        // Four bytes an element, and three bytes of something else before the first one.
        let strided: Vec<u8> =
            [9, 9, 9].into_iter().chain(dense.iter().flat_map(|v| [v[0] as u8, v[1] as u8, v[2] as u8, 7])).collect();
        let indices: Vec<u8> = moved.iter().flat_map(|(v, _)| (*v as u16).to_le_bytes()).collect();
        let sparse_values: Vec<u8> = moved.iter().flat_map(|(_, d)| d.map(|x| x as u8)).collect();

        for (component, normalised, bytes, scale) in [
            (F32, false, &floats, 1.0),
            (I16, false, &shorts, 1.0),
            (I16, true, &shorts, 32767.0),
            (I8, true, &dense.iter().flatten().map(|x| *x as u8).collect(), 127.0),
        ] {
            let mut file = row(count);
            let accessor = file.accessor(component, "VEC3", count, bytes);
            file.json["accessors"][accessor]["normalized"] = json!(normalised);
            set_target(&mut file, accessor);
            let found = deltas(&file);
            prop_assert_eq!(found.len(), expected(scale).len());
            for ((v, a), (w, b)) in found.iter().zip(expected(scale)) {
                prop_assert!(*v == w && (*a - b).length() <= 1e-7 * b.length(), "{} {}", a, b);
            }
        }
        let mut file = row(count);
        let accessor = file.accessor(I8, "VEC3", count, &strided);
        file.json["accessors"][accessor]["byteOffset"] = json!(3);
        let view = file.json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
        file.json["bufferViews"][view]["byteStride"] = json!(4);
        set_target(&mut file, accessor);
        prop_assert_eq!(deltas(&file), expected(1.0));

        // Sparse over zeros, and over dense values that it replaces; none at all.
        for over_dense in [false, true] {
            let mut file = row(count);
            let mut base = dense.clone();
            base.iter_mut().step_by(2).for_each(|v| *v = if *v == [0; 3] { [0; 3] } else { [5, 6, 7] });
            let accessor = file.accessor(I8, "VEC3", count,
                &base.iter().flatten().map(|x| *x as u8).collect::<Vec<_>>());
            if !over_dense {
                file.json["accessors"][accessor].as_object_mut().unwrap().remove("bufferView");
            }
            let (of, at) = (file.view(&indices), file.view(&sparse_values));
            if !moved.is_empty() {
                file.json["accessors"][accessor]["sparse"] = json!({
                    "count": moved.len(), "indices": {"bufferView": of, "componentType": U16},
                    "values": {"bufferView": at}});
            }
            set_target(&mut file, accessor);
            prop_assert_eq!(deltas(&file), expected(1.0));
            file.json["accessors"][accessor].as_object_mut().unwrap().remove("sparse");
            file.json["accessors"][accessor].as_object_mut().unwrap().remove("bufferView");
            prop_assert_eq!(deltas(&file), vec![]);
        }
    }
}

#[test]
fn normalised_integers_end_at_one() {
    for (component, stored, expected) in [
        (I8, vec![0x80, 0x81, 0x7f], [-1.0, -1.0, 1.0]),
        (U8, vec![0, 51, 255], [0.0, 0.2, 1.0]),
        (I16, bytes(&[-32768i16, -32767, 32767]), [-1.0, -1.0, 1.0]),
        (U16, bytes(&[0u16, 13107, 65535]), [0.0, 0.2, 1.0]),
    ] {
        let mut file = row(3);
        let accessor = file.accessor(component, "VEC3", 3, &[stored.clone(), stored.clone(), stored].concat());
        file.json["accessors"][accessor]["normalized"] = json!(true);
        set_target(&mut file, accessor);
        assert_eq!(deltas(&file)[1].1, Vec3::from(expected), "{component}");
    }
}

#[test]
fn every_stream_morphs_and_what_no_target_moves_is_constant() {
    let mut file = Written::default();
    let normals = [[0.0, 0.0, 2.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
    let attributes = json!({
        "POSITION": file.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), "NORMAL": file.floats(&normals),
        "TANGENT": file.floats(&[[2.0, 0.0, 0.0, -1.0], [1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]]),
        "TEXCOORD_0": file.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
        "TEXCOORD_1": file.floats(&[[0.5, 0.5], [0.5, 0.5], [0.5, 0.5]]),
        "COLOR_0": file.floats(&[[1.0, 0.5, 0.25]; 3]), "_OWN": file.floats(&[[1.0]; 3]),
    });
    let targets = json!([
        {"POSITION": file.floats(&[[0.0, 0.0, 1.0], [0.0; 3], [0.0; 3]]),
         "NORMAL": file.floats(&[[2.0, 0.0, 0.0], [0.0; 3], [0.0; 3]])},
        {"TANGENT": file.floats(&[[0.0, 4.0, 0.0], [0.0; 3], [0.0, 1.0, 0.0]]),
         "TEXCOORD_0": file.floats(&[[0.0; 2], [0.25, 0.5], [0.0; 2]])},
        {"COLOR_0": file.floats(&[[0.0; 3], [0.0; 3], [0.5, 0.0, 0.0]])},
    ]);
    file.json["meshes"] = json!([{"extras": {"targetNames": ["up", "up"]}, "weights": [0.5],
        "primitives": [{"attributes": attributes, "targets": targets, "material": 3}]}]);
    file.json["nodes"] = json!([{"children": [1], "name": "Anna"}, {"mesh": 0}]);
    let read = file.read().unwrap();
    let mesh = &read.meshes[0];
    let Mesh { source, constants, .. } = mesh;
    assert_eq!(source.name, "Anna");
    assert_eq!(source.targets.iter().map(|t| t.name.as_str()).collect::<Vec<_>>(), ["up", "up 2", "target 2"]);
    assert_eq!((&mesh.weights[..], mesh.primitives[0].material), (&[0.5, 0.0, 0.0][..], Some(3)));
    let semantics: Vec<Semantic> = source.streams.iter().map(|s| s.semantic).collect();
    assert_eq!(semantics, [Semantic::Tangent, Semantic::TexCoord(0), Semantic::Color(0)]);
    assert_eq!((constants.len(), constants[0].semantic), (1, Semantic::TexCoord(1)));
    assert_eq!(source.texcoords[2].to_array(), [0.0, 1.0]);
    // Brought to unit length, and deltas with them.
    assert_eq!(source.streams[0].values[..8], [1.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 1.0]);
    assert_eq!(source.streams[0].values[8..], [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(source.normals.as_ref().unwrap()[0], Vec3::Z);
    assert_eq!(source.targets[0].normals, Some(vec![(0, Vec3::X)]));
    assert_eq!(
        (&source.targets[1].streams[0].vertices[..], &source.targets[1].streams[0].deltas[..]),
        (&[0, 2][..], &[0.0, 2.0, 0.0, 0.0, 0.0, 0.0][..])
    );
    assert_eq!(source.targets[1].streams[1].deltas, [0.25, 0.5]);
    assert_eq!(source.streams[2].values[..4], [1.0, 0.5, 0.25, 1.0]);
    assert_eq!((source.targets[2].streams[2].vertices[0], source.targets[2].streams[2].deltas[0]), (2, 0.5));
    let built = source.to_mesh(Tolerance::default()).unwrap();
    assert_eq!(PackedMesh::pack(&built, &PackDesc::default()).unwrap().groups().len(), 3);
}

#[test]
fn primitives_are_one_mesh_and_strips_and_fans_are_triangles() {
    let mut file = Written::default();
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let position = file.floats(&corners);
    let uv = file.floats(&[[0.25, 0.5]; 4]);
    let delta = file.floats(&[[0.0, 0.0, 1.0]; 4]);
    let (joints, weights) =
        (file.accessor(U8, "VEC4", 4, &[1, 0, 0, 0].repeat(4)), file.floats(&[[3.0, 1.0, 0.0, 0.0]; 4]));
    let targets = json!([{"POSITION": delta}]);
    let strip = file.accessor(U16, "SCALAR", 6, &bytes(&[0u16, 1, 2, 3, 3, 3]));
    file.json["meshes"] = json!([{"primitives": [
        {"attributes": {"POSITION": position}, "indices": strip, "mode": 5, "targets": targets},
        {"attributes": {"POSITION": position}, "mode": 0, "targets": targets},
        {"attributes": {"POSITION": position, "TEXCOORD_0": uv, "JOINTS_0": joints, "WEIGHTS_0": weights,
            "JOINTS_1": joints, "WEIGHTS_1": weights}, "mode": 6, "targets": targets},
    ]}]);
    let read = file.read().unwrap();
    let Mesh { source, primitives, influences, .. } = &read.meshes[0];
    assert_eq!(source.faces.triangles(&source.positions), [[0, 1, 2], [1, 3, 2], [5, 6, 4], [6, 7, 4]]);
    assert_eq!((primitives[1].index, &primitives[1].vertices, &primitives[1].triangles), (2, &(4..8), &(2..4)));
    assert_eq!(source.targets[0].positions.len(), 8);
    assert!(source.notes[0].contains("primitives[1] is points or lines"), "{:?}", source.notes);
    // Places that all primitives share are welded; texture coordinates are there for one of them only.
    assert_eq!(source.welds, [0, 1, 2, 3, 0, 1, 2, 3]);
    assert_eq!((source.texcoords[0].x, source.texcoords[5].x), (0.0, 0.25));
    let influences = influences.as_ref().unwrap();
    assert_eq!((influences.per_vertex, influences.weights.len(), influences.joints.len()), (8, 64, 64));
    assert_eq!(influences.weights[..32], [0.0; 32]);
    assert_eq!(influences.weights[32..40], [0.375, 0.125, 0.0, 0.0, 0.375, 0.125, 0.0, 0.0]);
    source.to_mesh(Tolerance::default()).unwrap();
}
