//! What is refused of targets that come to the device and go: by name, with nothing changed; and swaps that never run.

use crate::gpu::{self, fixed, is_kept, on_every_device};
use crate::resident::{TARGETS, all_bytes, assert_same, packed, refused, swap, update, upload};
use deltamorph::reference::compare;
use deltamorph::{
    AnimationDesc, Crowd, CrowdDesc, CrowdSet, DeltaFormat, GpuMesh, PackedMesh, PoseFormat, PoseReadback, TargetSwap,
    UpdateDesc, WeightClip,
};
use deltamorph_headless::{DeviceChoice, Headless, HeadlessDesc};

#[test]
fn what_is_not_there_is_refused_by_name_and_the_crowd_goes_on() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, DeltaFormat::Small, false);
        let name = |target: usize| format!("target {target} ('{}')", mesh.layout().targets[target].name);
        let mut gpu = upload(headless, &mesh, Some(all_bytes(&mesh)));
        let desc = CrowdDesc::new(fixed()[0]).instances(2);
        let crowd = |gpu: &GpuMesh| engine.create_crowd(gpu, &desc).expect("a crowd");
        let mut one = crowd(&gpu);
        let mut two = crowd(&gpu);
        swap(headless, &mut gpu, &mesh, &[5, 6, 7], &[]);
        // Every setter.
        let mut weights = vec![0.0; TARGETS];
        weights[9] = 0.25;
        refused(one.set_weights(0, &weights), &format!("a weight of {}", name(9)));
        refused(one.set_weight(1, 9, 0.25), &name(9));
        refused(one.set_weight_by_name(1, &mesh.layout().targets[9].name, 0.25), "which is not on the device; load it");
        let mut set = CrowdSet::new(vec![crowd(&gpu), crowd(&gpu)]).expect("a set");
        refused(set.set_weights(1, &weights), &name(9));
        assert!(one.weights(0).expect("weights").iter().all(|weight| *weight == 0.0), "nothing changed");
        // Poses hold what was applied, whichever crowd's, until it is taken back.
        one.set_weight(1, 5, 0.5).expect("it is there");
        two.set_weight(0, 5, 0.5).expect("it is there");
        let record = |gpu: &mut GpuMesh, load: &[usize], unload: &[usize]| {
            let swap = TargetSwap::default().load(load).unload(unload);
            // SAFETY: `run` waits.
            headless.run(|cmd| unsafe { engine.record_swap(cmd, gpu, &mesh, &swap) }).map(drop)
        };
        update(headless, &mut one);
        update(headless, &mut two);
        refused(record(&mut gpu, &[], &[6, 5]), &format!("{} of mesh", name(5)));
        assert!(gpu.is_resident(6), "nothing changed");
        one.set_hidden(1, true).expect("an instance");
        update(headless, &mut one);
        drop(two);
        refused(record(&mut gpu, &[], &[5]), "poses of 1 crowds hold it");
        one.set_hidden(1, false).expect("an instance");
        one.set_weight(1, 5, 0.0).expect("a weight");
        refused(record(&mut gpu, &[], &[5]), "hold it");
        update(headless, &mut one);
        one.set_weight(0, 6, 0.5).expect("it is there");
        one.set_weight(0, 7, 0.5).expect("it is there");
        record(&mut gpu, &[], &[5, 6, 7]).expect("nobody holds them: the weights were not applied");
        // The update says so before it records anything, and the pose there is stays.
        let pose = one.pose(0).expect("a pose");
        // SAFETY: `run` waits.
        refused(headless.run(|cmd| unsafe { engine.record_update(cmd, &mut one) }), &name(6));
        assert_eq!(one.pose(0).expect("a pose"), pose);
        one.set_weight(0, 6, 0.0).expect("0 is taken whatever the others are");
        one.set_weight(0, 7, 0.0).expect("so it is");
        update(headless, &mut one);
        // A removed instance holds nothing from the next update on.
        record(&mut gpu, &[5], &[]).expect("room");
        one.set_weight(1, 5, 1.0).expect("it is there");
        update(headless, &mut one);
        one.remove(1).expect("an instance");
        update(headless, &mut one);
        record(&mut gpu, &[], &[5]).expect("nobody holds it");
        let mut readback = engine.readback();
        // SAFETY: `run` waits.
        headless.run(|cmd| unsafe { readback.record(cmd, &one, &[0]) }).expect("a read-back");
        // SAFETY: as above.
        let poses = unsafe { readback.poses() }.expect("poses");
        let error = compare(&poses[0].vertices, &gpu::reference(&mesh, &fixed()[0], &[0.0; TARGETS]));
        assert!(is_kept(&error, mesh.layout().diagonal), "{error:?}");
    });
}

