//! glTF files of the data sets against their folders, and a textured head with seams.

use crate::data;
use deltamorph::import::gltf::{self, Gltf, Mesh, Property, Transform};
use deltamorph::import::{self, ImportDesc, ImportedMesh, csv, obj};
use deltamorph::reference::evaluate_unpacked;
use deltamorph::{MorphMesh, MorphSource, POSE_FLOATS, Tolerance};
use glam::{DMat4, DVec3};
use std::path::Path;

fn raw(source: &MorphSource) -> MorphMesh {
    source.to_mesh(Tolerance::ZERO).unwrap()
}

fn positions(mesh: &MorphMesh, weights: &[f32]) -> Vec<DVec3> {
    evaluate_unpacked(mesh, weights).chunks_exact(POSE_FLOATS).map(|v| DVec3::from_slice(&v[..3])).collect()
}

fn normals(mesh: &MorphMesh, weights: &[f32]) -> Vec<DVec3> {
    evaluate_unpacked(mesh, weights).chunks_exact(POSE_FLOATS).map(|v| DVec3::from_slice(&v[3..])).collect()
}

fn open(path: &Path) -> (MorphSource, Vec<std::path::PathBuf>) {
    let imported = import::open(path, &ImportDesc::default()).unwrap();
    let ImportedMesh::Source(source) = imported.mesh else { panic!("nothing is packed") };
    (source, imported.clips)
}

fn head(gltf: &Gltf) -> (&Mesh, DMat4) {
    let mesh = gltf.meshes.iter().position(|mesh| !mesh.source.targets.is_empty()).unwrap();
    let node = gltf.nodes.iter().find(|node| node.mesh == Some(mesh)).unwrap();
    let Transform::Parts { translation, rotation, scale } = node.local else { panic!("parts") };
    let matrix = DMat4::from_scale_rotation_translation(scale.as_dvec3(), rotation.as_dquat(), translation.as_dvec3());
    (&gltf.meshes[mesh], matrix)
}

#[test]
fn facecap_has_the_poses_of_its_folder() {
    let Some(folder) = data::set("facecap_head_glb") else { return };
    let file = gltf::read(&folder.join("source/facecap.glb")).unwrap();
    let (mesh, place) = head(&file);
    let source = obj::import_folder(&folder).unwrap();
    let (own, expected) = (raw(&mesh.source), raw(&source));
    let names = |mesh: &MorphMesh| mesh.targets.iter().map(|t| t.name.clone()).collect::<Vec<_>>();
    let order: Vec<usize> = names(&own).iter().map(|name| expected.target_index(name).expect("a target")).collect();
    assert_eq!((order.len(), own.vertex_count(), mesh.source.name.as_str()), (52, 2694, "head"));
    // The folder has the mesh with y up, in the node's scale.
    let turn = |p: DVec3| DVec3::new(p.x, -p.z, p.y);
    let (clip, diagonal) =
        (csv::read(&folder.join("weights/facecap_30fps.csv"), None).unwrap(), f64::from(expected.diagonal));
    let clip = clip.bind(&names(&own).iter().map(String::as_str).collect::<Vec<_>>()).unwrap();
    let mut worst = 0.0f64;
    for weights in clip.frames().step_by(10).chain((0..52).map(|t| (0..52).map(|i| f32::from(i == t)).collect())) {
        let mut of_folder = vec![0.0; 52];
        order.iter().zip(&weights).for_each(|(&to, &w)| of_folder[to] = w);
        let expected_pose = positions(&expected, &of_folder);
        for (p, e) in positions(&own, &weights).iter().zip(&expected_pose) {
            worst = worst.max((turn(place.transform_point3(*p)) - *e).length() / diagonal);
        }
        let expected_normals = normals(&expected, &of_folder);
        for (n, e) in normals(&own, &weights).iter().zip(&expected_normals) {
            // The folder's base normals are the 8-bit ones, whose length differs from 1 by less than 1%.
            assert!((turn(*n) - *e).length() < 2e-3, "{n} {e}");
        }
    }
    println!("facecap.glb: {worst:.1e} of the diagonal");
    assert!(worst < 2e-5, "{worst:e}");
    assert_eq!(own.faces.triangles(&own.positions), expected.faces.triangles(&expected.positions));

    // The same file without compression and quantisation.
    let decoded = gltf::read(&folder.join("source/facecap_decoded.glb")).unwrap();
    for (a, b) in file.meshes.iter().zip(&decoded.meshes) {
        let triangles = |mesh: &Mesh| {
            let at = |v: u32| (mesh.source.positions[v as usize], mesh.source.texcoords[v as usize]);
            mesh.source.faces.triangles(&mesh.source.positions).into_iter().map(|t| t.map(at)).collect::<Vec<_>>()
        };
        assert_eq!(triangles(a).len(), triangles(b).len());
        assert_eq!(triangles(a), triangles(b), "{}", a.source.name);
    }
    assert_eq!(file.animations.len(), 4);
    for (a, b) in file.animations.iter().zip(&decoded.animations).map(|(a, b)| (&a.channels, &b.channels)) {
        for (a, b) in a.iter().zip(b) {
            assert_eq!((a.property, a.times.len()), (b.property, b.times.len()));
            let off = a.values.iter().zip(&b.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1e-4, "{:?}: {off}", a.property);
        }
    }
}

