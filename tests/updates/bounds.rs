//! Bounds from weights contain the poses of every path, and those of real sets.

use crate::{data, gpu};
use deltamorph::import::{csv, obj};
use deltamorph::reference::evaluate;
use deltamorph::{CrowdDesc, DeltaFormat, PackDesc, PackedMesh, Tolerance, UpdateDesc, WeightBounds};
use deltamorph_head::{HeadDesc, head};
use deltamorph_headless::HeadlessCrowd;
use std::time::Instant;

/// Returns the least and greatest coordinates of a pose of six numbers per vertex.
fn extent<T: Copy + PartialOrd>(pose: &[T]) -> [T; 6] {
    let first = [pose[0], pose[1], pose[2], pose[0], pose[1], pose[2]];
    pose.chunks_exact(6).fold(first, |mut all, vertex| {
        for axis in 0..3 {
            all[axis] = if vertex[axis] < all[axis] { vertex[axis] } else { all[axis] };
            all[3 + axis] = if vertex[axis] > all[3 + axis] { vertex[axis] } else { all[3 + axis] };
        }
        all
    })
}

#[test]
fn bounds_from_weights_hold_poses_of_the_device() {
    gpu::on_every_device(|headless, engine| {
        let mesh = head(&HeadDesc::default().vertices(900).targets(37).sparsity(0.05).seed(3));
        let mesh = mesh.to_mesh(Tolerance::default()).expect("a mesh");
        for (format, update) in gpu::updates(headless) {
            let packed = gpu::packed(engine, &mesh, format);
            let mut crowd = HeadlessCrowd::new(headless, &packed, &CrowdDesc::new(update)).expect("a crowd");
            let from_weights = WeightBounds::new(&packed, &update).expect("a grid");
            let mut tall = 0;
            for frame in 0..12 {
                let what = format!("{} {format:?} {update:?}, frame {frame}", headless.caps().name);
                let mut weights: Vec<f32> = gpu::weights(&packed, frame, 5);
                // A third of the targets at a time.
                let kept = frame as usize % 3;
                weights.iter_mut().enumerate().for_each(|(t, w)| *w = if t % 3 == kept { *w / 2.0 } else { 0.3 });
                let step = crowd.step(&[&weights]).expect(&what);
                let exact = extent(&crowd.read_pose(0).expect("a pose"));
                let held = from_weights.of(&weights, step.update.stats.bound);
                let held = [held.min, held.max].concat();
                let keeps = |axis: usize| held[axis] <= exact[axis] && exact[3 + axis] <= held[3 + axis];
                assert!((0..3).all(keeps), "{what}: {held:?} of {exact:?}");
                tall += usize::from(held[4] - held[1] < 1.5 * (exact[4] - exact[1]));
            }
            assert!(tall >= 8, "{format:?} {update:?}: {tall} frames are held closely");
        }
    });
}

/// Prints the sizes of bounds from weights relative to the least bounds, and their costs, on captured clips.
#[test]
fn bounds_from_weights_hold_on_real_sets() {
    for set in ["ict_facekit", "makehuman_face", "facecap_head_glb"] {
        let Some(folder) = data::set(set) else { continue };
        let mesh = obj::import_folder(&folder).expect("a folder").to_mesh(Tolerance::default()).expect("a mesh");
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).expect("a mesh that fits");
        let clips = std::fs::read_dir(folder.join("weights")).expect("clips");
        let mut clips: Vec<_> = clips.map(|entry| entry.expect("an entry").path()).collect();
        clips.retain(|path| path.extension().is_some_and(|ending| ending == "csv"));
        clips.sort();
        let clip = csv::read(clips.first().expect("a clip"), None).expect("a clip");
        let names: Vec<&str> = mesh.targets.iter().map(|target| target.name.as_str()).collect();
        let frames: Vec<Vec<f32>> = clip.bind(&names).expect("columns that name targets").frames().collect();
        let bounds = WeightBounds::new(&packed, &UpdateDesc::blocks()).expect("no grid");
        let (mut worst, mut least_time): (f64, f64) = (0.0, f64::INFINITY);
        for weights in frames.iter().step_by(frames.len().div_ceil(12)) {
            let start = Instant::now();
            let found = bounds.of(weights, 0.0);
            least_time = least_time.min(start.elapsed().as_secs_f64());
            let exact = extent(&evaluate(&packed, weights));
            for axis in 0..3 {
                let (low, high) = (f64::from(found.min[axis]), f64::from(found.max[axis]));
                assert!(low <= exact[axis] && exact[3 + axis] <= high, "{set}: {found:?} of {exact:?}");
                worst = worst.max((high - low) / (exact[3 + axis] - exact[axis]) - 1.0);
            }
        }
        println!("{set}: at most {:.1} % larger than the least, {:.1} µs", 100.0 * worst, 1e6 * least_time);
    }
}