#[test]
fn swaps_that_cannot_be_are_refused_and_change_nothing() {
    on_every_device(|headless, engine| {
        let format = DeltaFormat::Fast;
        let mesh = packed(engine, format, false);
        let largest = (0..TARGETS).map(|target| mesh.target_bytes(target)).max().expect("targets");
        let upload_of = |mesh: &PackedMesh, bytes: u64| {
            // SAFETY: `run` waits.
            headless.run(|cmd| unsafe { engine.upload_resident(cmd, mesh, bytes) })
        };
        let dense = packed(engine, DeltaFormat::Snorm16, false);
        refused(upload_of(&dense, 1 << 20), "in the dense format 'snorm16'");
        refused(upload_of(&mesh, largest - 1), &format!("takes {largest}; allow as many"));
        let mut whole = upload(headless, &mesh, None);
        assert!(whole.residency().is_none() && whole.is_resident(TARGETS - 1) && !whole.is_resident(TARGETS));
        let mut gpu = upload(headless, &mesh, Some(largest));
        let record = |gpu: &mut GpuMesh, source: &PackedMesh, load: &[usize], unload: &[usize]| {
            let swap = TargetSwap::default().load(load).unload(unload);
            // SAFETY: `run` waits.
            headless.run(|cmd| unsafe { engine.record_swap(cmd, gpu, source, &swap) })
        };
        refused(record(&mut whole, &mesh, &[1], &[]), "which was uploaded as a whole");
        let other = packed(engine, DeltaFormat::Small, false);
        refused(record(&mut gpu, &other, &[1], &[]), "which differs");
        refused(record(&mut gpu, &mesh, &[TARGETS], &[]), "target 37 of mesh");
        refused(record(&mut gpu, &mesh, &[], &[TARGETS]), "target 37 of mesh");
        refused(record(&mut gpu, &mesh, &[1, 2], &[2]), "is to come and to go");
        let all: Vec<usize> = (0..TARGETS).collect();
        refused(record(&mut gpu, &mesh, &all, &[]), &format!("which has {largest} bytes free"));
        assert_eq!(gpu.residency().expect("of swapped targets").used, 0);
        // The same mesh, packed again.
        drop(record(&mut gpu, &packed(engine, format, false), &[1, 1], &[]).expect("the same mesh"));
        assert_eq!(gpu.residency().expect("as above").used, mesh.target_bytes(1));
        let another = upload(headless, &mesh, Some(largest));
        let stray = {
            let mut another = another;
            record(&mut another, &mesh, &[1], &[]).expect("a swap")
        };
        refused(gpu.discard_swap(stray), "a swap of another mesh");
        // Crowds that are animated there.
        let names = mesh.layout().targets.iter().map(|target| target.name.clone()).collect();
        let clip = WeightClip { name: "still".into(), names, fps: 30.0, values: vec![0.0; TARGETS] };
        let (desc, clips) = (CrowdDesc::new(fixed()[0]), [clip]);
        // SAFETY: `run` waits.
        let animated =
            headless.run(|cmd| unsafe { engine.create_animated_crowd(cmd, &gpu, &desc, &AnimationDesc::new(&clips)) });
        refused(animated, "whose targets come and go, in a crowd animated on the GPU");
        // Another engine on the same driver.
        let driver = headless.caps().name.clone();
        let foreign = Headless::new(&HeadlessDesc::default().device(DeviceChoice::Name(driver))).expect("a device");
        let swap = TargetSwap::default();
        // SAFETY: refused before anything is recorded.
        let recorded = foreign.run(|cmd| unsafe { foreign.engine().record_swap(cmd, &mut gpu, &mesh, &swap) });
        refused(recorded, "belongs to another MorphEngine");
    });
    // More than a descriptor reaches.
    let limits = gpu::baseline(|caps| caps.max_storage_range = 120_000);
    for driver in gpu::drivers() {
        gpu::on_device_within(&driver, Some(limits.clone()), |headless, engine| {
            let mesh = packed(engine, DeltaFormat::BlockFloat32, false);
            // SAFETY: `run` waits.
            let uploaded = headless.run(|cmd| unsafe { engine.upload_resident(cmd, &mesh, 200_000) });
            refused(uploaded, "allows 120000; allow fewer bytes, or split the mesh");
        });
    }
}

