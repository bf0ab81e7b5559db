//! Updates on a queue without graphics, with semaphores between them and the draws, which the hazard checker follows.
//! CPU drivers have one queue family: here it is treated as one without graphics.

use crate::gpu::{baseline, caps, limited, on_device_within, recorded, weights};
use crate::hazards::{accesses, trace};
use crate::prelude::*;
use deltamorph::internals::plan::steps::Stage;

const FRAMES: u32 = 6;
const INSTANCES: u32 = 2;

/// Runs `test` on every driver, unchanged and clamped, with queues limited to `flags`.
fn on_queues_with(flags: vk::QueueFlags, test: impl Fn(&Headless, &MorphEngine)) {
    for driver in drivers() {
        for limits in [caps(&driver), baseline(|_| ())] {
            on_device_within(&driver, Some(limited(limits, |caps| caps.queue_families = vec![flags])), &test);
        }
    }
}

/// Asserts that every barrier names only stages of compute-only queues.
fn assert_no_graphics(events: &[Event], what: &str) {
    let allowed = [Stage::Transfer, Stage::Compute, Stage::Indirect].iter().fold(0, |all, stage| all | *stage as u32);
    for event in events {
        if let Event::Barrier(barrier) = event {
            assert_eq!((barrier.before.stages | barrier.after.stages) & !allowed, 0, "{what}: {barrier:?}");
        }
    }
}

/// The recording of a frame, and the slot of each instance that its draw reads.
type Frame = (Vec<Event>, Vec<u32>);

fn uploaded(headless: &Headless, engine: &MorphEngine, format: DeltaFormat) -> (PackedMesh, GpuMesh) {
    let mesh = gpu::packed(engine, &testing::mesh(300, 11), format);
    let uploaded = gpu::upload(headless, engine, &mesh);
    (mesh, uploaded)
}

/// Returns whether the hazard checker finds hazards in these frames, if a draw runs concurrently with the next update
/// and one semaphore, from update to draw or from draw to update, is left out. Draws read the pose, and `previous`
/// slots before it.
fn has_hazards(frames: &[Frame], slots: u32, previous: u32, left_out: Option<(usize, bool)>) -> bool {
    let mut checker = HazardChecker::default();
    checker.upload(asset_uploaded());
    let draw = |checker: &mut HazardChecker, n: usize| {
        for (i, slot) in (0..).zip(&frames[n].1) {
            (0..=previous.min(n as u32)).for_each(|older| checker.draw(0, i, (slot + slots - older) % slots));
        }
    };
    for (n, (events, _)) in frames.iter().enumerate() {
        checker.update(events);
        // This update's signal comes too late for the draw of the frame before.
        n.checked_sub(1).into_iter().for_each(|before| draw(&mut checker, before));
        if left_out != Some((n, false)) {
            checker.semaphore(&[Stage::VertexInput, Stage::VertexShader]);
        }
        if n > 0 && left_out != Some((n - 1, true)) {
            checker.semaphore(&[Stage::Compute]);
        }
    }
    draw(&mut checker, frames.len() - 1);
    checker.finish().is_err()
}

