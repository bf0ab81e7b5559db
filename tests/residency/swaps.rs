//! Targets that come to the device and go, on real drivers: poses are those of a mesh that is there as a whole, bit for
//! bit, whatever came and went; memory is bounded and never runs out while bytes are free.

use crate::gpu::{self, fixed, on_every_device};
use crate::resident::{TARGETS, all_bytes, assert_same, packed, swap, updates, upload};
use deltamorph::ash::vk;
use deltamorph::{
    Crowd, CrowdDesc, DeltaFormat, GpuMesh, MorphEngine, PackedMesh, PoseFormat, PoseReadback, SwapCopies, TargetSwap,
    UpdateDesc, testing,
};
use deltamorph_head::Rng;
use deltamorph_headless::{DeviceChoice, Headless, HeadlessDesc};

/// Two crowds of two instances on the swapped mesh and on the whole one, side by side.
struct Both {
    update: UpdateDesc,
    crowds: [Crowd; 2],
    readbacks: [PoseReadback; 2],
    weights: Vec<Vec<f32>>,
}

/// Random swaps in all formats, up to the last byte that is free, ten in a submission, with an update of several crowds
/// after each. `DELTAMORPH_SWAPS` says how many on each driver; a whole run, which takes minutes, has 10,000.
#[test]
fn swaps_never_fail_while_bytes_are_free_and_poses_stay_right() {
    let swaps = std::env::var("DELTAMORPH_SWAPS").map_or(2_400, |n| n.parse::<u32>().expect("a number of swaps"));
    let rounds = swaps.div_ceil(10 * DeltaFormat::BLOCKS.len() as u32);
    for (d, driver) in gpu::drivers().iter().enumerate() {
        gpu::on_device(driver, false, |headless, engine| {
            for (f, format) in DeltaFormat::BLOCKS.into_iter().enumerate() {
                soak(headless, engine, format, f == d, rounds, 77 + f as u64);
            }
        });
    }
}

fn soak(headless: &Headless, engine: &MorphEngine, format: DeltaFormat, with_streams: bool, rounds: u32, seed: u64) {
    let mesh = packed(engine, format, with_streams);
    let (whole, limit) = (upload(headless, &mesh, None), all_bytes(&mesh) * 2 / 5);
    let mut gpu = upload(headless, &mesh, Some(limit));
    let crowd = |mesh: &GpuMesh, update, slots: u32| {
        let desc = CrowdDesc::new(UpdateDesc::slots(update, slots)).instances(2).frames_in_flight(12);
        engine.create_crowd(mesh, &desc).expect("a crowd")
    };
    let both = |(i, update): (u32, UpdateDesc)| Both {
        crowds: [crowd(&gpu, update, 1 + i), crowd(&whole, update, 1 + i)],
        readbacks: [engine.readback(), engine.readback()],
        weights: vec![vec![0.0; TARGETS]; 2],
        update,
    };
    let mut all: Vec<Both> = (0..).zip(updates(format)).map(both).collect();
    let mut rng = Rng::new(seed, 0);
    let mut random = |n: usize| (rng.next_u64() % n as u64) as usize;
    let before = gpu.residency().expect("of swapped targets");
    let (mut copied, mut loaded, mut swaps) = (0, 0, 0);
    for _ in 0..rounds {
        let ran = headless.run(|cmd| {
            let mut kept: Vec<SwapCopies> = vec![];
            for _ in 0..10 {
                // Those that no pose holds may go; whatever fits then may come.
                let held = |target: usize| all.iter().flat_map(|both| &both.weights).any(|w| w[target] != 0.0);
                let mut unload: Vec<usize> = (0..TARGETS).filter(|&t| gpu.is_resident(t) && !held(t)).collect();
                unload.retain(|_| random(3) > 0);
                let mut free = gpu.residency().expect("as above").free();
                free += unload.iter().map(|&target| mesh.target_bytes(target)).sum::<u64>();
                let away: Vec<usize> = (0..TARGETS).filter(|&target| !gpu.is_resident(target)).collect();
                let mut load = vec![];
                for _ in 0..away.len() {
                    let target = away[random(away.len())];
                    if mesh.target_bytes(target) <= free && !load.contains(&target) {
                        free -= mesh.target_bytes(target);
                        load.push(target);
                    }
                }
                loaded += load.iter().map(|&target| mesh.target_bytes(target)).sum::<u64>();
                let swap = TargetSwap::default().load(&load).unload(&unload);
                // SAFETY: the buffer records on the engine's device and is waited for, the copies are kept until then.
                let copies = unsafe { engine.record_swap(cmd, &mut gpu, &mesh, &swap) }?;
                assert_eq!(gpu.residency().expect("as above").free(), free);
                copied += copies.bytes();
                swaps += u32::from(!load.is_empty());
                kept.push(copies);
                for Both { crowds, weights, .. } in &mut all {
                    for (i, weights) in (0..).zip(&mut *weights) {
                        for (target, weight) in weights.iter_mut().enumerate() {
                            *weight = match random(12) {
                                _ if !gpu.is_resident(target) => 0.0,
                                0 => random(8) as f32 / 4.0 - 0.75,
                                1..4 => *weight,
                                _ => 0.0,
                            };
                        }
                        crowds.iter_mut().try_for_each(|crowd| crowd.set_weights(i, weights))?;
                    }
                    for crowd in crowds {
                        // SAFETY: as above.
                        unsafe { engine.record_update(cmd, crowd) }?;
                    }
                }
            }
            for Both { crowds, readbacks, .. } in &mut all {
                for (crowd, readback) in crowds.iter().zip(readbacks) {
                    // SAFETY: as above.
                    unsafe { readback.record(cmd, crowd, &[0, 1]) }?;
                }
            }
            Ok(kept)
        });
        drop(ran.expect("swaps and updates"));
        all.iter_mut().for_each(|both| assert_same(&mesh, &both.update, &mut both.readbacks, &both.weights));
    }
    let after = gpu.residency().expect("as above");
    assert_eq!((before.capacity, before.buffer), (after.capacity, after.buffer));
    assert!(after.capacity <= limit && after.capacity + mesh.target_bytes(0) > limit);
    println!("{format:?}: {swaps} swaps copied {copied} bytes for {loaded} bytes loaded");
    assert!(swaps > 9 * rounds, "{swaps} of {} swaps loaded targets", 10 * rounds);
    // Where entries have one length none has to move; headers come with them.
    let most = if format == DeltaFormat::Small { 3.0 } else { 1.01 };
    assert!(copied >= loaded && copied as f64 <= most * loaded as f64, "{copied} bytes for {loaded}");
}

