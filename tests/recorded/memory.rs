//! Memory of the engine, by what it is for, and from functions of the host's.

use crate::gpu::weights;
use crate::prelude::*;
use deltamorph::memory::{HostMemory, MemoryRequest, MemorySource};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicU32, Ordering};

#[test]
fn memory_is_counted_by_what_it_is_for_and_given_back() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(320, 7), DeltaFormat::Fast);
        for (pose, bytes) in [(PoseFormat::Float32, 24), (PoseFormat::Fixed32, 24), (PoseFormat::Fixed16, 12)] {
            let before = engine.memory();
            let desc = CrowdDesc::new(UpdateDesc { pose, ..UpdateDesc::blocks() });
            let desc = CrowdDesc { instances: 100, ..desc };
            assert_eq!(Crowd::pose_bytes(&mesh, &desc), 100 * 2 * 320 * bytes, "two slots");
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
            crowd.step(&[&[0.5; 7]]).expect("a step");
            let memory = engine.memory();
            for (what, used, least) in [
                ("meshes", memory.meshes, MorphEngine::mesh_bytes(&mesh)),
                ("poses", memory.poses, Crowd::pose_bytes(&mesh, &desc)),
                ("lists", memory.lists, 256),
            ] {
                // The rest grows with the blocks of the instances.
                assert!((least..least + 262_144).contains(&used.bytes), "{what}: {used:?}, at least {least}");
                assert!(used.allocations > 0, "{what}: {used:?}");
            }
            assert_eq!((memory.staging.bytes, memory.animation.bytes), (0, 0), "released, and not there");
            assert!(memory.allocated >= memory.meshes.bytes + memory.poses.bytes + memory.lists.bytes);
            drop(crowd);
            assert_eq!(engine.memory(), before);
        }
    });
}

/// Memory of its own for each request, as the tokens tell; none after the first `most`.
struct Source {
    device: ash::Device,
    memories: vk::PhysicalDeviceMemoryProperties,
    most: AtomicU32,
    live: AtomicU32,
    maps: bool,
}

/// Offset of what is handed out, a multiple of any alignment of these drivers.
const LEAD: u64 = 4096;

// SAFETY: each memory is allocated for its request, and is the request's alone.
unsafe impl MemorySource for Source {
    fn allocate(&self, request: &MemoryRequest) -> Result<HostMemory, vk::Result> {
        let most = self.most.fetch_sub(1, Ordering::Relaxed);
        if most == 0 {
            return Err(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
        }
        assert!(LEAD.is_multiple_of(request.alignment) && request.size > 0, "{request:?}");
        let fits = |wanted| {
            (0..self.memories.memory_type_count).find(|&index| {
                let has = self.memories.memory_types[index as usize].property_flags;
                request.type_bits >> index & 1 != 0 && has.contains(wanted)
            })
        };
        let index = fits(request.required | request.preferred).or_else(|| fits(request.required)).expect("a type");
        let info = vk::MemoryAllocateInfo::default().allocation_size(LEAD + request.size).memory_type_index(index);
        // SAFETY: the device is alive; what is mapped is freed as a whole.
        unsafe {
            let memory = self.device.allocate_memory(&info, None)?;
            let is_mapped = self.maps && !request.required.is_empty();
            let map = || self.device.map_memory(memory, LEAD, request.size, vk::MemoryMapFlags::empty());
            let mapped = if is_mapped { map()? } else { null_mut() };
            self.live.fetch_add(1, Ordering::Relaxed);
            Ok(HostMemory { offset: LEAD, mapped, token: most.into(), ..HostMemory::new(memory) })
        }
    }

    fn free(&self, memory: HostMemory) {
        assert!(memory.offset == LEAD && memory.token > 0);
        self.live.fetch_sub(1, Ordering::Relaxed);
        // SAFETY: allocated above, and freed once.
        unsafe { self.device.free_memory(memory.memory, None) };
    }
}

#[test]
fn the_host_allocates_and_frees_what_the_engine_takes() {
    for driver in drivers() {
        on_device(&driver, false, |headless, _| {
            let (instance, physical, device) = headless.handles();
            // SAFETY: the physical device is the instance's.
            let memories = unsafe { instance.get_physical_device_memory_properties(physical) };
            let source = |most, maps| {
                let (most, live) = (AtomicU32::new(most), AtomicU32::new(0));
                Arc::new(Source { device: device.clone(), memories, most, live, maps })
            };
            let engine = |source: &Arc<Source>| {
                let desc = DeviceDesc { memory: Some(source.clone()), ..DeviceDesc::new(instance, physical, device) };
                // SAFETY: the handles belong together, and outlive the engine.
                unsafe { MorphEngine::new(&desc) }.expect("an engine")
            };
            let all = source(1000, true);
            let own = engine(&all);
            let mesh = gpu::packed(&own, &testing::mesh(300, 7), DeltaFormat::Fast);
            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
            let upload = |engine: &MorphEngine| headless.run(|cmd| unsafe { engine.upload(cmd, &mesh) });
            let mut uploaded = upload(&own).expect("an upload");
            uploaded.release_staging();
            let mut crowd = own.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
            let mut readback = own.readback();
            for frame in 0..3 {
                let asked = weights(&mesh, frame, 9);
                crowd.set_weights(0, &asked).expect("weights");
                let ran = headless.run(|cmd| {
                    // SAFETY: as above.
                    unsafe { own.record_update(cmd, &mut crowd).and_then(|_| readback.record(cmd, &crowd, &[0])) }
                });
                ran.expect("an update");
                // SAFETY: `run` has waited.
                let poses = unsafe { readback.poses() }.expect("a pose");
                let error = compare(&poses[0].vertices, &evaluate(&mesh, &asked));
                assert!(gpu::is_kept(&error, mesh.layout().diagonal), "{driver}: {error:?}");
            }
            let memory = own.memory();
            let kinds = [memory.meshes, memory.poses, memory.lists, memory.readback];
            assert_eq!(
                kinds.map(|used| used.allocations).iter().sum::<u64>(),
                u64::from(all.live.load(Ordering::Relaxed))
            );
            assert_eq!(kinds.map(|used| used.bytes).iter().sum::<u64>(), memory.allocated);
            drop((crowd, uploaded, readback));
            assert_eq!((all.live.load(Ordering::Relaxed), own.memory().allocated), (0, 0), "all of it is given back");

            let unmapped = source(1000, false);
            testing::says(upload(&engine(&unmapped)).map(drop), &["is not mapped", "HOST_VISIBLE"]);
            let none = source(1, true);
            let error = upload(&engine(&none)).map(drop).expect_err("no memory");
            assert!(matches!(error, Error::OutOfMemory { .. }), "{error}");
            assert_eq!([unmapped, none].map(|source| source.live.load(Ordering::Relaxed)), [0, 0]);
        });
    }
}