#[test]
fn updates_run_on_a_queue_without_graphics() {
    on_queues_with(vk::QueueFlags::COMPUTE | vk::QueueFlags::TRANSFER, |headless, engine| {
        for (format, update) in gpu::updates(headless).into_iter().filter(|(_, u)| u.path != UpdatePath::Feedback) {
            let mesh = gpu::packed(engine, &testing::mesh(300, 11), format);
            for slots in 2..if format == DeltaFormat::Fast { 4 } else { 3 } {
                let what = format!("{format:?} {update:?}, {slots} slots");
                // The consumers are those of any crowd, but on the other queue.
                let desc = CrowdDesc::new(UpdateDesc { slots, ..update });
                let desc = CrowdDesc { instances: INSTANCES, queue_family: Some(0), ..desc };
                let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
                let frames: Vec<Frame> = (0..FRAMES)
                    .map(|frame| {
                        let asked = [0, 1].map(|i| weights(&mesh, 2 * frame, i).iter().map(|w| w / 4.0).collect());
                        let (.., events) = recorded(&mut crowd, &asked.each_ref().map(Vec::as_slice));
                        assert_no_graphics(&events, &what);
                        (0..INSTANCES).for_each(|i| gpu::assert_right(&mut crowd, i, &mesh, &asked[i as usize]));
                        (events, (0..INSTANCES).map(|i| crowd.crowd().pose(i).expect("a pose").slot).collect())
                    })
                    .collect();
                // The documented semaphores are sufficient, and necessary: with previous poses, three slots.
                for previous in [0, 1] {
                    let found = has_hazards(&frames, slots, previous, None);
                    assert_eq!(found, slots < 2 + previous, "{what}, {previous} previous poses");
                }
                let previous = slots - 2;
                for n in 0..frames.len() {
                    let found = has_hazards(&frames, slots, previous, Some((n, false)));
                    assert!(found, "{what}: without the semaphore from update {n} to its draw");
                }
                for n in previous as usize..frames.len() - 2 {
                    let found = has_hazards(&frames, slots, previous, Some((n, true)));
                    assert!(found, "{what}: without the semaphore from draw {n} to the update of two frames later");
                }
            }
        }
    });
}

/// Commands for such a queue name none of its missing stages: post-morph passes, and animated crowds.
#[test]
fn what_follows_and_what_is_animated_names_no_graphics() {
    on_queues_with(vk::QueueFlags::COMPUTE | vk::QueueFlags::TRANSFER, |headless, engine| {
        let host = Buffers::new(headless);
        let (mesh, uploaded) = uploaded(headless, engine, DeltaFormat::Fast);
        let desc = CrowdDesc { queue_family: Some(0), ..CrowdDesc::new(gpu::fixed()[1]) };
        let clips = [gpu::clip(&mesh, 30.0, (0..44).map(|i| (i % 5) as f32 / 8.0).collect())];
        let animation = AnimationDesc::new(&clips);
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
        let made = headless.run(|cmd| unsafe { engine.create_animated_crowd(cmd, &uploaded, &desc, &animation) });
        let (mut animated, mut crowd) =
            (made.expect("a crowd"), engine.create_crowd(&uploaded, &desc).expect("a crowd"));
        animated.play(0, &Playback::new(0)).expect("a clip");
        let words = host.shared(mesh.layout().vertex_count * 12);
        let streams = [OutputStream::new(Semantic::Position, words.buffer)];
        // SAFETY: the buffer is large enough, and outlives the crowd; nothing is running.
        unsafe { engine.set_output_target(&mut crowd, 0, Some(&OutputTarget::new(&streams))) }.expect("a target");
        for frame in 0..4 {
            animated.set_time(f64::from(frame) / 30.0).expect("a time");
            crowd.set_weights(0, &weights(&mesh, frame, 1)).expect("weights");
            let mut list = vec![];
            let recorded = headless.run(|cmd| {
                let keep = |entries: &mut Vec<Entry>| list.clone_from(entries);
                // SAFETY: as above; nothing is changed.
                unsafe { engine.record_tampered(cmd, &mut [&mut crowd, &mut animated], keep) }
            });
            recorded.expect("updates");
            let events = trace(&list, |number, works| match number {
                0 => accesses(&crowd, works),
                _ => accesses(&animated, works),
            });
            assert!(events.len() > 4);
            assert_no_graphics(&events, "both kinds of crowds");
            // This queue has no readers: no barrier follows the last step.
            assert!(matches!(events.last(), Some(Event::Step { .. })), "{events:?}");
        }
    });
}

