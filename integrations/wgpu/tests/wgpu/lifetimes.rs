//! In any order of drops, nothing in use is destroyed, and nothing leaks.

use crate::common::{Host, assert_right, change, copy, decoded, on_every_adapter, uploaded, wait};
use deltamorph::{CrowdDesc, DeltaFormat, UpdateDesc};
use deltamorph_head::Rng;
use deltamorph_wgpu::{Crowd, Mesh, Morph, Pose};
use std::any::Any;

#[test]
fn everything_may_be_shared_between_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<Morph>();
    shared::<Mesh>();
    shared::<Crowd>();
}

#[test]
fn everything_may_be_dropped_in_any_order_while_the_gpu_works() {
    for round in 0..12 {
        on_every_adapter(|host| {
            let mut things = in_use(&host);
            let Host { device, queue, .. } = host;
            things.extend([Box::new(device) as Box<dyn Any>, Box::new(queue)]);
            let mut rng = Rng::new(round, 0);
            while !things.is_empty() {
                drop(things.swap_remove(rng.below(things.len())));
            }
        });
    }
}

#[test]
fn a_buffer_keeps_its_poses() {
    on_every_adapter(|host| {
        let (morph, mesh, uploaded, mut weights) = uploaded(&host, DeltaFormat::Fast);
        let mut crowd = morph.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
        change(&mut Rng::new(1, 0), &mut weights);
        crowd.set_weights(0, &weights).expect("weights");
        host.queue.submit(morph.update([&mut crowd]).expect("an update"));
        let pose = crowd.pose(0).expect("a pose");
        let (buffer, view) = (pose.buffer.clone(), pose.view);
        wait(&host);
        drop((crowd, uploaded, morph));
        let mut encoder = host.device.create_command_encoder(&Default::default());
        let copy = copy(&host, &mut encoder, &Pose { buffer: &buffer, view });
        host.queue.submit([encoder.finish()]);
        let pose = decoded(&host.read(&copy), &view);
        assert_right(&pose, &mesh, &weights, view.format, "after the crowd");
    });
}

/// wgpu lets shaders and copies read whole buffers: they must not show memory of an earlier crowd.
#[test]
fn slots_that_no_update_has_written_are_zeros() {
    on_every_adapter(|host| {
        let (morph, _, uploaded, mut weights) = uploaded(&host, DeltaFormat::Fast);
        for updates in [3, 1] {
            let desc = CrowdDesc::new(UpdateDesc { slots: 3, ..UpdateDesc::blocks() });
            let mut crowd = morph.create_crowd(&uploaded, &desc).expect("a crowd");
            for _ in 0..updates {
                change(&mut Rng::new(1, 0), &mut weights);
                weights[0] += 0.125;
                crowd.set_weights(0, &weights).expect("weights");
                host.queue.submit(morph.update([&mut crowd]).expect("an update"));
            }
            let pose = crowd.pose(0).expect("a pose");
            let (all, size) = (host.readback(pose.buffer.size()), pose.view.size as usize);
            let mut encoder = host.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(pose.buffer, 0, &all, 0, pose.buffer.size());
            host.queue.submit([encoder.finish()]);
            let bytes = host.read(&all);
            let written = bytes.chunks(size).filter(|slot| slot.iter().any(|byte| *byte != 0)).count();
            assert_eq!(written, updates, "slots that are not zero");
            drop(crowd);
            wait(&host);
        }
    });
}

/// Makes one of each object, with updates and draws, some submitted and some not.
fn in_use(host: &Host) -> Vec<Box<dyn Any>> {
    let (morph, _, uploaded, mut weights) = uploaded(host, DeltaFormat::Fast);
    let mut crowd = morph.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
    let fresh = morph.create_crowd(&uploaded, crowd.desc()).expect("a crowd");
    let mut things: Vec<Box<dyn Any>> = vec![Box::new(fresh)];
    for submitted in [true, false] {
        change(&mut Rng::new(1, 0), &mut weights);
        weights[0] += 0.25;
        crowd.set_weights(0, &weights).expect("weights");
        let update = morph.update([&mut crowd]).expect("an update").expect("a change");
        let mut encoder = host.device.create_command_encoder(&Default::default());
        things.push(Box::new(copy(host, &mut encoder, &crowd.pose(0).expect("a pose"))));
        match submitted {
            true => drop(host.queue.submit([update, encoder.finish()])),
            false => things.extend([Box::new(update) as Box<dyn Any>, Box::new(encoder.finish())]),
        }
    }
    things.push(Box::new(crowd.pose(0).expect("a pose").buffer.clone()));
    things.extend([Box::new(crowd) as Box<dyn Any>, Box::new(uploaded), Box::new(morph)]);
    things
}
