//! Files with one part that cannot be used: what is left is read as it would be without that part, with a note.

use super::hostile::small;
use super::written::{F32, I16, U8, bytes};
use super::*;

const HAIR: [[f32; 3]; 3] = [[5.0, 0.0, 0.0], [6.0, 0.0, 0.0], [5.0, 1.0, 0.0]];

/// What is read of a file of a face and hair, after `change` has made a part of it unusable; and the notes.
fn left(change: impl FnOnce(&mut Written)) -> (Mesh, Vec<Mesh>, String) {
    let mut file = small();
    let hair = file.floats(&HAIR);
    let skin = file.json["meshes"][0]["primitives"][0]["attributes"].clone();
    let hair = json!({"name": "hair", "primitives": [{"attributes": {"POSITION": hair}, "material": 0}]});
    file.json["meshes"].as_array_mut().unwrap().push(hair);
    file.json["nodes"].as_array_mut().unwrap().push(json!({"name": "hair", "mesh": 1}));
    file.json["materials"] = json!([{}]);
    file.json["accessors"][skin["JOINTS_0"].as_u64().unwrap() as usize]["name"] = json!("joints");
    change(&mut file);
    let read = file.read().expect("what is left is read");
    let mut notes = read.notes.clone();
    notes.extend(read.meshes.iter().flat_map(|mesh| mesh.source.notes.clone()));
    let Scene { mesh, still } = read.into_scene().expect("what is left is read");
    (mesh.source, still.into_iter().map(|still| still.source).collect(), notes.join("\n"))
}

#[test]
fn a_part_that_cannot_be_used_costs_itself() {
    let (whole, hair, _) = left(|_| {});
    assert_eq!((whole.targets.len(), hair.len()), (2, 1));
    for (at, value, note, keeps_hair) in [
        ("/meshes/1/primitives/0/attributes/POSITION", json!(99), "; the primitive is left out", false),
        ("/meshes/1/primitives", json!("none"), "meshes[1] 'hair'.primitives: no array; the mesh is left out", false),
        ("/meshes/1/primitives/0/indices", json!(0), "3 numbers, 1 expected; the primitive is left out", false),
        ("/meshes/1/primitives/0/material", json!(-1), "; the material is left out", true),
        ("/nodes/3/matrix", json!([null]), "nodes[3] 'hair'.matrix[0]: null is no number", false),
        ("/nodes/3/skin", json!(7), "nodes[3] 'hair'.skin: 7, but there are 1 skins", true),
        ("/nodes/3/children", json!([0, 9]), "nodes[3] 'hair'.children[1]: 9, but there are 4 nodes", true),
        ("/nodes/2/children", json!([2]), "nodes[2].children[0]: node 2 is a child of node 1, too; the child is", true),
        ("/scenes", json!([{"nodes": [0, 1, 3, 8]}]), "scenes[0].nodes[3]: 8, but there are 4 nodes", true),
        ("/materials/0/alphaMode", json!("blend"), "materials[0]: alphaMode 'blend', taken for OPAQUE", true),
        (
            "/materials/0/pbrMetallicRoughness",
            json!({"baseColorFactor": [1, null, 0, 1]}),
            "baseColorFactor[1]: null is no number that single precision holds; the colour is left out",
            true,
        ),
        ("/buffers/1", json!({"uri": "textures.bin", "byteLength": 4}), "", true),
        ("/animations/0/channels/1/sampler", json!(9), "; the channel is left out", true),
    ] {
        let (face, hair, notes) = left(|file| {
            file.json["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 1}));
            file.set(at, value.clone());
        });
        assert!(notes.contains(note), "{at}: {note}: {notes}");
        assert_eq!(face.positions, whole.positions, "{at}");
        assert_eq!(format!("{:?}", face.targets), format!("{:?}", whole.targets), "{at}");
        assert_eq!(hair.len(), usize::from(keeps_hair), "{at}: {notes}");
    }
    // A target that cannot be used moves nothing; the others do.
    for (deltas, note) in [
        (&[[f32::NAN, 0.0, 0.0]; 4][..], "element 0 is [NaN, 0.0, 0.0]"),
        (&[[0.5, 0.0, 0.0]; 3], "3 elements, but there are 4 vertices (POSITION)"),
    ] {
        let (face, _, notes) = left(|file| {
            let deltas = file.floats(deltas);
            file.set("/meshes/0/primitives/0/targets/1/POSITION", json!(deltas));
        });
        assert!(notes.contains(&format!("{note}; the target 'target 1' is left out")), "{notes}");
        assert_eq!(face.targets[0].positions, whole.targets[0].positions);
        assert!(face.targets[1].positions.is_empty() && face.targets.len() == 2);
    }
}

/// Joints may be of types that glTF does not allow for them, if they say the same.
#[test]
fn joints_are_read_from_numbers_of_any_type() {
    let (whole, ..) = left(|_| {});
    let no_joint = "element 0 is no whole number, 0 or more; the skin of this primitive is left out";
    for (component, kind, bytes, expected) in [
        (F32, "VEC4", bytes(&[0.0f32; 16]), ""),
        (I16, "VEC4", bytes(&[0i16; 16]), ""),
        (U8, "VEC2", vec![0; 8], ""),
        (F32, "SCALAR", bytes(&[0.0f32; 4]), ""),
        // Half a joint is none: the mesh stands where its node does.
        (F32, "SCALAR", bytes(&[0.5f32; 4]), no_joint),
    ] {
        let (face, _, notes) = left(|file| {
            let joints = file.accessor(component, kind, 4, &bytes);
            file.set("/meshes/0/primitives/0/attributes/JOINTS_0", json!(joints));
        });
        assert!(notes.contains(expected) && notes.contains("left out") != expected.is_empty(), "{notes}");
        assert_eq!(face.positions == whole.positions, expected.is_empty(), "{component} {kind}: {notes}");
    }
}
