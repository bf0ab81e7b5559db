//! Recomputed normals, and their distance from morphed ones.

use crate::data;
use deltamorph::after::NormalsDesc;
use deltamorph::import::{csv, obj};
use deltamorph::reference::{angle_degrees, evaluate_unpacked, normals};
use deltamorph::{MorphMesh, Tolerance};
use glam::DVec3;

/// Returns the vertices at the corners of all faces.
pub fn corners(mesh: &MorphMesh) -> Vec<u32> {
    mesh.faces.corners.iter().map(|corner| corner.position).collect()
}

/// Returns the largest angle between normals, in degrees; passes each to `f`.
pub fn compare(found: &[DVec3], expected: &[f64], mut f: impl FnMut(f64)) -> f64 {
    let expected = expected.as_chunks::<3>().0.iter().map(|n| DVec3::from_array(*n));
    let angles = found.iter().zip(expected).filter(|(_, expected)| expected.length() > 0.5);
    angles.map(|(found, expected)| angle_degrees(*found, expected)).inspect(|angle| f(*angle)).fold(0.0, f64::max)
}

/// Prints the angles between sums of the targets' normals and the normals of the resulting surface, on captured clips:
/// with the normals of the files, and with normals computed on import, which are those of the surface at rest and in
/// each target.
#[test]
fn morphed_normals_against_those_of_the_surface_on_real_sets() {
    for set in ["ict_facekit", "makehuman_face", "facecap_head_glb"] {
        let Some(folder) = data::set(set) else { continue };
        let stated = obj::import_folder(&folder).expect("a folder");
        let mut computed = stated.clone();
        computed.normals = None;
        computed.targets.iter_mut().for_each(|target| target.normals = None);
        let clips = std::fs::read_dir(folder.join("weights")).expect("clips");
        let mut clips: Vec<_> = clips.map(|entry| entry.expect("an entry").path()).collect();
        clips.retain(|path| path.extension().is_some_and(|ending| ending == "csv"));
        for (source, which) in [(stated, "stated"), (computed, "computed")] {
            let mesh = source.to_mesh(Tolerance::default()).expect("a mesh");
            let corners = corners(&mesh);
            let desc = NormalsDesc::new(&corners).sizes(&mesh.faces.sizes).welds(&mesh.welds);
            let add_angles = |weights: &[f32], angles: &mut Vec<f64>| {
                let pose = evaluate_unpacked(&mesh, weights);
                let normal = |vertex: &[f64; 6]| DVec3::from_slice(&vertex[3..]);
                let morphed: Vec<DVec3> = pose.as_chunks().0.iter().map(normal).collect();
                compare(&morphed, &normals(&pose, &desc).expect("normals"), |angle| angles.push(angle));
            };
            let (mut rest, mut angles) = (vec![], vec![]);
            add_angles(&[], &mut rest);
            let names: Vec<&str> = mesh.targets.iter().map(|target| target.name.as_str()).collect();
            for clip in &clips {
                let clip = csv::read(clip, None).expect("a clip");
                let frames: Vec<Vec<f32>> = clip.bind(&names).expect("columns that name targets").frames().collect();
                frames.iter().step_by(frames.len().div_ceil(10)).for_each(|weights| add_angles(weights, &mut angles));
            }
            let [rest, angles] = [rest, angles].map(|mut angles| {
                angles.sort_by(f64::total_cmp);
                [0.5, 0.9, 0.99].map(|share| angles[((angles.len() - 1) as f64 * share) as usize])
            });
            println!("{set}, {which}: in the middle, at 90 % and at 99 % {angles:.2?}°; at rest {rest:.2?}°");
            assert!(which == "stated" || rest[2] < 0.01 && angles[0] < 1.0, "{set}: normals of another surface");
        }
    }
}
