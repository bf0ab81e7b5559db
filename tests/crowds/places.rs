//! Changes of a running crowd: instances are hidden and shown, removed and added; tiles of any width; several
//! descriptor ranges.

use crate::prelude::*;
use deltamorph_headless::Step;

const TARGETS: usize = 12;

fn packed(engine: &MorphEngine, format: DeltaFormat) -> PackedMesh {
    PackedMesh::pack(&testing::mesh(700, TARGETS), &engine.pack_desc(format)).expect("a mesh that fits")
}

/// Returns the weights of an instance in a frame: about half of them change between frames.
fn weights(head: u32, frame: u32) -> Vec<f32> {
    let weight = |t: u32| ((head * 7 + t * 13 + (frame + t % 2) / 2 * 5) % 17) as f32 / 8.0 - 0.5;
    (0..TARGETS as u32).map(weight).collect()
}

/// Asserts that the pose of `instance` is that of `weights`.
fn assert_pose(crowd: &mut HeadlessCrowd<'_>, mesh: &PackedMesh, desc: &UpdateDesc, instance: u32, weights: &[f32]) {
    let error = gpu::error(crowd, instance, mesh, weights);
    let bound = 1e-5 * f64::from(mesh.layout().diagonal);
    assert!(error.within(bound, 0.02), "{desc:?}, instance {instance}: {error:?}");
}

fn crowd<'a>(headless: &'a Headless, mesh: &PackedMesh, update: UpdateDesc, instances: u32) -> HeadlessCrowd<'a> {
    HeadlessCrowd::new(headless, mesh, &CrowdDesc { instances, frames_in_flight: 1, ..CrowdDesc::new(update) })
        .expect("a crowd")
}

/// 13 instances: tiles of 8, 4 and 1, and others if only some change.
#[test]
fn heads_come_and_go() {
    on_every_device(|headless, engine| {
        for (format, desc) in gpu::updates(headless) {
            // The weights go up to 1.5.
            let desc = UpdateDesc { weight_max: Some(4.0), ..desc };
            let mesh = packed(engine, format);
            let mut crowd = crowd(headless, &mesh, desc, 13);
            let mut asked: Vec<Vec<f32>> = (0..13).map(|i| weights(i, 0)).collect();
            for frame in 0..6u32 {
                // Every instance moves in even frames, every third in odd ones; 3 is hidden in frames 2 and 3.
                for head in (0..13).filter(|h| frame % 2 == 0 || h % 3 == 0) {
                    asked[head as usize] = weights(head, frame);
                    crowd.set_weights(head, &asked[head as usize]).expect("weights that fit");
                }
                let was = (frame == 2).then(|| crowd.read_pose(3).expect("a pose"));
                crowd.set_hidden(3, frame == 2 || frame == 3).expect("a head");
                crowd.step(&[]).expect("a step");
                for head in (0..13).filter(|&h| h != 3 || !(2..4).contains(&frame)) {
                    assert_pose(&mut crowd, &mesh, &desc, head, &asked[head as usize]);
                }
                if let Some(was) = was {
                    assert_eq!(crowd.read_pose(3).expect("a pose"), was, "{desc:?}: hidden, it keeps its pose");
                }
                if frame == 4 {
                    let (pose, previous) = (crowd.crowd().pose(3), crowd.crowd().previous_pose(3));
                    assert_eq!(previous.expect("a pose"), Some(pose.expect("a pose")), "{desc:?}: shown again");
                }
            }
            crowd.remove(5).expect("a head");
            crowd.remove(11).expect("a head");
            testing::says(crowd.set_weights(5, &asked[5]), &["instance 5 was removed"]);
            assert!(crowd.crowd().pose(5).is_err() && crowd.remove(5).is_err());
            crowd.step(&[]).expect("a step");
            assert_eq!(crowd.add().expect("a free place"), 5);
            assert!(crowd.crowd().pose(5).is_err(), "no pose before the next update");
            crowd.step(&[]).expect("a step");
            assert_pose(&mut crowd, &mesh, &desc, 5, &[0.0; TARGETS]);
            assert_eq!(crowd.add().expect("a free place"), 11);
            testing::says(crowd.add(), &["capacity of 13 instances"]);
            crowd.set_weights(5, &asked[5]).expect("weights that fit");
            crowd.set_weights(11, &asked[11]).expect("weights that fit");
            crowd.step(&[]).expect("a step");
            (0..13).for_each(|head| assert_pose(&mut crowd, &mesh, &desc, head, &asked[head as usize]));
        }
    });
}