/// A swap between two updates of one submission, which takes the place of what the first one reads for what the second
/// one needs: nothing but the swap's own barriers orders them.
fn record_between(
    engine: &MorphEngine,
    cmd: vk::CommandBuffer,
    (gpu, crowd): (&mut GpuMesh, &mut Crowd),
    mesh: &PackedMesh,
    keep: [bool; 2],
) -> deltamorph::Result<SwapCopies> {
    let swap = TargetSwap::default().load(&[4]).unload(&[3]);
    // SAFETY: the callers hand in a recording buffer of the engine's device and wait for it; barriers that are left
    // out are what is to be found.
    unsafe {
        crowd.set_weight(0, 3, 0.5)?;
        engine.record_update(cmd, crowd)?;
        crowd.set_weight(0, 3, 0.0)?;
        crowd.set_weight(0, 1, 1.0)?;
        engine.record_update(cmd, crowd)?;
        let copies = engine.record_swap_tampered(cmd, gpu, mesh, &swap, keep)?;
        crowd.set_weight(0, 4, 0.75)?;
        engine.record_update(cmd, crowd)?;
        Ok(copies)
    }
}

fn between(engine: &MorphEngine, headless: &Headless, format: DeltaFormat, update: UpdateDesc, keep: [bool; 2]) {
    let mesh = packed(engine, format, false);
    // No room for all three: what is loaded takes the place of what goes.
    let limit = [1, 3, 4].iter().map(|&target| mesh.target_bytes(target)).sum::<u64>();
    let limit = limit - mesh.target_bytes(3).min(mesh.target_bytes(4));
    let limit = limit.max((0..TARGETS).map(|target| mesh.target_bytes(target)).max().expect("targets"));
    let meshes = [Some(limit), None].map(|bytes| upload(headless, &mesh, bytes));
    let [mut gpu, whole] = meshes;
    swap(headless, &mut gpu, &mesh, &[1, 3], &[]);
    let desc = CrowdDesc::new(update).frames_in_flight(4);
    let mut crowds = [&gpu, &whole].map(|gpu| engine.create_crowd(gpu, &desc).expect("a crowd"));
    let mut readbacks = [engine.readback(), engine.readback()];
    let mut weights = vec![0.0; TARGETS];
    (weights[1], weights[4]) = (1.0, 0.75);
    let ran = headless.run(|cmd| {
        let copies = record_between(engine, cmd, (&mut gpu, &mut crowds[0]), &mesh, keep)?;
        crowds[1].set_weights(0, &weights)?;
        // SAFETY: as above.
        unsafe { engine.record_update(cmd, &mut crowds[1]) }?;
        for (crowd, readback) in crowds.iter().zip(&mut readbacks) {
            // SAFETY: as above.
            unsafe { readback.record(cmd, crowd, &[0]) }?;
        }
        Ok(copies)
    });
    drop(ran.expect("updates and a swap"));
    if keep == [true; 2] && update.pose != PoseFormat::Float32 {
        assert_same(&mesh, &update, &mut readbacks, &[weights]);
    }
}

#[test]
fn a_swap_between_two_updates_has_no_hazard() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::BLOCKS {
            for update in updates(format) {
                between(engine, headless, format, update, [true; 2]);
            }
        }
    });
}

