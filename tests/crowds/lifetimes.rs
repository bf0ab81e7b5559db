//! Objects of host and engine that refer to each other are dropped in any order that compiles.

use crate::gpu::packed;
use crate::host::Host;
use crate::prelude::*;
use std::any::Any;

/// Returns every order of `things` items.
fn orders(things: usize) -> Vec<Vec<usize>> {
    let longer = |order: &Vec<usize>| {
        let order = order.clone();
        (0..=order.len()).map(move |at| [&order[..at], &[order.len()], &order[at..]].concat()).collect::<Vec<_>>()
    };
    (0..things).fold(vec![vec![]], |orders, _| orders.iter().flat_map(longer).collect())
}

#[test]
fn engine_mesh_crowds_allocator_and_device_are_dropped_in_any_order() {
    let test = |headless: &Headless, engine: &MorphEngine| {
        let (instance, physical, _) = headless.handles();
        let mesh = packed(engine, &testing::mesh(64, 3), DeltaFormat::Snorm16);
        // One pipeline, since drivers spend most of this test's time making them.
        let desc = CrowdDesc::new(UpdateDesc::new(UpdatePath::Compute, BatchSize::All));
        // With the host's allocator, then with the engine's own.
        for (shares, things) in [(true, 5), (false, 4)] {
            for order in orders(things) {
                let host = Host::new(headless);
                let gone = Arc::downgrade(&host);
                let device =
                    DeviceDesc { owner: Some(host.clone()), ..DeviceDesc::new(instance, physical, &host.device) };
                let allocator = shares.then(|| host.allocator(headless));
                // SAFETY: the handles belong together, and live as long as `host`.
                let engine = unsafe { MorphEngine::new(&DeviceDesc { allocator: allocator.clone(), ..device }) }
                    .expect("an engine");
                // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
                let mut uploaded = host.run(|cmd| unsafe { engine.upload(cmd, &mesh) }).expect("an upload");
                let crowd = engine.create_crowd(&uploaded, &desc).expect("a crowd");
                if order[0] == 0 {
                    // In all other orders the staging memory goes with the mesh.
                    uploaded.release_staging();
                }
                let mut all: [Option<Box<dyn Any>>; 5] = [
                    Some(Box::new(host)),
                    Some(Box::new(engine)),
                    Some(Box::new(uploaded)),
                    Some(Box::new(crowd)),
                    allocator.map(|allocator| Box::new(allocator) as Box<dyn Any>),
                ];
                for (left, thing) in (0..things).rev().zip(order) {
                    assert!(gone.upgrade().is_some(), "somebody needs the device");
                    drop(all[thing].take());
                    assert_eq!(gone.upgrade().is_none(), left == 0, "the last of them lets it go");
                }
            }
        }
    };
    drivers().iter().for_each(|driver| on_device(driver, false, test));
}

/// The layers list the names of objects left when the device is destroyed: all objects of a crowd and its mesh, unless
/// their names are contained in others.
#[test]
fn what_the_engine_makes_has_names_where_the_host_wants_them() {
    for driver in drivers() {
        for named in [true, false] {
            let headless = gpu::device(&driver, true, None);
            let host = Host::new(&headless);
            let (instance, physical, _) = headless.handles();
            let device = DeviceDesc { debug_names: named, ..DeviceDesc::new(instance, physical, &host.device) };
            // SAFETY: the handles belong together; nothing is used or dropped after the device.
            let engine = unsafe { MorphEngine::new(&device) }.expect("an engine");
            let mesh = packed(&engine, &testing::mesh(64, 3), DeltaFormat::Small);
            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
            let uploaded = host.run(|cmd| unsafe { engine.upload(cmd, &mesh) }).expect("an upload");
            let crowd = engine.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
            std::mem::forget((engine, uploaded, crowd));
            drop(host);
            let messages = headless.messages().join("\n");
            let mesh = mesh.layout().name.clone();
            for kind in [
                format!("VkBuffer|deltamorph deltas of mesh '{mesh}'"),
                format!("VkBuffer|deltamorph upload of mesh '{mesh}'"),
                "VkBuffer|deltamorph poses".into(),
                "VkBuffer|deltamorph work lists".into(),
                "VkPipeline|deltamorph crowd_small".into(),
                "VkDescriptorSet|deltamorph crowd, set 0".into(),
            ] {
                let (kind, name) = kind.split_once('|').expect("a kind and a name");
                let found = messages.lines().any(|line| line.contains(kind) && line.contains(name));
                assert_eq!(found, named, "{kind} '{name}' in\n{messages}");
            }
            assert!(messages.contains("has not been destroyed"), "{messages}");
        }
    }
}
