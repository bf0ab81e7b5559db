//! What a host can watch of an update's commands: the labels around its steps, and timestamps between them; and the
//! cache that pipelines are made with.

use crate::prelude::*;
use crate::watched::{log, watched};

/// An engine on the device of `headless`, whose calls are written down.
fn engine(headless: &Headless, names: bool, cache: vk::PipelineCache) -> MorphEngine {
    let (_, physical, _) = headless.handles();
    let (instance, device) = watched(headless);
    let caps = headless.caps();
    let desc =
        DeviceDesc { caps: Some(caps.clone()), debug_names: names, ..DeviceDesc::new(&instance, physical, &device) };
    let mut desc = DeviceDesc { transform_feedback_enabled: caps.transform_feedback.is_some(), ..desc };
    desc.pipeline_cache = cache;
    // SAFETY: the handles are of one device, which outlives the engine; the validation layers are on, and with them
    // the extension.
    unsafe { MorphEngine::new(&desc) }.expect("an engine")
}

/// A pose of each crowd after an update, the recorded commands, and the number of timestamps and the steps of each
/// update.
type Frame = (Vec<Vec<f32>>, Vec<String>, Vec<(u32, Vec<&'static str>)>);

const NONE: vk::PipelineCache = vk::PipelineCache::null();

/// Queries for each crowd.
const QUERIES: u32 = 10;

/// Records four updates, the last without a change, of three crowds in one call: in blocks with a decoded instance, in
/// dense passes, and animated on the GPU (which is not among them in the last). `with_queries` may set queries before.
fn frames(
    headless: &Headless,
    engine: &MorphEngine,
    mut with_queries: impl FnMut(vk::CommandBuffer, [&mut Crowd; 3]),
) -> Vec<Frame> {
    let host = Buffers::new(headless);
    let decoded = host.shared(300 * 12).buffer;
    let [mesh, dense] =
        [DeltaFormat::Fast, DeltaFormat::Snorm16].map(|format| gpu::packed(engine, &testing::mesh(300, 7), format));
    let uploaded = gpu::upload(headless, engine, &mesh);
    let passes = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(3));
    let desc = CrowdDesc::new(gpu::fixed()[1]);
    let mut blocks = engine.create_crowd(&uploaded, &desc).expect("a crowd");
    let dense = gpu::upload(headless, engine, &dense);
    let mut dense = engine.create_crowd(&dense, &CrowdDesc::new(passes)).expect("a crowd");
    let streams = [OutputStream::new(Semantic::Position, decoded)];
    // SAFETY: the buffer is large enough, and outlives the crowd; nothing is running.
    unsafe { engine.set_output_target(&mut blocks, 0, Some(&OutputTarget::new(&streams))) }.expect("a target");
    let clips = [gpu::clip(&mesh, 30.0, (0..70).map(|i| i as f32 / 80.0).collect())];
    let animation = AnimationDesc::new(&clips);
    // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
    let made = headless.run(|cmd| unsafe { engine.create_animated_crowd(cmd, &uploaded, &desc, &animation) });
    let mut animated = made.expect("a crowd");
    animated.play(0, &Playback::new(0)).expect("a clip");
    let mut readback = [0; 3].map(|_| engine.readback());
    let frame = |frame: u32| {
        for crowd in [&mut blocks, &mut dense] {
            crowd.set_weights(0, &[(1 + frame.min(2)) as f32 / 4.0; 7]).expect("weights");
        }
        animated.set_time(f64::from(frame) / 30.0).expect("a time");
        let log = headless.run(|cmd| {
            with_queries(cmd, [&mut blocks, &mut dense, &mut animated]);
            log();
            let mut all: [&mut Crowd; 3] = [&mut blocks, &mut dense, &mut animated];
            // SAFETY: as above.
            let updates = unsafe { engine.record_updates(cmd, if frame < 3 { &mut all } else { &mut all[..2] }) }?;
            let log = log();
            let steps = [blocks.step_names().collect(), dense.step_names().collect(), animated.step_names().collect()];
            let steps = updates.iter().map(|update| update.timestamps).zip(steps).collect();
            let all: [&Crowd; 3] = [&blocks, &dense, &animated];
            // SAFETY: as above, and after the updates.
            readback.iter_mut().zip(all).try_for_each(|(copy, crowd)| unsafe { copy.record(cmd, crowd, &[0]) })?;
            Ok((log, steps))
        });
        // SAFETY: `run` has waited.
        let poses = readback.iter_mut().flat_map(|copy| unsafe { copy.poses() }.expect("a pose"));
        let (log, steps) = log.expect("an update");
        (poses.map(|pose| pose.vertices).collect(), log, steps)
    };
    (0..4).map(frame).collect()
}

#[test]
fn labels_are_around_updates_and_steps_and_change_nothing_else() {
    for driver in drivers() {
        on_device(&driver, false, |headless, _| {
            let [named, plain] = [true, false].map(|names| frames(headless, &engine(headless, names, NONE), |_, _| ()));
            for (number, ((poses, log, steps), plain)) in named.into_iter().zip(plain).enumerate() {
                let (mut open, mut labels, mut commands) = (0, Vec::<String>::new(), vec![]);
                for line in log {
                    match (line.strip_prefix("begin "), line.as_str()) {
                        (Some(name), _) => {
                            assert_eq!(open, i32::from(name != "deltamorph update"), "{name}");
                            labels.push(name.to_owned());
                            open += 1;
                        }
                        (None, "end") => open -= 1,
                        (None, command) => {
                            // Barriers are between steps, everything else is within one.
                            assert_eq!(open, if command.starts_with("barrier") { 1 } else { 2 }, "{command}");
                            commands.push(line);
                        }
                    }
                }
                assert_eq!(open, 0, "labels are ended");
                assert_eq!((poses, commands, steps), plain, "{driver}: what is recorded without labels");
                let expected = match number {
                    0 => "blocks, compute, records, output, compute, sample, compute, plan, arguments, blocks",
                    1 | 2 => "blocks, compute, sample, output, compute, plan, compute, arguments, blocks",
                    _ => "",
                };
                let update = if number < 3 { "deltamorph update, " } else { "" };
                assert_eq!(labels.join(", "), format!("{update}{expected}"), "{driver}, update {number}");
            }
        });
    }
}

#[test]
fn timestamps_are_written_between_the_steps_of_each_update() {
    for driver in drivers() {
        on_device(&driver, false, |headless, _| {
            let (_, _, device) = headless.handles();
            let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(3 * QUERIES);
            // SAFETY: the device is alive, and the pool is destroyed below.
            let pool = unsafe { device.create_query_pool(&info, None) }.expect("a pool");
            let plain = frames(headless, &engine(headless, false, NONE), |_, _| ());
            let mut number = 0;
            let timed = frames(headless, &engine(headless, false, NONE), |cmd, crowds| {
                // What the update before wrote, which has finished.
                for first in (0..3).map(|crowd| crowd * QUERIES).filter(|_| (1..4).contains(&number)) {
                    let written = plain[number - 1].2[first as usize / QUERIES as usize].1.len() + 1;
                    let mut at = vec![0u64; written];
                    // SAFETY: as many queries were written.
                    unsafe { device.get_query_pool_results(pool, first, &mut at, vk::QueryResultFlags::TYPE_64) }
                        .expect("all written");
                    assert!(at[0] > 0 && at.is_sorted(), "{driver}, crowd {first}: {at:?}");
                }
                number += 1;
                // SAFETY: the queries are reset here; the drivers have timestamps, and the pool outlives the updates.
                unsafe { device.cmd_reset_query_pool(cmd, pool, 0, 3 * QUERIES) };
                for (crowd, first) in crowds.into_iter().zip([0, QUERIES, 2 * QUERIES]) {
                    // SAFETY: as above.
                    unsafe { crowd.set_queries(pool, first, QUERIES) };
                }
            });
            for (number, ((poses, log, steps), plain)) in timed.into_iter().zip(plain).enumerate() {
                let (stamps, commands): (Vec<_>, Vec<_>) =
                    log.into_iter().partition(|line| line.starts_with("timestamp"));
                assert_eq!((poses, commands), (plain.0, plain.1), "{driver}: what is recorded without timestamps");
                let numbers: Vec<usize> = steps.iter().map(|(timestamps, _)| *timestamps as usize).collect();
                let names: Vec<_> = steps.into_iter().map(|(_, names)| names.join(" ")).collect();
                if number == 3 {
                    assert_eq!(
                        (numbers, names, stamps),
                        (vec![0; 2], vec![String::new(); 2], vec![]),
                        "nothing changed"
                    );
                    continue;
                }
                let (records, count) = if number == 0 { ("records ", 6) } else { ("", 5) };
                let animated = format!("{records}sample plan arguments blocks");
                assert_eq!(names, ["blocks output", "compute compute compute", &animated]);
                assert_eq!(numbers, [3, 4, count]);
                assert_eq!(stamps.len(), 7 + count, "{stamps:?}");
                assert_eq!(stamps[..3], ["timestamp 0", "timestamp 10", "timestamp 20"], "all begin together");
            }
            // SAFETY: `run` has waited for all updates.
            unsafe { device.destroy_query_pool(pool, None) };
        });
    }
}

#[test]
fn too_few_queries_are_refused_before_anything_is_recorded() {
    on_device(&drivers()[0], false, |headless, _| {
        let engine = engine(headless, true, NONE);
        let mesh = gpu::packed(&engine, &testing::mesh(300, 7), DeltaFormat::Fast);
        let uploaded = gpu::upload(headless, &engine, &mesh);
        let mut crowd = engine.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
        crowd.set_weights(0, &[0.5; 7]).expect("weights");
        log();
        // SAFETY: nothing is written to the pool, which is null.
        unsafe { crowd.set_queries(vk::QueryPool::null(), 0, 1) };
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
        let refused = headless.run(|cmd| unsafe { engine.record_update(cmd, &mut crowd) });
        testing::says(refused, &["1 queries for the 2 timestamps"]);
        assert_eq!(log(), [""; 0]);
        // SAFETY: as above.
        let update = headless.run(|cmd| unsafe { engine.record_update(cmd, &mut crowd) }).expect("an update");
        assert_eq!((update.timestamps, crowd.step_names().collect()), (0, vec!["blocks"]));
        assert!(log().contains(&"begin blocks".to_owned()), "the setting was used up");
    });
}

/// Software drivers keep nothing in a cache that would show in its data.
#[test]
fn every_pipeline_is_made_with_the_cache_of_the_host() {
    on_device(&drivers()[0], false, |headless, _| {
        let (_, _, device) = headless.handles();
        // SAFETY: the device is alive, and the cache is destroyed below.
        let cache = unsafe { device.create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None) };
        let cache = cache.expect("a cache");
        let engine = engine(headless, false, cache);
        log();
        for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
            let mesh = gpu::packed(&engine, &testing::mesh(300, 23), format);
            let uploaded = gpu::upload(headless, &engine, &mesh);
            for update in update_descs(&engine, format) {
                engine.create_crowd(&uploaded, &CrowdDesc::new(update)).expect("a crowd");
            }
        }
        drop(engine);
        let made: Vec<String> = log().into_iter().filter(|line| line.starts_with("pipelines")).collect();
        let of_host = format!("pipelines of {cache:?}");
        assert!(made.len() > 3 && made.iter().all(|line| line.starts_with(&of_host)), "{made:?}");
        // SAFETY: the engine, which made pipelines with it, is gone.
        unsafe { device.destroy_pipeline_cache(cache, None) };
    });
}
