//! What a host is told of poses that it does not read: bounds from weights, and which vertices an update changed.

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

/// Calls `test` with a crowd of one head on each device, in each format and on each path, and what it is.
fn on_every_path(test: impl Fn(&str, &PackedMesh, UpdateDesc, &mut HeadlessCrowd<'_>)) {
    gpu::on_every_device(|headless, engine| {
        let mesh = head(&HeadDesc { vertices: 900, targets: 37, sparsity: 0.05, seed: 3 });
        let mesh = mesh.kept(Tolerance::default()).expect("a mesh");
        for (format, update) in gpu::updates(headless) {
            let packed = gpu::packed(engine, &mesh, format);
            let mut crowd = HeadlessCrowd::new(headless, &packed, &CrowdDesc::new(update)).expect("a crowd");
            test(&format!("{} {format:?} {update:?}", headless.caps().name), &packed, update, &mut crowd);
        }
    });
}

#[test]
fn bounds_from_weights_hold_poses_of_the_device() {
    on_every_path(|what, packed, update, crowd| {
        let from_weights = WeightBounds::new(packed, &update).expect("a grid");
        let mut tall = 0;
        for frame in 0..12 {
            let what = format!("{what}, frame {frame}");
            let mut weights: Vec<f32> = gpu::weights(packed, frame, 5);
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
        assert!(tall >= 8, "{what}: {tall} frames are held closely");
    });
}

/// Vertices outside the ranges stay as they are, bit for bit; an update to the same weights changes none.
#[test]
fn what_an_update_changed_is_told() {
    on_every_path(|what, packed, _, crowd| {
        let mut weights = vec![0.0; packed.layout().targets.len()];
        let mut before = vec![f32::NAN; 6 * packed.layout().vertex_count];
        let mut told = 0;
        for frame in 0..8 {
            let what = format!("{what}, frame {frame}");
            weights[5 * frame % 37] = 0.1 + 0.1 * frame as f32;
            for is_new in [true, false] {
                crowd.step(&[&weights]).expect(&what);
                let (ranges, pose) = (crowd.changed(0), crowd.read_pose(0).expect("a pose"));
                assert!(ranges.windows(2).all(|two| two[0].end < two[1].start), "{what}: {ranges:?}");
                assert!(is_new || ranges.is_empty(), "{what}: {ranges:?} with the same weights");
                for packed_vertex in 0..packed.layout().padded_vertices() {
                    let Some(user) = packed.layout().user_vertex(packed_vertex) else { continue };
                    let is_told = ranges.iter().any(|range| range.contains(&(packed_vertex as u32)));
                    let place = 6 * user..6 * user + 6;
                    assert!(is_told || before[place.clone()] == pose[place], "{what}: vertex {packed_vertex}");
                    told += usize::from(is_told);
                }
                before = pose;
            }
        }
        let all = 8 * packed.layout().vertex_count;
        assert!((1..=all).contains(&told), "{what}: {told} of {all}");
        assert!(!packed.layout().format.is_blocks() || told < all / 2, "{what}: {told} of {all}");
    });
}
