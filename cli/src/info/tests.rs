//! Tests of `info`.

use super::*;
use deltamorph::internals::diagonal;
use deltamorph::mesh::{Corner, Faces};
use deltamorph::{Tolerance, WeightClip};

/// 130 vertices in a row; one target moves 0..64 (a whole block), one moves 63, 64 and 129, one moves none.
pub fn mesh() -> KeptMesh {
    let positions: Vec<Vec3> = (0..130).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
    let target = |name: &str, vertices: Vec<u32>| KeptTarget {
        name: name.into(),
        positions: vertices.iter().map(|&v| Vec3::new(0.1, v as f32 * 0.003, -0.2)).collect(),
        normals: vertices.iter().map(|&v| Vec3::new(0.01 * v as f32, 0.2, 0.0)).collect(),
        vertices,
        streams: vec![],
    };
    let corner = |position| Corner { position, texcoord: None };
    KeptMesh {
        name: "row".into(),
        normals: vec![Vec3::Z; positions.len()],
        faces: Faces { sizes: vec![3, 4], corners: [0, 1, 2, 0, 1, 2, 3].map(corner).to_vec() },
        targets: vec![target("whole", (0..64).collect()), target("three", vec![63, 64, 129]), target("none", vec![])],
        diagonal: diagonal(&positions),
        tolerance: Tolerance::default(),
        positions,
        ..KeptMesh::default()
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
    let mut clip =
        WeightClip { name: "c".into(), names: vec!["a".into(), "b".into()], fps: 24.0, values, ..Default::default() };
    let row = |clip: &WeightClip| clip_row(&clip.bind(&["a", "b", "none"]).expect("columns that name targets"));
    let found = row(&clip);
    assert_eq!((found.frames, found.changed_mean, found.changed_max), (4, 1.0, 2));
    assert_eq!((found.active_mean, found.still), (6.0 / 4.0, 1.0 / 3.0));
    clip.values.clear();
    let found = row(&clip);
    assert_eq!((found.changed_mean, found.active_mean, found.still), (0.0, 0.0, 0.0));
}
