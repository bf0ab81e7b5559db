//! Updates on a queue without graphics, with semaphores between them and the draws. CPU drivers have one queue family:
//! here it is treated as one without graphics, and draws are separate submissions.

use crate::gpu::{baseline, caps, limited, on_device_within, weights};
use crate::hazards::{accesses, trace};
use crate::prelude::*;
use deltamorph::PoseView;
use deltamorph::internals::plan::steps::Stage;

const FRAMES: usize = 6;
const INSTANCES: u32 = 2;
/// Number of frames between an update and the draw it waits for, if draws run concurrently with the next update.
const BESIDE: usize = 2;

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

/// Command buffers and semaphores of a host with two queues, represented by one.
struct Host<'a> {
    device: &'a ash::Device,
    pool: vk::CommandPool,
    /// Semaphores signalled by the update of each frame, and by its draw.
    updated: Vec<vk::Semaphore>,
    drawn: Vec<vk::Semaphore>,
}

impl<'a> Host<'a> {
    fn new(headless: &'a Headless) -> Self {
        let (_, _, device) = headless.handles();
        // SAFETY: the device is alive, and has a queue family; so in all that follows.
        let pool = unsafe { device.create_command_pool(&vk::CommandPoolCreateInfo::default(), None) }.expect("a pool");
        // SAFETY: as above.
        let semaphore = |_| unsafe { device.create_semaphore(&vk::SemaphoreCreateInfo::default(), None) };
        let semaphores = || (0..FRAMES).map(semaphore).collect::<Result<_, _>>().expect("semaphores");
        Self { device, pool, updated: semaphores(), drawn: semaphores() }
    }

    fn record<R>(&self, f: impl FnOnce(vk::CommandBuffer) -> R) -> (vk::CommandBuffer, R) {
        let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        // SAFETY: as above.
        unsafe {
            let cmd = self.device.allocate_command_buffers(&info).expect("a command buffer")[0];
            self.device.begin_command_buffer(cmd, &vk::CommandBufferBeginInfo::default()).expect("recording");
            let result = f(cmd);
            self.device.end_command_buffer(cmd).expect("recorded");
            (cmd, result)
        }
    }

    fn submit(
        &self,
        cmd: vk::CommandBuffer,
        wait: Option<(vk::Semaphore, vk::PipelineStageFlags)>,
        signal: vk::Semaphore,
    ) {
        let (waits, stages): (Vec<_>, Vec<_>) = wait.into_iter().unzip();
        let (cmds, signals) = ([cmd], [signal]);
        let info = vk::SubmitInfo::default()
            .command_buffers(&cmds)
            .wait_semaphores(&waits)
            .wait_dst_stage_mask(&stages)
            .signal_semaphores(&signals);
        // SAFETY: as above; awaited work was submitted before.
        unsafe { self.device.queue_submit(self.device.get_device_queue(0, 0), &[info], vk::Fence::null()) }
            .expect("submitted");
    }

    /// Submits the draw of a frame, which waits only for its update.
    fn draw(&self, n: usize, cmd: vk::CommandBuffer) {
        self.submit(cmd, Some((self.updated[n], vk::PipelineStageFlags::TRANSFER)), self.drawn[n]);
    }
}

impl Drop for Host<'_> {
    fn drop(&mut self) {
        // SAFETY: everything is this value's, and not in use after the wait.
        unsafe {
            self.device.device_wait_idle().expect("finished");
            self.updated
                .iter()
                .chain(&self.drawn)
                .for_each(|semaphore| self.device.destroy_semaphore(*semaphore, None));
            self.device.destroy_command_pool(self.pool, None);
        }
    }
}

/// The recording of a frame, and the poses that its draw read.
struct Frame {
    events: Vec<Event>,
    /// By instance: the pose and its copy.
    poses: Vec<(PoseView, Shared)>,
}