#[test]
fn a_swap_that_never_runs_is_made_up_for() {
    on_every_device(|headless, engine| {
        for format in [DeltaFormat::Small, DeltaFormat::Pair] {
            let mesh = packed(engine, format, false);
            let (mut gpu, whole) = (upload(headless, &mesh, Some(all_bytes(&mesh))), upload(headless, &mesh, None));
            swap(headless, &mut gpu, &mesh, &[1, 2], &[]);
            let update = fixed()[1];
            let desc = CrowdDesc::new(update);
            let mut crowds = [&gpu, &whole].map(|gpu| engine.create_crowd(gpu, &desc).expect("a crowd"));
            let mut readbacks = [engine.readback(), engine.readback()];
            let mut weights = vec![0.0; TARGETS];
            weights[1] = 0.5;
            let step = |crowds: &mut [Crowd; 2], readbacks: &mut [PoseReadback; 2], weights: &[f32]| {
                headless.run(|cmd| {
                    for (crowd, readback) in crowds.iter_mut().zip(readbacks) {
                        crowd.set_weights(0, weights)?;
                        // SAFETY: `run` waits.
                        unsafe {
                            engine.record_update(cmd, crowd)?;
                            readback.record(cmd, crowd, &[0])?;
                        }
                    }
                    Ok(())
                })
            };
            step(&mut crowds, &mut readbacks, &weights).expect("a step");
            // Recorded into a buffer that is not submitted: `run` gives up after an error.
            let (mut lost, mut ticket) = (None, None);
            let given_up = headless.run(|cmd| {
                let swap = TargetSwap::default().load(&[3]).unload(&[2]);
                // SAFETY: the buffer never runs.
                unsafe {
                    lost = Some(engine.record_swap(cmd, &mut gpu, &mesh, &swap)?);
                    crowds[0].set_weight(0, 3, 1.0)?;
                    ticket = Some(engine.record_update(cmd, &mut crowds[0])?.ticket);
                }
                crowds[0].set_weight(9, 0, 0.0)
            });
            assert!(given_up.is_err());
            crowds[0].discard(ticket.expect("an update")).expect("a ticket of this crowd");
            gpu.discard_swap(lost.expect("a swap")).expect("a swap of this mesh");
            assert!(!gpu.is_resident(3) && !gpu.is_resident(2) && gpu.is_resident(1));
            refused(step(&mut crowds, &mut readbacks, &weights), "whose copies never ran; record a swap");
            assert!(swap(headless, &mut gpu, &mesh, &[], &[]) >= mesh.target_bytes(3), "it is copied again");
            (weights[3], weights[1]) = (0.25, 0.0);
            step(&mut crowds, &mut readbacks, &weights).expect("a step");
            assert_same(&mesh, &update, &mut readbacks, &[weights]);
        }
    });
}

/// What an error budget defers is held, too; and crowds that grow take over what is requested alone.
#[test]
fn what_a_budget_defers_is_held_until_it_is_settled() {
    on_every_device(|headless, engine| {
        let mesh = packed(engine, DeltaFormat::Small, false);
        let (mut gpu, whole) = (upload(headless, &mesh, Some(all_bytes(&mesh))), upload(headless, &mesh, None));
        swap(headless, &mut gpu, &mesh, &[1, 2], &[]);
        let error_budget = mesh.layout().diagonal;
        let settings = UpdateDesc::blocks().error_budget(error_budget).pose(PoseFormat::Fixed32);
        let desc = CrowdDesc::new(settings);
        let mut crowds = [&gpu, &whole].map(|gpu| engine.create_crowd(gpu, &desc).expect("a crowd"));
        for weight in [1.0, 1.0, 0.0] {
            for crowd in &mut crowds {
                crowd.set_weight(0, 1, weight).expect("it is there");
                update(headless, crowd);
            }
        }
        let record = |gpu: &mut GpuMesh| {
            let swap = TargetSwap::default().unload(&[1]);
            // SAFETY: `run` waits.
            headless.run(|cmd| unsafe { engine.record_swap(cmd, gpu, &mesh, &swap) }).map(drop)
        };
        refused(record(&mut gpu), "hold it; record an update with its weight at 0");
        crowds.iter_mut().for_each(|crowd| update(headless, crowd));
        record(&mut gpu).expect("it is settled");
        for crowd in &mut crowds {
            crowd.set_weight(0, 2, 0.5).expect("it is there");
            drop(engine.grow_crowd(crowd, &desc.instances(3)).expect("grown"));
            update(headless, crowd);
        }
        let mut readbacks = [engine.readback(), engine.readback()];
        for (crowd, readback) in crowds.iter().zip(&mut readbacks) {
            // SAFETY: `run` waits.
            headless.run(|cmd| unsafe { readback.record(cmd, crowd, &[0]) }).expect("a read-back");
        }
        let mut weights = vec![0.0; TARGETS];
        weights[2] = 0.5;
        assert_same(&mesh, &settings, &mut readbacks, &[weights]);
        let mut away = crowds[0].weights(0).expect("weights").to_vec();
        away[1] = 0.5;
        refused(crowds[0].set_weights(0, &away), "which is not on the device");
    });
}
