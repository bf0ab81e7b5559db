//! Files that say the same in different bytes are the same asset, bit for bit.

use super::super::{Gltf, from_bytes};
use super::written::{F32, I8, I16, U8, U16, Written, bytes};
use glam::Vec3;
use proptest::prelude::*;
use serde_json::json;
use std::path::Path;

/// The type of numbers, the stride, and which elements are sparse.
type Way = [usize; 3];

/// Stores integers that a byte holds.
fn stored<const N: usize>(file: &mut Written, kind: &str, values: &[[i8; N]], [number, stride, sparse]: Way) -> usize {
    let numbers = |values: &[i8]| -> Vec<u8> {
        match number {
            0 => bytes(values),
            1 => values.iter().flat_map(|x| i16::from(*x).to_le_bytes()).collect(),
            _ => values.iter().flat_map(|x| f32::from(*x).to_le_bytes()).collect(),
        }
    };
    // Over zeros, over other values of every second element, and of no element.
    let is_other = |v: usize| sparse == 1 && values[v] != [0; N] || sparse == 2 && v.is_multiple_of(2);
    let others: Vec<usize> = (0..values.len()).filter(|v| is_other(*v)).collect();
    let gap = [0, 0, 4, 8][stride];
    let element = |v: usize| {
        if is_other(v) {
            vec![5; numbers(&values[v]).len() + gap]
        } else {
            [numbers(&values[v]), vec![9; gap]].concat()
        }
    };
    let dense: Vec<u8> = (0..values.len()).flat_map(element).collect();
    let accessor = file.accessor([I8, I16, F32][number], kind, values.len(), &dense);
    let view = file.json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
    match stride {
        0 => {}
        1 => file.json["bufferViews"][view]["byteStride"] = json!(0),
        _ => file.json["bufferViews"][view]["byteStride"] = json!(numbers(&[0; N]).len() + gap),
    }
    if sparse == 1 {
        file.json["accessors"][accessor].as_object_mut().unwrap().remove("bufferView");
    }
    let (of, at) = (
        file.view(&others.iter().flat_map(|v| (*v as u16).to_le_bytes()).collect::<Vec<u8>>()),
        file.view(&others.iter().flat_map(|v| numbers(&values[*v])).collect::<Vec<u8>>()),
    );
    if sparse == 3 || !others.is_empty() {
        file.json["accessors"][accessor]["sparse"] = json!({"count": others.len(),
            "indices": {"bufferView": of, "componentType": U16}, "values": {"bufferView": at}});
    }
    accessor
}

/// A mesh of two targets, with a clip: `ways` say how it is stored.
fn written(values: &[[i8; 3]], ways: &[Way], wrap: usize) -> Vec<u8> {
    let mut file = Written::default();
    let halves: Vec<[i8; 3]> = values.iter().map(|v| v.map(|x| x / 2)).collect();
    let corners: Vec<u16> = (0..values.len() as u16).collect();
    let indices = file.accessor(U16, "SCALAR", corners.len(), &bytes(&corners));
    let times = file.floats(&[[0.0], [0.5]]);
    let weights = stored(&mut file, "SCALAR", &[[0], [1], [1], [0]], [2, 0, ways[0][2]]);
    let targets = [(values, ways[0]), (&halves, ways[1])].map(|(values, way)| stored(&mut file, "VEC3", values, way));
    let positions: Vec<[i8; 3]> = (0..values.len()).map(|v| [v as i8, (v * v % 7) as i8, 1]).collect();
    let positions = stored(&mut file, "VEC3", &positions, ways[2]);
    let targets = targets.map(|target| json!({"POSITION": target}));
    file.json["meshes"] = json!([{"primitives": [
        {"attributes": {"POSITION": positions}, "indices": indices, "targets": targets}]}]);
    file.json["nodes"] = json!([{"mesh": 0}]);
    file.json["animations"] = json!([{"samplers": [{"input": times, "output": weights}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}]);
    // Some exporters count the padding of the buffer in its own length, too.
    let length = file.bytes.len();
    file.json["buffers"][0]["byteLength"] = json!(if wrap == 0 { length } else { length.next_multiple_of(4) });
    file.stored(wrap)
}

proptest! {
    #[test]
    fn files_that_say_the_same_are_the_same(
        values in prop::collection::vec(prop::array::uniform3(prop_oneof![2 => Just(0i8), 1 => -127i8..=127]), 3..40),
        ways in prop::array::uniform3([0usize..3, 0usize..4, 0usize..4]), wrap in 0usize..8,
    ) {
        let values = &values[..values.len() / 3 * 3];
        let read = |file: Vec<u8>| {
            let Gltf { mut meshes, animations, .. } = from_bytes(Path::new("a.glb"), file).unwrap();
            meshes[0].source.notes.clear();
            (format!("{meshes:?} {animations:?}"), meshes)
        };
        let (expected, meshes) = read(written(values, &[[2, 0, 0]; 3], 0));
        prop_assert_eq!(read(written(values, &ways, wrap)).0, expected);
        let moved = (0..).zip(values).map(|(v, d)| (v, Vec3::from(d.map(f32::from))));
        let moved: Vec<(u32, Vec3)> = moved.filter(|(_, d)| *d != Vec3::ZERO).collect();
        prop_assert_eq!(&meshes[0].source.targets[0].positions, &moved);
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
        let mut file = Written::default();
        let accessor = file.accessor(component, "VEC3", 3, &stored.repeat(3));
        file.json["accessors"][accessor]["normalized"] = json!(true);
        file.json["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": accessor}}]}]);
        let read = from_bytes(Path::new("a.glb"), file.glb()).unwrap();
        assert_eq!(read.meshes[0].source.positions[1], Vec3::from(expected), "{component}");
    }
}
