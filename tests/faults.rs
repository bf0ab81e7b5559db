//! Planted faults: the harness has to catch each, or it proves nothing.

#[path = "common/gpu.rs"]
mod gpu;

use deltamorph::engine::MorphEngine;
use deltamorph::headless::{DeviceChoice, Headless, HeadlessCrowd, HeadlessDesc};
use deltamorph::pack::{DeltaFormat, PackedMesh};
use deltamorph::plan::commands::{Command, CommandList};
use deltamorph::plan::hazards::HazardChecker;
use deltamorph::plan::{BatchSize, Source, UpdateDesc, UpdatePath};
use deltamorph::reference::{compare, evaluate};
use deltamorph::testing;
use gpu::{on_every_device, single, update_descs, weights};

fn packed(engine: &MorphEngine, format: DeltaFormat) -> PackedMesh {
    gpu::packed(engine, &testing::mesh(500, 20), format)
}

/// The commands of `frames` updates.
fn recorded(
    headless: &Headless,
    engine: &MorphEngine,
    format: DeltaFormat,
    desc: UpdateDesc,
    frames: u32,
) -> Vec<CommandList> {
    let mesh = packed(engine, format);
    let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
    let mut lists = vec![];
    for frame in 0..frames {
        // SAFETY: nothing is changed.
        let step = unsafe { crowd.step_tampered(&[&weights(&mesh, frame, 1)], |list| lists.push(list.clone())) };
        step.expect("a step");
    }
    lists
}

fn hazards(lists: &[CommandList]) -> Result<(), Vec<deltamorph::plan::hazards::Violation>> {
    let mut checker = HazardChecker::new();
    checker.upload();
    for list in lists {
        checker.update(list);
        let destination = |command: &Command| match command {
            Command::Pass(pass) => Some(pass.destination),
            Command::Blocks(blocks) => Some(blocks.destination),
            Command::Scatter(scatter) => Some(scatter.destination),
            Command::Barrier(_) | Command::Animated(_) => None,
        };
        if let Some(slot) = list.commands.iter().filter_map(destination).next_back() {
            checker.draw(0, slot);
        }
    }
    checker.finish()
}

#[test]
fn what_the_engine_records_has_no_hazard_and_a_dropped_barrier_has_one() {
    on_every_device(|headless, engine| {
        let formats = [DeltaFormat::Float32, DeltaFormat::Fast].into_iter();
        for (format, desc) in formats.flat_map(|f| update_descs(engine, f).into_iter().map(move |d| (f, d))) {
            let lists = recorded(headless, engine, format, desc, 5);
            assert_eq!(hazards(&lists), Ok(()), "{desc:?}");
            // All barriers of the fourth update, one at a time; more than one pass, or there is none between.
            for at in 0..lists[3].commands.len() {
                // With two slots in one pass each, the barrier before is covered by that of the frame before
                // unless the previous pose is drawn too; that case is in src/plan/tests.rs.
                if !matches!(lists[3].commands[at], Command::Barrier(_)) || at == 0 {
                    continue;
                }
                let mut faulty = lists.clone();
                faulty[3].commands.remove(at);
                assert!(hazards(&faulty).is_err(), "{desc:?}: dropped {:?}", lists[3].commands[at]);
            }
        }
    });
}

/// Synchronization validation sees the same fault in the real command buffer (compute only: no layer sees
/// hazards of transform feedback).
#[test]
fn validation_sees_a_dropped_barrier_between_compute_passes() {
    let device = DeviceChoice::Name("llvmpipe".into());
    let headless = Headless::new(&HeadlessDesc { device, validation: true, limits: None })
        .expect("lavapipe; run the tests as ./with-vulkan cargo test");
    let engine = headless.engine();
    let mesh = packed(engine, DeltaFormat::Float32);
    let desc = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(4));
    let mut crowd = HeadlessCrowd::new(&headless, &mesh, &single(desc)).expect("a crowd");
    crowd.step(&[&weights(&mesh, 0, 1)]).expect("a step");
    assert_eq!(gpu::complaints(&headless), Vec::<String>::new());
    let drop_second = |list: &mut CommandList| {
        let barriers = list.commands.iter().enumerate().filter(|(_, c)| matches!(c, Command::Barrier(_)));
        let at = barriers.map(|(i, _)| i).nth(1).expect("a barrier between passes");
        list.commands.remove(at);
    };
    // SAFETY: a barrier less; the driver is software, and runs dispatches one after the other all the same.
    unsafe { crowd.step_tampered(&[&[0.7; 20]], drop_second) }.expect("a step");
    let messages = gpu::complaints(&headless);
    assert!(messages.iter().any(|m| m.contains("SYNC-HAZARD")), "{messages:?}");
}

/// Every path that names its slots in commands. Blocks name theirs in the work list, which is not tampered with.
#[test]
fn a_swapped_slot_gives_a_wrong_pose() {
    on_every_device(|headless, engine| {
        let descs =
            DeltaFormat::DENSE.into_iter().flat_map(|f| update_descs(engine, f).into_iter().map(move |d| (f, d)));
        for (format, desc) in descs.flat_map(|(f, d)| [2, 3].map(|slots| (f, UpdateDesc { slots, ..d }))) {
            let mesh = packed(engine, format);
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
            let mut weights = [0.5; 20];
            for target in 0..desc.slots as usize {
                crowd.step(&[&weights]).expect("a step");
                weights[target] = 1.5;
            }
            weights[5] = -1.5;
            let mut swapped = 0;
            let swap = |list: &mut CommandList| {
                for command in &mut list.commands {
                    if let Command::Pass(pass) = command
                        && let Source::Slot(source) = &mut pass.source
                    {
                        std::mem::swap(source, &mut pass.destination);
                        swapped += 1;
                    }
                }
            };
            // SAFETY: the slots are there, and every one of them was written: a valid recording.
            unsafe { crowd.step_tampered(&[&weights], swap) }.expect("a step");
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
                let leave_out = |list: &mut CommandList| {
                    let blocks = list.commands.iter_mut().find_map(|c| match c {
                        Command::Blocks(blocks) => Some(blocks),
                        _ => None,
                    });
                    blocks.expect("a pass over blocks").items.end -= 1;
                };
                for weight in [0.25, 0.5, 0.75] {
                    crowd.step(&[&[weight; 20]]).expect("a step");
                }
                // SAFETY: a workgroup less: a valid recording.
                unsafe { crowd.step_tampered(&[&[1.0; 20]], leave_out) }.expect("a step");
                let error = compare(&crowd.read_pose(0).expect("a pose"), &evaluate(&mesh, &[1.0; 20]));
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
            let reference = evaluate(&pack(&right), &[1.0; 20]);
            for desc in update_descs(engine, format) {
                let mut crowd = HeadlessCrowd::new(headless, &pack(&wrong), &single(desc)).expect("a crowd");
                crowd.step(&[&[1.0; 20]]).expect("a step");
                let error = compare(&crowd.read_pose(0).expect("a pose"), &reference);
                assert!(!gpu::is_kept(&error, right.diagonal), "{desc:?}: the fault went unseen");
            }
        }
    });
}
