//! Record, not submit: updates that are delayed, dropped, reset, or recorded twice before they run.

use crate::gpu::{self, on_every_device, single, update_descs, weights};
use deltamorph::ash::{self, vk};
use deltamorph::reference::compare;
use deltamorph::{CrowdDesc, DeltaFormat, DeviceDesc, MorphEngine, PackedMesh, PoseError, UpdateDesc, testing};
use deltamorph_headless::{DeviceChoice, Headless, HeadlessCrowd, HeadlessDesc};
use std::sync::Mutex;

/// Run `test` for every path and batch size of every device, on a fresh crowd that has shown two frames.
fn with_crowds(test: impl Fn(&mut HeadlessCrowd<'_>, &PackedMesh, UpdateDesc)) {
    on_every_device(|headless: &Headless, engine: &MorphEngine| {
        for format in [DeltaFormat::Snorm16, DeltaFormat::Fast, DeltaFormat::Small] {
            let mesh = gpu::packed(engine, &testing::mesh(300, 23), format);
            for desc in update_descs(engine, format) {
                let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
                for frame in 0..2 {
                    crowd.step(&[&weights(&mesh, frame, 9)]).expect("a step");
                }
                test(&mut crowd, &mesh, desc);
            }
        }
    });
}

fn error(crowd: &mut HeadlessCrowd<'_>, mesh: &PackedMesh, weights: &[f32]) -> PoseError {
    let update = crowd.crowd().desc().update;
    compare(&crowd.read_pose(0).expect("a pose"), &gpu::reference(mesh, &update, weights))
}

fn assert_right(crowd: &mut HeadlessCrowd<'_>, mesh: &PackedMesh, weights: &[f32], desc: UpdateDesc) {
    let error = error(crowd, mesh, weights);
    assert!(gpu::is_kept(&error, mesh.layout().diagonal), "{desc:?}: {error:?}");
}

#[test]
fn a_discarded_update_is_rebuilt() {
    with_crowds(|crowd, mesh, desc| {
        // Recorded and never submitted. Without the discard the next update would build on what never ran.
        let (_, dropped) = crowd.record(&[&weights(mesh, 2, 9)]).expect("a recording");
        crowd.discard(dropped.ticket).expect("a ticket of this crowd");
        let next = weights(mesh, 3, 9);
        let step = crowd.step(&[&next]).expect("a step");
        let stats = step.update.stats;
        assert!(stats.rebuilt == 1 || stats.dirty_blocks > 0 && stats.rebuilt_blocks == stats.dirty_blocks, "{desc:?}");
        assert_right(crowd, mesh, &next, desc);
        crowd.step(&[&weights(mesh, 4, 9)]).expect("a step");
        assert_right(crowd, mesh, &weights(mesh, 4, 9), desc);
    });
}

#[test]
fn without_the_discard_the_pose_would_be_wrong() {
    with_crowds(|crowd, mesh, desc| {
        let mut next = vec![0.5; 23];
        let _ = crowd.record(&[&next]).expect("a recording");
        next[7] = 1.5;
        crowd.step(&[&next]).expect("a step");
        assert!(error(crowd, mesh, &next).position > 1e-3, "{desc:?}: the test above proves nothing");
    });
}

#[test]
fn of_two_recorded_updates_the_second_is_discarded() {
    with_crowds(|crowd, mesh, desc| {
        let (first, _) = crowd.record(&[&weights(mesh, 2, 9)]).expect("a recording");
        let (_, second) = crowd.record(&[&weights(mesh, 3, 9)]).expect("a recording");
        crowd.submit(vec![first]).expect("a submission");
        crowd.discard(second.ticket).expect("a ticket of this crowd");
        crowd.step(&[&weights(mesh, 4, 9)]).expect("a step");
        assert_right(crowd, mesh, &weights(mesh, 4, 9), desc);
    });
}

#[test]
fn a_reset_command_buffer_is_recorded_again() {
    with_crowds(|crowd, mesh, desc| {
        let (_, lost) = crowd.record(&[&weights(mesh, 2, 9)]).expect("a recording");
        crowd.discard(lost.ticket).expect("a ticket of this crowd");
        // The same weights once more, as a host would that recreates its swapchain and starts the frame again.
        let (again, _) = crowd.record(&[&weights(mesh, 2, 9)]).expect("a recording");
        crowd.submit(vec![again]).expect("a submission");
        assert_right(crowd, mesh, &weights(mesh, 2, 9), desc);
    });
}

#[test]
fn two_updates_recorded_before_either_is_submitted() {
    with_crowds(|crowd, mesh, desc| {
        let (first, _) = crowd.record(&[&weights(mesh, 2, 9)]).expect("a recording");
        let (second, _) = crowd.record(&[&weights(mesh, 3, 9)]).expect("a recording");
        // In one submission, and the coefficients of the first are still what they were.
        crowd.submit(vec![first, second]).expect("a submission");
        assert_right(crowd, mesh, &weights(mesh, 3, 9), desc);
    });
}

#[test]
fn two_frames_in_flight_with_delayed_submission() {
    with_crowds(|crowd, mesh, desc| {
        let mut waiting = None;
        for frame in 2..8 {
            let (cmd, _) = crowd.record(&[&weights(mesh, frame, 9)]).expect("a recording");
            // Submission lags one frame behind recording: always two updates recorded and not finished.
            if let Some(earlier) = waiting.replace(cmd) {
                crowd.submit(vec![earlier]).expect("a submission");
            }
        }
        crowd.submit(vec![waiting.expect("the last frame")]).expect("a submission");
        assert_right(crowd, mesh, &weights(mesh, 7, 9), desc);
    });
}

#[test]
fn a_cut_has_no_previous_pose() {
    with_crowds(|crowd, mesh, desc| {
        crowd.cut(0).expect("instance 0");
        crowd.step(&[&weights(mesh, 2, 9)]).expect("a step");
        let (pose, previous) = (crowd.crowd().pose(0).unwrap(), crowd.crowd().previous_pose(0).unwrap());
        assert_eq!(previous, Some(pose), "{desc:?}");
        crowd.step(&[&[0.0; 23]]).expect("a step");
        let (pose, previous) = (crowd.crowd().pose(0).unwrap(), crowd.crowd().previous_pose(0).unwrap());
        assert_ne!(previous, Some(pose), "{desc:?}");
    });
}

#[test]
fn misuse_is_an_error_that_says_what_to_do() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(10, 2), DeltaFormat::Float32);
        let desc = update_descs(engine, DeltaFormat::Float32)[0];
        let refuse = |desc: CrowdDesc, words: &str| {
            let error = HeadlessCrowd::new(headless, &mesh, &desc).err().expect("refused").to_string();
            assert!(error.contains(words), "{error}");
        };
        refuse(single(desc).instances(0), "0 instances");
        refuse(single(desc).frames_in_flight(0), "0 frames in flight");
        refuse(single(desc).instances(1 << 24), "use fewer instances");
        let batch = deltamorph::BatchSize::Targets(99);
        refuse(single(desc.batch(batch)), "batch size 99");
        let path = deltamorph::UpdatePath::Cpu;
        refuse(single(desc.path(path)), "use CpuCrowd");

        let mut crowd = HeadlessCrowd::new(headless, &mesh, &single(desc)).expect("a crowd");
        assert!(crowd.crowd().pose(0).unwrap_err().to_string().contains("record an update first"));
        for (weights, words) in [
            (&[0.0, f32::NAN][..], "target 1 ('target_1') is NaN"),
            (&[0.0], "1 weights given, but the mesh has 2 targets"),
        ] {
            let error = crowd.step(&[weights]).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        assert!(crowd.set_weights(1, &[0.0, 0.0]).unwrap_err().to_string().contains("instance 1 of a crowd of 1"));
        // A refused call leaves everything as it was.
        crowd.step(&[&[0.25, 0.5]]).expect("a step");
        assert_right(&mut crowd, &mesh, &[0.25, 0.5], desc);

        // A second engine, on a device of its own.
        let other = Headless::new(&HeadlessDesc::default().device(DeviceChoice::Name(headless.caps().name.clone())));
        let other = other.expect("a second device");
        let mut own = headless.engine().create_crowd(crowd.mesh(), &single(desc)).expect("a crowd");
        // SAFETY: nothing is recorded, as the crowd is another engine's.
        let recorded = headless.run(|cmd| unsafe { other.engine().record_update(cmd, &mut own) });
        let error = recorded.unwrap_err().to_string();
        assert!(error.contains("another MorphEngine"), "{error}");
        let error = other.engine().create_crowd(crowd.mesh(), &single(desc)).err().expect("refused").to_string();
        assert!(error.contains("another MorphEngine"), "{error}");
    });
}