/// Descriptors that cover only a few instances: tiles stay within them.
#[test]
fn a_crowd_in_several_descriptor_ranges() {
    // Poses of 704 vertices: seven instances of two slots each.
    let limits = gpu::baseline(|caps| caps.max_storage_range = 704 * 24 * 15);
    for (driver, limits) in gpu::with_and_without_texels(&limits) {
        let wide = limits.int64 && driver == "llvmpipe";
        gpu::on_device_within(&driver, Some(limits), |headless, engine| {
            let texels = wide && headless.caps().tuning.texels;
            assert_eq!(headless.caps().takes_texels(DeltaFormat::Fast), texels, "{driver}");
            for desc in [UpdateDesc::blocks()].into_iter().chain(gpu::fixed()) {
                let mesh = packed(engine, DeltaFormat::Fast);
                let mut crowd = crowd(headless, &mesh, desc, 19);
                for frame in 0..3 {
                    for head in 0..19 {
                        crowd.set_weights(head, &weights(head, frame)).expect("weights that fit");
                    }
                    crowd.step(&[]).expect("a step");
                    (0..19).for_each(|head| assert_pose(&mut crowd, &mesh, &desc, head, &weights(head, frame)));
                }
            }
        });
    }
}

/// Crowds of one mesh in one submission, and the draws after them.
#[test]
fn crowds_side_by_side_do_what_one_crowd_does() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
            let mesh = gpu::packed(engine, &testing::mesh(200, 11), format);
            for update in update_descs(engine, format) {
                let desc = |instances| CrowdDesc { instances, frames_in_flight: 1, ..CrowdDesc::new(update) };
                let mut whole = HeadlessCrowd::new(headless, &mesh, &desc(4)).expect("a crowd");
                let half = HeadlessCrowd::new(headless, &mesh, &desc(2)).expect("a crowd");
                let mut halves = [half.another(&desc(2)).expect("another"), half];
                for frame in 0..4 {
                    let heads: Vec<Vec<f32>> = (0..4).map(|i| gpu::weights(&mesh, frame * i, i)).collect();
                    let heads: Vec<&[f32]> = heads.iter().map(Vec::as_slice).collect();
                    let one = whole.step(&heads).expect("a step");
                    let two = HeadlessCrowd::step_together(&mut halves, &heads, Draws { copies: 3, passes: 2 })
                        .expect("a step");
                    // Passes and bytes may differ, since a crowd shares work.
                    let work = |step: &Step| (step.update.stats.coefficients, step.update.stats.dirty_blocks);
                    assert_eq!(work(&one), work(&two), "{update:?} frame {frame}");
                    assert_eq!((one.draw_ms, one.gpu_ms.is_some()), (None, two.gpu_ms.is_some()));
                    assert_eq!(two.draw_ms.is_some(), two.gpu_ms.is_some(), "a device with timestamps times draws too");
                    for i in 0..4 {
                        let poses = [
                            whole.read_pose(i).expect("a pose"),
                            halves[i as usize / 2].read_pose(i % 2).expect("a pose"),
                        ];
                        let reference = gpu::reference(&mesh, &update, heads[i as usize]);
                        for pose in poses {
                            let error = compare(&pose, &reference);
                            assert!(error.within(1.2e-4, 0.01), "{update:?} head {i} frame {frame}: {error:?}");
                        }
                    }
                }
            }
        }
    });
}
