//! Two engines on one device, with one allocator, each used by two threads at once: uploads, crowds made and dropped,
//! updates recorded, poses read back. tests/tsan runs it under ThreadSanitizer.

use crate::gpu::{self, NORMAL, is_kept, packed, reference, weights};
use crate::host::Host;
use crate::testing;
use deltamorph::reference::compare;
use deltamorph::{CrowdDesc, DeltaFormat, DeviceDesc, GpuMesh, MorphEngine, PackedMesh, UpdateDesc};
use std::sync::Arc;

const ROUNDS: u32 = 12;
/// Threads per engine.
const RECORDERS: u32 = 2;

/// Makes a crowd, runs a few updates, and checks its poses.
fn animate(
    host: &Host,
    engine: &MorphEngine,
    (uploaded, mesh): (&GpuMesh, &PackedMesh),
    update: UpdateDesc,
    seed: u32,
) {
    let desc = CrowdDesc { instances: 2, ..CrowdDesc::new(update) };
    let (mut crowd, mut readback) = (engine.create_crowd(uploaded, &desc).expect("a crowd"), engine.readback());
    for frame in 0..3 {
        let asked = [seed, seed + 1].map(|seed| weights(mesh, frame, seed));
        (0..).zip(&asked).for_each(|(i, weights)| crowd.set_weights(i, weights).expect("weights"));
        let ran = host.run(|cmd| {
            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
            unsafe {
                let _ = engine.record_update(cmd, &mut crowd)?;
                readback.record(cmd, &crowd, &[0, 1])
            }
        });
        ran.expect("an update");
        // SAFETY: `run` has waited.
        for (pose, asked) in unsafe { readback.poses() }.expect("poses").iter().zip(asked) {
            let error = compare(&pose.vertices, &reference(mesh, &update, &asked));
            let kept = is_kept(&error, mesh.layout().diagonal) || error.within(f64::from(update.tolerance), NORMAL);
            assert!(kept, "{update:?}: {error:?}");
        }
    }
}

#[test]
fn threads_share_an_allocator_engines_and_meshes() {
    for driver in gpu::drivers() {
        // Validation layers are not instrumented, so their locks are invisible.
        let validation = std::env::var_os("TSAN_OPTIONS").is_none();
        let headless = gpu::device(&driver, validation, None);
        let host = Host::new(&headless);
        let (instance, physical, _) = headless.handles();
        let allocator = host.allocator(&headless);
        let engines = [0, 1].map(|_| {
            let device = DeviceDesc { owner: Some(host.clone()), ..DeviceDesc::new(instance, physical, &host.device) };
            // SAFETY: the handles belong together, and live as long as `host`.
            unsafe { MorphEngine::new(&DeviceDesc { allocator: Some(allocator.clone()), ..device }) }
                .expect("an engine")
        });
        let source = testing::mesh(150, 9);
        let mesh = packed(&engines[0], &source, DeltaFormat::Small);
        std::thread::scope(|scope| {
            for (e, engine) in (0..).zip(&engines) {
                let (host, mesh, source) = (&host, &mesh, &source);
                let shared = Arc::new(host.upload(engine, mesh));
                for recorder in 0..RECORDERS {
                    let shared = shared.clone();
                    scope.spawn(move || {
                        for round in 0..ROUNDS {
                            let seed = round + ROUNDS * (recorder + RECORDERS * e);
                            // The first thread finds out which pipelines exist.
                            let update = [
                                gpu::fixed()[0],
                                gpu::fixed()[1],
                                UpdateDesc { tolerance: 1e-2, ..UpdateDesc::blocks() },
                            ];
                            animate(host, engine, (&shared, mesh), update[round as usize % 3], seed);
                            let own = packed(engine, source, DeltaFormat::Fast);
                            animate(host, engine, (&host.upload(engine, &own), &own), update[seed as usize % 3], seed);
                            assert!(engine.memory().allocated > 0);
                        }
                    });
                }
            }
        });
        drop((engines, allocator, host));
        assert_eq!(gpu::complaints(&headless), Vec::<String>::new());
    }
}