#[test]
fn a_discarded_or_empty_update_does_not_turn_the_ring_of_coefficients() {
    with_crowds(|crowd, mesh, desc| {
        // Two frames in flight: one update is pending, then one is dropped, one records nothing, one is recorded.
        let (pending, _) = crowd.record(&[&weights(mesh, 2, 9)]).expect("a recording");
        let (_, dropped) = crowd.record(&[&weights(mesh, 3, 9)]).expect("a recording");
        crowd.discard(dropped.ticket).expect("a ticket of this crowd");
        assert!(crowd.crowd().pose(0).unwrap_err().to_string().contains("no pose yet"), "{desc:?}");
        let (again, _) = crowd.record(&[&weights(mesh, 3, 9)]).expect("a recording");
        crowd.submit(vec![pending]).expect("a submission");
        // The pending update found its own coefficients: what it wrote is the source or the result of nothing now,
        // so it is seen in the previous pose only where that is kept; the last update is right in any case.
        crowd.submit(vec![again]).expect("a submission");
        assert_right(crowd, mesh, &weights(mesh, 3, 9), desc);

        let mut next = weights(mesh, 3, 9);
        next[5] += 0.5;
        let (pending, _) = crowd.record(&[&next]).expect("a recording");
        let (empty, nothing) = crowd.record(&[&next]).expect("a recording");
        assert_eq!(nothing.stats.passes, 0);
        let mut last = next.clone();
        last[6] += 0.25;
        let (second, _) = crowd.record(&[&last]).expect("a recording");
        // Both incremental: had the second overwritten the first one's list, target 5 would be off.
        crowd.submit(vec![pending, empty, second]).expect("a submission");
        assert_right(crowd, mesh, &last, desc);
    });
}

