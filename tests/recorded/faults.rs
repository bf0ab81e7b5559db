//! Planted faults: the harness has to catch each, or it proves nothing.

use crate::gpu::{self, hazards, on_every_device, single, update_descs, weights};
use deltamorph::internals::plan::Source;
use deltamorph::internals::plan::hazards::Event;
use deltamorph::internals::plan::schedule::Entry;
use deltamorph::reference::{compare, evaluate};
use deltamorph::{BatchSize, DeltaFormat, MorphEngine, PackedMesh, UpdateDesc, UpdatePath, testing};
use deltamorph_headless::{Headless, HeadlessCrowd};
use std::slice::from_mut;

fn packed(engine: &MorphEngine, format: DeltaFormat) -> PackedMesh {
    gpu::packed(engine, &testing::mesh(500, 20), format)
}

/// What `frames` updates record, and the slot that is drawn after each.
fn recorded(
    headless: &Headless,
    engine: &MorphEngine,
    format: DeltaFormat,
    desc: UpdateDesc,
    frames: u32,
) -> Vec<(Vec<Event>, u32)> {
    let mesh = packed(engine, format);
    let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
    let step = |frame| {
        // SAFETY: nothing is changed.
        let step = unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&weights(&mesh, frame, 1)], |_| {}) };
        (step.expect("a step").1, crowd.crowd().pose(0).expect("a pose").slot)
    };
    (0..frames).map(step).collect()
}

#[test]
fn what_the_engine_records_has_no_hazard_and_a_dropped_barrier_has_one() {
    on_every_device(|headless, engine| {
        let formats = [DeltaFormat::Float32, DeltaFormat::Fast].into_iter();
        for (format, desc) in formats.flat_map(|f| update_descs(engine, f).into_iter().map(move |d| (f, d))) {
            let lists = recorded(headless, engine, format, desc, 5);
            assert_eq!(hazards(&lists), Ok(()), "{desc:?}");
            // All barriers of the fourth update, one at a time; more than one pass, or there is none between.
            for at in 0..lists[3].0.len() {
                // With two slots in one pass each, the barrier before is covered by that of the frame before
                // unless the previous pose is drawn too; that case is in src/plan/tests.rs.
                if !matches!(lists[3].0[at], Event::Barrier(_)) || at == 0 {
                    continue;
                }
                let mut faulty = lists.clone();
                let dropped = faulty[3].0.remove(at);
                assert!(hazards(&faulty).is_err(), "{desc:?}: dropped {dropped:?}");
            }
        }
    });
}

/// Synchronization validation sees the same fault in the real command buffer (compute only: no layer sees
/// hazards of transform feedback).
#[test]
fn validation_sees_a_dropped_barrier_between_compute_passes() {
    let desc = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(4));
    gpu::assert_validation_sees_dropped(1, desc, DeltaFormat::Float32);
}

/// Every path that names its slots in commands. Blocks name theirs in the work list, which is not tampered with.
#[test]
fn a_swapped_slot_gives_a_wrong_pose() {
    on_every_device(|headless, engine| {
        let descs =
            DeltaFormat::DENSE.into_iter().flat_map(|f| update_descs(engine, f).into_iter().map(move |d| (f, d)));
        for (format, desc) in descs.flat_map(|(f, d)| [2, 3].map(|slots| (f, d.slots(slots)))) {
            let mesh = packed(engine, format);
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
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
            // SAFETY: the slots are there, and every one of them was written: a valid recording.
            unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&weights], swap) }.expect("a step");
            assert!(swapped > 0, "{format:?} {desc:?}: nothing to swap");
            let error = compare(&crowd.read_pose(0).expect("a pose"), &evaluate(&mesh, &weights));
            assert!(error.position > 1e-3, "{format:?} {desc:?}: the fault went unseen: {error:?}");
        }
    });
}

#[test]
fn a_block_left_out_gives_a_wrong_pose() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::BLOCKS {
            for desc in update_descs(engine, format) {
                let mesh = packed(engine, format);
                let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
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
                unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&[1.0; 20]], leave_out) }
                    .expect("a step");
                let reference = gpu::reference(&mesh, &desc, &[1.0; 20]);
                let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
                assert!(error.position > 1e-3, "{desc:?}: the fault went unseen: {error:?}");
            }
        }
    });
}

#[test]
fn an_altered_delta_gives_a_wrong_pose() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::ALL {
            let right = testing::mesh(500, 20);
            let mut wrong = right.clone();
            wrong.targets[13].positions[77].y += 1e-3 * wrong.diagonal;
            let pack = |mesh| gpu::packed(engine, mesh, format);
            for desc in update_descs(engine, format) {
                let reference = gpu::reference(&pack(&right), &desc, &[1.0; 20]);
                for (mesh, is_right) in [(&right, true), (&wrong, false)] {
                    let mut crowd = HeadlessCrowd::new(headless, &pack(mesh), &single(desc)).expect("a crowd");
                    crowd.step(&[&[1.0; 20]]).expect("a step");
                    let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
                    assert_eq!(gpu::is_kept(&error, right.diagonal), is_right, "{desc:?}: {error:?}");
                }
            }
        }
    });
}
