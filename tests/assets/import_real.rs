//! Import of real heads, against meta.json and README.txt of the sets.

use crate::prelude::*;
use deltamorph::import::csv;
use deltamorph::import::obj::import_folder;
use deltamorph::reference::evaluate_unpacked;
use glam::DVec3;
use std::path::{Path, PathBuf};

fn kept(mesh: &KeptMesh) -> f64 {
    let moved: usize = mesh.targets.iter().map(|t| t.vertices.len()).sum();
    moved as f64 / (mesh.targets.len() * mesh.vertex_count()) as f64
}

/// Returns the largest error of the default tolerance over a clip, as a fraction of the diagonal.
fn error_over_clip(source: &Mesh, folder: &Path, clip: &str) -> f64 {
    let clip = csv::read(&folder.join("weights").join(clip), None).unwrap();
    assert_eq!(clip.fps, if clip.name.contains("24fps") { 24.0 } else { 30.0 });
    let names: Vec<&str> = source.targets.iter().map(|t| t.name.as_str()).collect();
    let (raw, mesh) = (source.kept(Tolerance::ZERO).unwrap(), source.kept(Tolerance::default()).unwrap());
    let frames: Vec<_> = clip.bind(&names).unwrap().frames().collect();
    let step = (frames.len() / 60).max(1);
    let errors = frames.iter().step_by(step).map(|w| {
        let [a, b] = [&raw, &mesh].map(|mesh| evaluate_unpacked(mesh, w));
        let positions =
            a.chunks_exact(6).zip(b.chunks_exact(6)).map(|(a, b)| (DVec3::from_slice(a), DVec3::from_slice(b)));
        positions.map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
    });
    errors.fold(0.0, f64::max) / f64::from(mesh.diagonal)
}

/// A data set, if it is there: its folder, what it states, and the mesh.
fn imported(set: &str) -> Option<(PathBuf, Mesh, KeptMesh)> {
    let folder = data::set(set)?;
    let source = import_folder(&folder).unwrap();
    let mesh = source.kept(Tolerance::default()).unwrap();
    Some((folder, source, mesh))
}

#[test]
fn ict_facekit() {
    let Some((folder, source, mesh)) = imported("ict_facekit") else { return };
    assert_eq!((mesh.vertex_count(), mesh.targets.len()), (26_719, 57));
    assert_eq!((mesh.texcoords.len(), mesh.faces.sizes.len()), (28_911, 26_384));
    assert!((f64::from(mesh.diagonal) - 47.52023).abs() < 1e-3);
    let stated: usize = source.targets.iter().map(|t| t.positions.len()).sum();
    let stated = stated as f64 / (57.0 * 26_719.0);
    assert!((stated - 0.4371).abs() < 1e-3, "{stated}");
    // 0.302 by positions alone; normals add little.
    assert!((0.29..0.31).contains(&kept(&mesh)), "{}", kept(&mesh));
    for clip in ["facecap_30fps.csv", "facegood_2_01_mapped_30fps.csv"] {
        let error = error_over_clip(&source, &folder, clip);
        assert!(error <= 5e-5, "{clip}: {error}");
    }
}

#[test]
fn facecap_head() {
    let Some((folder, source, mesh)) = imported("facecap_head_glb") else { return };
    assert_eq!((mesh.vertex_count(), mesh.targets.len(), source.notes.len()), (2694, 52, 0));
    assert!(mesh.targets[mesh.target_index("tongueOut").unwrap()].vertices.is_empty());
    // No delta of this set is noise: all are kept.
    assert_eq!(mesh.targets, source.kept(Tolerance::ZERO).unwrap().targets);
    assert!((0.179..0.19).contains(&kept(&mesh)), "{}", kept(&mesh));
    assert_eq!(error_over_clip(&source, &folder, "facecap_30fps.csv"), 0.0);
}

#[test]
fn morph_stress_test() {
    let Some((folder, source, mesh)) = imported("morph_stress_test") else { return };
    assert_eq!((mesh.vertex_count(), mesh.targets.len()), (1504, 8));
    // 6.25% are moved; the normals around them turn, and rounding elsewhere is dropped.
    assert!((0.0625..0.08).contains(&kept(&mesh)), "{}", kept(&mesh));
    assert!(error_over_clip(&source, &folder, "TheWave_24fps.csv") <= 5e-5);
}
