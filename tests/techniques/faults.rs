//! Planted faults, each of which the harness has to detect.

use super::table::{ROWS, can_read, for_every_update, updates, variants};
use crate::gpu::{self, hazards, on_every_device, packed, weights};
use crate::hazards::Event;
use crate::testing;
use deltamorph::DeltaFormat::{Fast, Float32, Small};
use deltamorph::internals::plan::Source;
use deltamorph::internals::plan::schedule::{Barrier, Entry};
use deltamorph::reference::{compare, evaluate};
use deltamorph::{BatchSize, DeltaFormat, UpdateDesc, UpdateMode, UpdatePath};
use deltamorph_headless::HeadlessCrowd;
use std::slice::from_mut;

#[test]
fn what_is_recorded_has_no_hazard_and_a_dropped_barrier_has_one() {
    for_every_update(&[Float32, Fast, Small], &testing::mesh(500, 20), |headless, mesh, desc| {
        let row = &ROWS[desc.path as usize];
        // Modes and slots of baselines, too; those of the library are in src/update/tests.rs.
        let descs: Vec<_> = if desc.path.is_baseline() { variants(desc).collect() } else { vec![desc] };
        for desc in descs.into_iter().filter(|_| row.records) {
            let mut crowd = gpu::crowd(headless, mesh, desc);
            let lists: Vec<_> = (0..5)
                .map(|frame| {
                    let (.., events) = gpu::recorded(&mut crowd, &[&weights(mesh, frame, 1)]);
                    // Displacement textures have no slots.
                    (events, crowd.crowd().pose(0).map_or(0, |pose| pose.slot))
                })
                .collect();
            assert_eq!(hazards(&lists), Ok(()), "{desc:?}");
            // All barriers of the fourth update, one at a time; with several passes, since otherwise there are none
            // between passes.
            for at in 0..lists[3].0.len() {
                // With two slots and one pass each, the barrier before is covered by that of the previous frame unless
                // the previous pose is drawn too; that case is in src/plan/tests.rs. Sums and textures are always in
                // use.
                let is_covered = at == 0 && !matches!(desc.path, UpdatePath::Scatter | UpdatePath::Texture);
                if is_covered || !matches!(lists[3].0[at], Event::Barrier(_)) {
                    continue;
                }
                let mut faulty = lists.clone();
                let dropped = faulty[3].0.remove(at);
                assert!(hazards(&faulty).is_err(), "{desc:?}: dropped {dropped:?}");
            }
        }
    });
}

/// Synchronization validation detects the same fault in the real command buffer.
#[test]
fn validation_sees_a_dropped_barrier() {
    for row in &ROWS {
        if let Some((dropped, format, batch)) = row.seen {
            let mut barriers = 0..;
            let is_it = |_: &Barrier| barriers.next() == Some(dropped);
            gpu::assert_validation_sees_dropped(row.path.name(), &[&[0.7; 20]], is_it, |headless| {
                let mesh = packed(headless.engine(), &testing::mesh(500, 20), format);
                let mut crowd = gpu::crowd(headless, &mesh, UpdateDesc::new(row.path, batch));
                crowd.step(&[&weights(&mesh, 0, 1)]).expect("a step");
                crowd
            });
        }
    }
}

/// Every path whose commands name slots. Blocks name them in the work list, which is not tampered with.
#[test]
fn a_swapped_slot_gives_a_wrong_pose() {
    for_every_update(&DeltaFormat::DENSE, &testing::mesh(500, 20), |headless, mesh, desc| {
        if desc.path.evaluates_in_draws() {
            return;
        }
        for desc in [2, 3].map(|slots| desc.slots(slots)) {
            let mut crowd = gpu::crowd(headless, mesh, desc);
            let mut weights = [0.5; 20];
            for target in 0..desc.slots as usize {
                crowd.step(&[&weights]).expect("a step");
                weights[target] = 1.5;
            }
            weights[5] = -1.5;
            let mut swapped = 0;
            let swap = |entries: &mut Vec<Entry>| {
                for entry in entries {
                    if let Entry::Work { work, .. } = entry
                        && let Source::Slot(source) = &mut work.source
                    {
                        std::mem::swap(source, &mut work.destination);
                        swapped += 1;
                    }
                }
            };
            // SAFETY: the slots exist and have all been written: a valid recording.
            unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&weights], swap) }.expect("a step");
            assert!(swapped > 0, "{desc:?}: nothing to swap");
            let error = compare(&crowd.read_pose(0).expect("a pose"), &evaluate(mesh, &weights));
            assert!(error.position > 1e-3, "{desc:?}: the fault went unseen: {error:?}");
        }
    });
}