#[test]
fn facecap_plays_its_own_clip() {
    let Some(folder) = data::set("facecap_head_glb") else { return };
    let (source, clips) = open(&folder.join("source/facecap.glb"));
    assert_eq!(clips.len(), 1, "{clips:?}");
    assert!(
        source.notes.iter().any(|note| note.contains("no part of the mesh: 'eyeLeft', 'eyeRight', 'teeth'")),
        "{:?}",
        source.notes
    );
    let clip = import::open_clip(&clips[0], None).unwrap();
    let expected = csv::read(&folder.join("weights/facecap_30fps.csv"), None).unwrap();
    assert_eq!((clip.fps, clip.frame_count()), (30.0, expected.frame_count()));
    let names: Vec<&str> = source.targets.iter().map(|t| t.name.as_str()).collect();
    let (clip, expected) = (clip.bind(&names).unwrap(), expected.bind(&names).unwrap());
    for (frame, (a, b)) in clip.frames().zip(expected.frames()).enumerate() {
        let off = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 1e-5, "frame {frame}: {off}");
    }
    let mesh = source.to_mesh(Tolerance::default()).unwrap();
    // In the scene's scale: a tenth of the node's.
    assert!((mesh.diagonal / 3.826 - 1.0).abs() < 0.1, "{}", mesh.diagonal);
}

#[test]
fn the_stress_test_plays_as_its_keys_say() {
    let Some(folder) = data::set("morph_stress_test") else { return };
    let expected = obj::import_folder(&folder).unwrap();
    for (name, keys_are_frames) in [("MorphStressTest.gltf", true), ("MorphStressTest_playcanvas_copy.glb", false)] {
        let path = folder.join("source").join(name);
        let file = gltf::read(&path).unwrap();
        assert_eq!(file.animations.len(), 3);
        let mesh = &file.meshes[0];
        assert_eq!(mesh.primitives.len(), 2);
        assert_eq!(mesh.constants.iter().map(|s| s.semantic.to_string()).collect::<Vec<_>>(), ["texcoord 1"]);
        // The folder holds the second primitive.
        let part = mesh.primitives[1].vertices.clone();
        let (own, folder_mesh) = (raw(&mesh.source), raw(&expected));
        assert_eq!(part.len(), folder_mesh.vertex_count());
        for animation in &file.animations {
            let clip = file.clip(animation, None).unwrap();
            let names: Vec<&str> = mesh.source.targets.iter().map(|t| t.name.as_str()).collect();
            let bound = clip.bind(&names).unwrap();
            let channel = &animation.channels[0];
            assert_eq!(channel.property, Property::Weights);
            assert_eq!(channel.times.len(), bound.frame_count(), "{name} {}", animation.name);
            for (key, frame) in channel.values.chunks_exact(8).zip(bound.frames()) {
                assert_eq!(key, frame, "{name} {}", animation.name);
            }
            if keys_are_frames {
                let csv =
                    csv::read(&folder.join("weights").join(format!("{}_24fps.csv", animation.name)), None).unwrap();
                assert_eq!((clip.fps, clip.frame_count()), (24.0, csv.frame_count()));
                let off = clip.values.iter().zip(&csv.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(off < 1e-6, "{}: {off}", animation.name);
            }
            for weights in bound.frames().step_by(9) {
                let (own, expected) = (positions(&own, &weights), positions(&folder_mesh, &weights));
                let off = own[part.clone()].iter().zip(&expected).map(|(a, b)| (*a - *b).length()).fold(0.0, f64::max);
                assert!(off < 2e-5 * f64::from(folder_mesh.diagonal), "{name} {}: {off}", animation.name);
            }
        }
    }
    let (source, clips) = open(&folder.join("source/MorphStressTest.gltf"));
    assert_eq!((source.targets.len(), clips.len()), (8, 3));
    let refused = import::open_clip(&folder.join("source/MorphStressTest.gltf#TheWav"), None).unwrap_err().to_string();
    assert!(
        refused.contains("MorphStressTest.gltf: no animation of weights is called 'TheWav'; name one of: "),
        "{refused}"
    );
}