#[test]
fn queues_that_cannot_run_updates_are_refused() {
    let refuse = |flags: vk::QueueFlags, named: &[u32], queue: u32, path: UpdatePath, words: &str| {
        on_queues_with(flags, |headless, _| {
            let (instance, physical, device) = headless.handles();
            let caps = headless.caps().clone();
            let desc = DeviceDesc { queue_families: named, ..DeviceDesc::new(instance, physical, device) };
            let feedback = caps.transform_feedback.is_some();
            let desc = DeviceDesc { caps: Some(caps), transform_feedback_enabled: feedback, ..desc };
            // SAFETY: the handles belong together, and outlive the engine.
            let made = unsafe { MorphEngine::new(&desc) };
            let refused = made.and_then(|engine| {
                if engine.caps().check_path(path).is_err() {
                    return Ok(());
                }
                let format = if path == UpdatePath::Blocks { DeltaFormat::Fast } else { DeltaFormat::Float32 };
                let (_, uploaded) = uploaded(headless, &engine, format);
                let update =
                    UpdateDesc::new(path, if format.is_blocks() { BatchSize::All } else { BatchSize::Targets(1) });
                let refused =
                    engine.create_crowd(&uploaded, &CrowdDesc { queue_family: Some(queue), ..CrowdDesc::new(update) });
                Err(refused.err().expect("refused"))
            });
            if let Err(error) = refused {
                assert!(error.to_string().contains(words), "{error}");
            }
        });
    };
    let compute = vk::QueueFlags::COMPUTE;
    // No device has that many.
    refuse(compute, &[0, 97], 0, UpdatePath::Blocks, "queue family 97 of ");
    refuse(compute, &[], 97, UpdatePath::Blocks, "queue family 97 of ");
    refuse(compute, &[0], 0, UpdatePath::Feedback, "has no graphics, which the passes of this path need");
    refuse(vk::QueueFlags::TRANSFER, &[0], 0, UpdatePath::Blocks, "has no compute");
}

/// Two families, of which the second does not exist: nothing is recorded for it.
#[test]
fn updates_for_queues_of_several_families_are_not_recorded_together() {
    let all = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE | vk::QueueFlags::TRANSFER;
    for driver in drivers() {
        let limits = limited(caps(&driver), |caps| caps.queue_families = vec![all]);
        on_device_within(&driver, Some(limits), |headless, _| {
            let (instance, physical, device) = headless.handles();
            let caps =
                limited(headless.caps().clone(), |caps| caps.queue_families = vec![all, vk::QueueFlags::COMPUTE]);
            let desc = DeviceDesc { caps: Some(caps), ..DeviceDesc::new(instance, physical, device) };
            // SAFETY: the handles belong together, and outlive the engine.
            let engine = unsafe { MorphEngine::new(&desc) }.expect("an engine");
            let (_, uploaded) = uploaded(headless, &engine, DeltaFormat::Fast);
            let crowd = |family| {
                let desc = CrowdDesc { queue_family: family, ..CrowdDesc::new(UpdateDesc::blocks()) };
                engine.create_crowd(&uploaded, &desc).expect("a crowd")
            };
            for (families, words) in [
                ([None, Some(0)], None),
                ([Some(0), Some(0)], None),
                ([Some(1), Some(1)], None),
                ([Some(0), Some(1)], Some("a queue of family 0 and of family 1")),
                ([None, Some(1)], Some("a queue of family 1 and of one with graphics and compute")),
            ] {
                let [mut one, mut other] = families.map(crowd);
                // SAFETY: `run` hands out a recording buffer of the engine's device, and waits. Barriers recorded for a
                // queue without graphics are allowed on one with graphics.
                let recorded = headless.run(|cmd| unsafe { engine.record_updates(cmd, &mut [&mut one, &mut other]) });
                match words {
                    None => drop(recorded.expect("updates")),
                    Some(words) => {
                        testing::says(recorded, &[words, "a command buffer of its own"]);
                        assert!(one.pose(0).is_err() && other.pose(0).is_err(), "nothing is recorded");
                    }
                }
            }
        });
    }
}