#[test]
fn a_block_left_out_gives_a_wrong_pose() {
    for_every_update(&DeltaFormat::BLOCKS, &testing::mesh(500, 20), |headless, mesh, desc| {
        if desc.path != UpdatePath::Blocks {
            return;
        }
        let mut crowd = gpu::crowd(headless, mesh, desc);
        let leave_out = |entries: &mut Vec<Entry>| {
            let work = entries.iter_mut().find_map(|entry| match entry {
                Entry::Work { work, .. } => Some(work),
                Entry::Barrier(_) => None,
            });
            work.expect("a dispatch of blocks").items.end -= 1;
        };
        for weight in [0.25, 0.5, 0.75] {
            crowd.step(&[&[weight; 20]]).expect("a step");
        }
        // SAFETY: a workgroup less: a valid recording.
        unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&[1.0; 20]], leave_out) }.expect("a step");
        let error = gpu::error(&mut crowd, 0, mesh, &[1.0; 20]);
        assert!(error.position > 1e-3, "{desc:?}: the fault went unseen: {error:?}");
    });
}

#[test]
fn an_altered_delta_gives_a_wrong_pose() {
    let right = testing::mesh(500, 20);
    let mut wrong = right.clone();
    wrong.targets[13].positions[77].y += 1e-3 * wrong.diagonal;
    on_every_device(|headless, engine| {
        for format in DeltaFormat::ALL {
            let [right, wrong] = [&right, &wrong].map(|mesh| packed(engine, mesh, format));
            for desc in updates(engine, format).into_iter().filter(|desc| can_read(headless, desc)) {
                // At most as many as a draw has attributes for, on paths with few.
                let mut weights = [1.0; 20];
                if desc.path == UpdatePath::DirectAttributes {
                    weights = std::array::from_fn(|t| if t == 13 { 1.0 } else { 0.0 });
                }
                let reference = gpu::reference(&right, &desc, &weights);
                for (mesh, is_right) in [(&right, true), (&wrong, false)] {
                    let mut crowd = gpu::crowd(headless, mesh, desc);
                    crowd.step(&[&weights]).expect("a step");
                    let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
                    assert_eq!(gpu::is_kept(&error, right.layout().diagonal), is_right, "{desc:?}: {error:?}");
                }
            }
        }
    });
}

/// Updates of Godot's compatibility renderer: from base, a pass for each active target.
#[test]
fn feedback_rebuilt_at_batch_one_is_a_pass_per_active_target_from_base() {
    gpu::on_device(&gpu::one(), false, |headless, engine| {
        if engine.caps().check_path(UpdatePath::Feedback).is_err() {
            return;
        }
        let mesh = packed(engine, &testing::mesh(200, 9), Float32);
        let desc = UpdateDesc::new(UpdatePath::Feedback, BatchSize::Targets(1)).mode(UpdateMode::Rebuild);
        let mut crowd = gpu::crowd(headless, &mesh, desc);
        let mut weights = [0.5, 0.0, 1.0, -0.5, 0.0, 0.0, 0.25, 0.0, 0.0];
        for changed in [0.5, 0.75] {
            weights[0] = changed;
            let (step, entries, _) = gpu::recorded(&mut crowd, &[&weights]);
            let passes = entries.iter().filter_map(|entry| match entry {
                Entry::Work { work, .. } => Some(work),
                Entry::Barrier(_) => None,
            });
            let passes: Vec<_> = passes.collect();
            assert_eq!(step.update.stats.passes, 4, "one weight changed, four are active");
            assert_eq!(passes[0].source, Source::Base);
            assert!(passes.len() == 4 && passes.iter().all(|pass| pass.items.len() == 1));
            gpu::assert_right(&mut crowd, 0, &mesh, &weights);
        }
    });
}
