//! Bounds from weights contain the poses of every path, and those of real sets.

use crate::prelude::*;
use deltamorph::WeightBounds;

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
        let mesh = head(&HeadDesc { vertices: 900, targets: 37, sparsity: 0.05, seed: 3 });
        let mesh = mesh.kept(Tolerance::default()).expect("a mesh");
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
