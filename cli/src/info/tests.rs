//! Tests of `info`.

use super::*;
use deltamorph::internals::diagonal;
use deltamorph::{Corner, Faces, Tolerance, WeightClip};
use std::sync::Arc;

/// 130 vertices in a row; one target moves 0..64 (a whole block), one moves 63, 64 and 129, one nothing.
pub fn mesh() -> MorphMesh {
    let positions: Vec<Vec3> = (0..130).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
    let target = |name: &str, vertices: Vec<u32>| MorphTarget {
        name: name.into(),
        positions: vertices.iter().map(|&v| Vec3::new(0.1, v as f32 * 0.003, -0.2)).collect(),
        normals: vertices.iter().map(|&v| Vec3::new(0.01 * v as f32, 0.2, 0.0)).collect(),
        vertices,
        streams: vec![],
    };
    let corner = |position| Corner { position, texcoord: None };
    MorphMesh {
        name: "row".into(),
        normals: vec![Vec3::Z; positions.len()],
        faces: Faces { sizes: vec![3, 4], corners: [0, 1, 2, 0, 1, 2, 3].map(corner).to_vec() },
        targets: vec![target("whole", (0..64).collect()), target("three", vec![63, 64, 129]), target("none", vec![])],
        diagonal: diagonal(&positions),
        tolerance: Tolerance::default(),
        positions,
        ..MorphMesh::default()
    }
}

#[test]
fn overlap_counts_targets_per_vertex() {
    let o = overlap(&mesh());
    assert_eq!((o.union, o.mean, o.max), (66.0 / 130.0, 67.0 / 66.0, 2));
}

#[test]
fn clips_are_summed_up() {
    let values = vec![0.0, 0.5, 0.1, 0.5, 0.1, 0.5, 0.2, 0.0];
    let mut clip = WeightClip { name: "c".into(), names: vec!["a".into(), "b".into()], fps: 24.0, values };
    let row = |clip: &WeightClip| clip_row(&clip.bind(&["a", "b", "none"]).expect("columns that name targets"));
    let found = row(&clip);
    assert_eq!((found.frames, found.changed_mean, found.changed_max), (4, 1.0, 2));
    assert_eq!((found.active_mean, found.still), (6.0 / 4.0, 1.0 / 3.0));
    clip.values.clear();
    let found = row(&clip);
    assert_eq!((found.changed_mean, found.active_mean, found.still), (0.0, 0.0, 0.0));
}

#[test]
fn the_json_keeps_its_contract() {
    let kept = Arc::new(mesh());
    let input =
        Input { name: kept.name.clone(), raw: kept.clone(), kept, packed: None, clips: vec![], origin: "test".into() };
    let info = describe(&input, &formats::measure_all(&input.kept, None).expect("packed"));
    let json = serde_json::to_value(&info).expect("serialised");
    assert_eq!((&json["schema"], &json["input"]["triangles"]), (&1.into(), &3.into()), "a quad is two triangles");
    assert!(json.get("sweep").is_none() && json.get("poses").is_none(), "with --report only");
    for (part, fields) in [
        ("/input", "vertices targets triangles diagonal"),
        ("/targets/0", "name moved max_delta moved_raw"),
        ("/blocks", "size count incidence fill"),
        (
            "/formats/0",
            "name delta_bytes index_bytes dense_f32_bytes position_error position_error_rel normal_error_deg",
        ),
    ] {
        let object = json.pointer(part).expect(part);
        fields.split(' ').for_each(|f| assert!(object.get(f).is_some(), "{part}/{f}"));
    }
    let text = text(&info);
    assert!(text.contains("whole") && text.contains("130 vertices"), "{text}");
}