/// The caches that [`seen_compute`] and [`seen_graphics`] were handed.
static CACHES: Mutex<Vec<vk::PipelineCache>> = Mutex::new(vec![]);
/// The driver's own functions.
static CREATE: Mutex<Option<(vk::PFN_vkCreateComputePipelines, vk::PFN_vkCreateGraphicsPipelines)>> = Mutex::new(None);

unsafe extern "system" fn seen_compute(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::ComputePipelineCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    pipelines: *mut vk::Pipeline,
) -> vk::Result {
    CACHES.lock().unwrap().push(cache);
    let (create, _) = CREATE.lock().unwrap().expect("set before");
    // SAFETY: handed on as it came.
    unsafe { create(device, cache, count, infos, allocator, pipelines) }
}

unsafe extern "system" fn seen_graphics(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::GraphicsPipelineCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    pipelines: *mut vk::Pipeline,
) -> vk::Result {
    CACHES.lock().unwrap().push(cache);
    let (_, create) = CREATE.lock().unwrap().expect("set before");
    // SAFETY: handed on as it came.
    unsafe { create(device, cache, count, infos, allocator, pipelines) }
}

/// Software drivers keep nothing in a cache that would show in its data, so that the calls are looked at on their way
/// to the driver.
#[test]
fn every_pipeline_is_made_with_the_cache_of_the_host() {
    on_every_device(|headless, _| {
        let (instance, physical, device) = headless.handles();
        let mut functions = device.fp_v1_0().clone();
        *CREATE.lock().unwrap() = Some((functions.create_compute_pipelines, functions.create_graphics_pipelines));
        (functions.create_compute_pipelines, functions.create_graphics_pipelines) = (seen_compute, seen_graphics);
        let (v1, v2, v3) = (device.fp_v1_1().clone(), device.fp_v1_2().clone(), device.fp_v1_3().clone());
        let device = ash::Device::from_parts_1_3(device.handle(), functions, v1, v2, v3);
        let mut data = vec![];
        // Once more with what the first run left in its cache.
        for _ in 0..2 {
            let info = vk::PipelineCacheCreateInfo::default().initial_data(&data);
            // SAFETY: the device is alive, and the data are none or the driver's own.
            let pipeline_cache = unsafe { device.create_pipeline_cache(&info, None) }.expect("a cache");
            let mut desc = DeviceDesc::new(instance, physical, &device);
            desc.caps = Some(headless.caps().clone());
            desc.transform_feedback_enabled = headless.caps().transform_feedback.is_some();
            desc.pipeline_cache = pipeline_cache;
            // SAFETY: the handles belong together and outlive the engine; the limits are those of the device.
            let engine = unsafe { MorphEngine::new(&desc) }.expect("an engine");
            for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
                let mesh = gpu::packed(&engine, &testing::mesh(300, 23), format);
                // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
                let uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, &mesh) }).expect("an upload");
                for desc in update_descs(&engine, format) {
                    let mut crowd = engine.create_crowd(&uploaded, &single(desc)).expect("a crowd");
                    crowd.set_weights(0, &weights(&mesh, 1, 9)).expect("weights");
                    // SAFETY: as above.
                    headless.run(|cmd| unsafe { engine.record_update(cmd, &mut crowd) }).expect("an update");
                }
            }
            drop(engine);
            let caches = std::mem::take(&mut *CACHES.lock().unwrap());
            assert!(caches.len() > 3 && caches.iter().all(|cache| *cache == pipeline_cache), "{caches:?}");
            // SAFETY: the engine, which made pipelines with it, is gone.
            unsafe {
                data = device.get_pipeline_cache_data(pipeline_cache).expect("data");
                device.destroy_pipeline_cache(pipeline_cache, None);
            }
        }
        assert!(!data.is_empty());
    });
}