#[test]
fn a_barrier_of_a_swap_that_is_left_out_is_a_hazard() {
    for driver in gpu::drivers() {
        for keep in [[false, true], [true, false]] {
            let desc = HeadlessDesc::default().device(DeviceChoice::Name(driver.clone())).validation(true);
            let headless = Headless::new(&desc).expect("a device");
            between(headless.engine(), &headless, DeltaFormat::Fast, fixed()[0], keep);
            let messages = gpu::complaints(&headless);
            assert!(messages.iter().any(|message| message.contains("SYNC-HAZARD")), "{driver} {keep:?}: {messages:?}");
        }
    }
}

#[test]
fn the_buffer_is_as_large_as_it_says_and_never_grows() {
    on_every_device(|headless, engine| {
        for format in DeltaFormat::BLOCKS {
            let mesh = packed(engine, format, true);
            let (_, _, device) = headless.handles();
            let whole = MorphEngine::mesh_bytes(&mesh);
            for share in [3, 10, 20] {
                let limit = all_bytes(&mesh) * share / 10;
                let mut gpu = upload(headless, &mesh, Some(limit));
                let bytes = gpu.residency().expect("of swapped targets");
                assert!(bytes.capacity <= limit.min(all_bytes(&mesh)) && bytes.used == 0);
                let base: u64 = gpu.layouts().map(|layout| layout.base_bytes()).sum();
                let index: u64 = gpu.layouts().map(|layout| layout.index_bytes()).sum();
                assert!(bytes.buffer <= bytes.capacity + base + index + 64, "{format:?}: {bytes:?}");
                assert!(share > 3 || bytes.buffer < whole, "{bytes:?} of {whole}");
                // SAFETY: the buffer is alive.
                let taken = unsafe { device.get_buffer_memory_requirements(gpu.base_pose().buffer) }.size;
                assert!(taken >= bytes.buffer && taken <= bytes.buffer + 256, "{taken}: {bytes:?}");
                let mut load: Vec<usize> = vec![];
                let mut free = bytes.free();
                for target in 0..TARGETS {
                    if mesh.target_bytes(target) <= free {
                        free -= mesh.target_bytes(target);
                        load.push(target);
                    }
                }
                swap(headless, &mut gpu, &mesh, &load, &[]);
                assert_eq!(gpu.residency().expect("as above").free(), free);
                assert!((0..TARGETS).all(|target| gpu.is_resident(target) == load.contains(&target)));
                assert_eq!(swap(headless, &mut gpu, &mesh, &load, &[]), 0, "they are there");
                assert_eq!(swap(headless, &mut gpu, &mesh, &[], &load), 0, "what goes is not copied");
                assert_eq!(gpu.residency().expect("as above").used, 0);
            }
        }
    });
}

#[test]
fn the_mesh_may_go_while_its_swap_is_in_flight() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, DeltaFormat::Small, true);
        let gpu = upload(headless, &mesh, Some(all_bytes(&mesh)));
        let copies = headless.run(|cmd| {
            let mut gpu = gpu;
            let swap = TargetSwap::default().load(&[1, 5, 9]);
            // SAFETY: `run` waits, and the copies are dropped after that.
            unsafe { engine.record_swap(cmd, &mut gpu, &mesh, &swap) }
        });
        assert!(copies.expect("a swap").bytes() > 0);
    });
}

/// Meshes without targets, of targets that move nothing, of one vertex.
#[test]
fn meshes_of_next_to_nothing_come_and_go() {
    on_every_device(|headless, engine| {
        for (mesh, format) in testing::degenerate().iter().flat_map(|m| DeltaFormat::BLOCKS.map(|f| (m, f))) {
            let mesh = gpu::packed(engine, mesh, format);
            let targets: Vec<usize> = (0..mesh.layout().targets.len()).collect();
            let bytes = targets.iter().map(|&target| mesh.target_bytes(target)).sum();
            let (mut gpu, whole) = (upload(headless, &mesh, Some(bytes)), upload(headless, &mesh, None));
            for update in updates(format) {
                let desc = CrowdDesc::new(update).instances(3);
                let mut crowds = [&gpu, &whole].map(|gpu| engine.create_crowd(gpu, &desc).expect("a crowd"));
                let mut readbacks = [engine.readback(), engine.readback()];
                for weight in [0.0, 1.0, 0.0] {
                    swap(headless, &mut gpu, &mesh, &targets, &[]);
                    let weights = vec![weight; targets.len()];
                    for (crowd, readback) in crowds.iter_mut().zip(&mut readbacks) {
                        crowd.set_weights(1, &weights).expect("all are there");
                        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
                        let ran = headless.run(|cmd| unsafe {
                            engine.record_update(cmd, crowd)?;
                            readback.record(cmd, crowd, &[1])
                        });
                        ran.expect("an update");
                    }
                    assert_same(&mesh, &update, &mut readbacks, &[weights]);
                }
                swap(headless, &mut gpu, &mesh, &[], &targets);
                assert_eq!(gpu.residency().expect("of swapped targets").used, 0);
            }
        }
    });
}
