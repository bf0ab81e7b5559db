//! Files made here, piece by piece: what is read of them.

mod alike;
mod hostile;
mod meshopt;
mod partial;
mod scene;
mod several;
mod written;

use super::*;
use crate::asset::{Semantic, StreamDeltas, Tolerance};
use crate::{PackDesc, PackedMesh};
use glam::Vec3;
use serde_json::{Value, json};
use written::{U8, U16, Written, bytes};

impl Written {
    fn read(&self) -> Result<Gltf> {
        from_bytes(Path::new("a.glb"), self.glb())
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
    let GltfMesh { source, constants, .. } = mesh;
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
    let StreamDeltas { vertices, deltas } = &source.targets[1].streams[0];
    assert_eq!((&vertices[..], &deltas[..]), (&[0, 2][..], &[0.0, 2.0, 0.0, 0.0, 0.0, 0.0][..]));
    assert_eq!(source.targets[1].streams[1].deltas, [0.25, 0.5]);
    assert_eq!(source.streams[2].values[..4], [1.0, 0.5, 0.25, 1.0]);
    assert_eq!((source.targets[2].streams[2].vertices[0], source.targets[2].streams[2].deltas[0]), (2, 0.5));
    let built = source.kept(Tolerance::default()).unwrap();
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
            "JOINTS_1": joints, "WEIGHTS_1": weights, "JOINTS_2": joints, "WEIGHTS_2": weights}, "mode": 6, "targets": targets},
    ]}]);
    let read = file.read().unwrap();
    let mesh @ GltfMesh { source, primitives, .. } = &read.meshes[0];
    assert_eq!(source.faces.triangles(&source.positions), [[0, 1, 2], [1, 3, 2], [5, 6, 4], [6, 7, 4]]);
    assert_eq!((primitives[1].index, &primitives[1].vertices, &primitives[1].triangles), (2, &(4..8), &(2..4)));
    assert_eq!(source.targets[0].positions.len(), 8);
    assert_eq!(source.notes[0], "meshes[0].primitives[1]: points or lines, left out");
    // Places that all primitives share are welded; texture coordinates are there for one of them only.
    assert_eq!(source.welds, [0, 1, 2, 3, 0, 1, 2, 3]);
    assert_eq!((source.texcoords[0].x, source.texcoords[5].x), (0.0, 0.25));
    assert_eq!((mesh.joints_per_vertex, mesh.joint_weights.len(), mesh.joints.len()), (12, 96, 96));
    assert_eq!(mesh.joint_weights[..48], [0.0; 48]);
    assert_eq!(mesh.joint_weights[48..60], [[0.25, 1.0 / 12.0, 0.0, 0.0]; 3].concat());
    source.kept(Tolerance::default()).unwrap();
}
