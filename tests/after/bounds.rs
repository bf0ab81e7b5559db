//! Bounds: those of the device are the least there are, and those from weights hold; only what changed is done
//! again.

use crate::data;
use crate::gpu;
use crate::offscreen::Offscreen;
use crate::written::Written;
use deltamorph::after::{BoundsTarget, WeightBounds};
use deltamorph::ash::vk;
use deltamorph::import::{csv, obj};
use deltamorph::reference::evaluate;
use deltamorph::{Consumers, CrowdDesc, DeltaFormat, PackDesc, PackedMesh, Tolerance, UpdateDesc};
use deltamorph_head::{HeadDesc, head};
use deltamorph_headless::HeadlessCrowd;
use std::time::Instant;

/// Least and greatest coordinates of a pose of six numbers a vertex.
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
fn bounds_on_the_device_are_those_of_the_pose() {
    gpu::on_every_device(|headless, engine| {
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        // As many vertices as fill no part.
        let mesh = head(&HeadDesc::default().vertices(900).targets(37).sparsity(0.05).seed(3));
        let mesh = mesh.to_mesh(Tolerance::default()).expect("a mesh");
        for (format, update) in gpu::updates(headless) {
            let packed = gpu::packed(engine, &mesh, format);
            let consumers = Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES;
            let desc = CrowdDesc::new(update).instances(2).consumers(consumers);
            let mut crowd = HeadlessCrowd::new(headless, &packed, &desc).expect("a crowd");
            // Two vertices of three numbers each.
            let written = Written::new(headless, &host, 2, (308, 12, None));
            let target = BoundsTarget::new(written.buffer).offset(308);
            // SAFETY: the buffer is large enough, and lives as long as the crowd; nothing is running.
            unsafe { crowd.set_bounds_target(1, Some(&target)) }.expect("a target");
            let from_weights = WeightBounds::new(&packed, &update).expect("a grid");
            let mut tall = 0;
            for frame in 0..12 {
                let what = format!("{} {format:?} {update:?}, frame {frame}", headless.caps().name);
                let still = [4, 5].contains(&frame);
                let mut weights: Vec<f32> = gpu::weights(&packed, if still { 3 } else { frame }, 5);
                // One target at a time, so that most parts keep their bounds.
                let kept = frame as usize % 3;
                weights.iter_mut().enumerate().for_each(|(t, w)| *w = if t % 3 == kept { *w / 2.0 } else { 0.3 });
                if still {
                    weights = gpu::weights(&packed, 3, 5);
                    weights.iter_mut().enumerate().for_each(|(t, w)| *w = if t % 3 == 0 { *w / 2.0 } else { 0.3 });
                }
                let step = crowd.step(&[&weights, &weights]).expect(&what);
                let found: Vec<f32> =
                    written.take(headless).into_iter().flatten().flatten().map(f32::from_bits).collect();
                if still {
                    assert!(found.is_empty(), "{what}: nothing changed");
                    continue;
                }
                let exact = extent(&crowd.read_pose(1).expect("a pose"));
                assert_eq!(found, exact, "{what}");
                let held = from_weights.of(&weights, step.update.stats.bound);
                let held = [held.min, held.max].concat();
                let keeps = |axis: usize| held[axis] <= exact[axis] && exact[3 + axis] <= held[3 + axis];
                assert!((0..3).all(keeps), "{what}: {held:?} of {exact:?}");
                tall += usize::from(held[4] - held[1] < 1.5 * (exact[4] - exact[1]));
            }
            assert!(tall >= 8, "{format:?} {update:?}: {tall} frames are held closely");
            assert!(
                // SAFETY: it is refused.
                unsafe { crowd.set_bounds_target(1, Some(&target.offset(6))) }
                    .expect_err("a refusal")
                    .to_string()
                    .contains("multiple of 4")
            );
        }
    });
}

/// Prints how much larger bounds from weights are than the least, and what they cost, on captured clips.
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