/// Updates and draws (copies, without barriers) frames, each in its own submission, ordered only by semaphores: an
/// update waits for the draw `behind` frames earlier.
fn frames(
    headless: &Headless,
    host: &Buffers<'_>,
    crowd: &mut Crowd,
    behind: usize,
    asked: &[Vec<Vec<f32>>],
) -> Vec<Frame> {
    use vk::PipelineStageFlags as At;
    let (engine, queues) = (headless.engine(), Host::new(headless));
    let (mut frames, mut draws): (Vec<Frame>, Vec<vk::CommandBuffer>) = (vec![], vec![]);
    for (n, asked) in asked.iter().enumerate() {
        asked.iter().zip(0..).for_each(|(weights, i)| crowd.set_weights(i, weights).expect("weights"));
        let mut list = vec![];
        let (update, _) = queues.record(|cmd| {
            let keep = |entries: &mut Vec<Entry>| list.clone_from(entries);
            // SAFETY: the buffer is recording, and runs once and in order; nothing is changed; crowd and engine outlive
            // it.
            unsafe { engine.record_tampered(cmd, &mut [crowd], keep) }.expect("an update")
        });
        let events = trace(&list, |_, works| accesses(crowd, works));
        // Draws are submitted as late as possible.
        let wait = n.checked_sub(behind).map(|before| {
            queues.draw(before, draws[before]);
            (queues.drawn[before], At::COMPUTE_SHADER)
        });
        queues.submit(update, wait, queues.updated[n]);
        let poses = (0..INSTANCES).map(|i| {
            let view = crowd.pose(i).expect("a pose");
            (view, host.shared(view.size as usize))
        });
        let poses: Vec<_> = poses.collect();
        let (draw, ()) = queues.record(|cmd| {
            for (view, copy) in &poses {
                let region = vk::BufferCopy { src_offset: view.offset, dst_offset: 0, size: view.size };
                // SAFETY: the buffer is recording; the region lies within both buffers, which outlive it.
                unsafe { queues.device.cmd_copy_buffer(cmd, view.buffer, copy.buffer, &[region]) };
            }
        });
        draws.push(draw);
        frames.push(Frame { events, poses });
    }
    draws.iter().enumerate().skip(FRAMES - behind).for_each(|(n, &draw)| queues.draw(n, draw));
    drop(queues);
    frames
}

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
        for (i, (view, _)) in (0..).zip(&frames[n].poses) {
            (0..=previous.min(n as u32)).for_each(|older| checker.draw(0, i, (view.slot + slots - older) % slots));
        }
    };
    for (n, frame) in frames.iter().enumerate() {
        checker.update(&frame.events);
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
        let host = Buffers::new(headless);
        let blocks = |format, pose| {
            (format, UpdateDesc { pose, weight_max: Some(4.0), tolerance: 1e-2, ..UpdateDesc::blocks() })
        };
        let all = [
            blocks(DeltaFormat::Fast, PoseFormat::Float32),
            blocks(DeltaFormat::Fast, PoseFormat::Fixed16),
            blocks(DeltaFormat::Small, PoseFormat::Fixed32),
            (DeltaFormat::Snorm16, UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(3))),
        ];
        for (format, update) in all {
            let (mesh, uploaded) = uploaded(headless, engine, format);
            for slots in 2..if format == DeltaFormat::Fast { 4 } else { 3 } {
                let what = format!("{format:?} {update:?}, {slots} slots");
                // The consumers are those of any crowd, but on the other queue.
                let desc = CrowdDesc {
                    instances: INSTANCES,
                    queue_family: Some(0),
                    ..CrowdDesc::new(UpdateDesc { slots, ..update })
                };
                let desc = CrowdDesc { frames_in_flight: FRAMES as u32, ..desc };
                let grid = update.grid(mesh.layout()).expect("a grid");
                let mut crowd = engine.create_crowd(&uploaded, &desc).expect("a crowd");
                let asked: Vec<Vec<Vec<f32>>> = (0..FRAMES as u32)
                    .map(|frame| (0..INSTANCES).map(|i| weights(&mesh, 2 * frame, i)).collect())
                    .collect();
                // Newer layers track a dispatch by whole descriptors. In blocks these cover all slots, so draws
                // concurrent with updates would be reported as hazards; the checker below tracks slots, and finds the
                // real ones.
                let behind = if format.is_blocks() { 1 } else { BESIDE };
                let frames = frames(headless, &host, &mut crowd, behind, &asked);
                for (frame, asked) in frames.iter().zip(&asked) {
                    assert_no_graphics(&frame.events, &what);
                    for ((view, copy), asked) in frame.poses.iter().zip(asked) {
                        let stored: Vec<u8> = host.contents(copy);
                        let pose = update.pose.decode(&stored[..view.size as usize], grid.as_ref());
                        let pose = mesh.layout().to_user_order(&pose);
                        let error = compare(&pose, &gpu::reference(&mesh, &update, asked));
                        let kept = is_kept(&error, mesh.layout().diagonal)
                            || error.within(f64::from(update.tolerance * mesh.layout().diagonal), NORMAL);
                        assert!(kept, "{what}: {error:?}");
                    }
                }
                // The documented semaphores are sufficient, and necessary: with previous poses, three slots.
                for previous in [0, 1] {
                    let found = has_hazards(&frames, slots, previous, None);
                    assert_eq!(found, slots < 2 + previous, "{what}, {previous} previous poses");
                }
                let previous = slots - 2;
                for n in 0..FRAMES {
                    let found = has_hazards(&frames, slots, previous, Some((n, false)));
                    assert!(found, "{what}: without the semaphore from update {n} to its draw");
                }
                for n in previous as usize..FRAMES - BESIDE {
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
        // SAFETY: the buffer is large enough, and outlives the crowd; nothing is running.
        unsafe { engine.set_output_target(&mut crowd, 0, Some(&OutputTarget::new(words.buffer))) }.expect("a target");
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
