//! The limits of weak devices, on real drivers: an engine with these limits keeps to them in every call, which wrappers
//! of the driver's functions check; its poses match the float64 reference, and its steps run.

use crate::gpu::baseline;
use crate::prelude::*;
use crate::written::Written;
use std::ffi::{CStr, c_void};
use std::sync::{Mutex, MutexGuard};

/// Largest alignment of storage-buffer offsets on phones (`minStorageBufferOffsetAlignment`).
const ALIGNMENT: u64 = 256;
/// Most allocations alive at a time; Vulkan guarantees 4,096 (`maxMemoryAllocationCount`), which the host needs, too.
const ALLOCATIONS: usize = 48;

/// Limits, by source.
fn clamps() -> [(&'static str, DeviceCaps); 4] {
    [
        // They agree on the checked limits.
        ("VP_ANDROID_baseline_2021 and _2022", baseline(|_| {})),
        (
            "VP_ANDROID_vulkan_profile_2025",
            baseline(|caps| (caps.max_storage_buffers, caps.max_workgroup_invocations) = (35, 256)),
        ),
        ("allocations of 64 MiB", baseline(|caps| (caps.max_allocation, caps.max_buffer) = (64 << 20, 64 << 20))),
        // As small for this head as the others are for a large one: dense deltas are split into chunks.
        (
            "small",
            baseline(|caps| {
                (caps.max_storage_range, caps.max_workgroups) = (160 << 10, 50);
                (caps.max_allocation, caps.max_buffer) = (1 << 20, 1 << 20);
            }),
        ),
    ]
}

/// The device whose calls are checked, and their limits.
struct Watched {
    device: ash::Device,
    limits: DeviceCaps,
    alive: usize,
    most_alive: usize,
    calls: usize,
    broken: Vec<String>,
}

static WATCHED: Mutex<Option<Watched>> = Mutex::new(None);

/// Checks a call with `is_kept`; returns the device to call.
fn look(call: &str, is_kept: impl FnOnce(&mut Watched) -> bool) -> ash::Device {
    let mut watched: MutexGuard<'_, Option<Watched>> = WATCHED.lock().expect("no panic meanwhile");
    let watched = watched.as_mut().expect("a device");
    watched.calls += 1;
    if !is_kept(watched) {
        watched.broken.push(call.to_owned());
    }
    watched.device.clone()
}

const BUFFERS: [vk::DescriptorType; 2] =
    [vk::DescriptorType::STORAGE_BUFFER, vk::DescriptorType::STORAGE_BUFFER_DYNAMIC];

type Callbacks = *const vk::AllocationCallbacks<'static>;

/// Defines wrappers of the driver's functions: a check of the call, and the function that then gets it unchanged.
macro_rules! in_front {
    ($(fn $name:ident($($of:ident: $type:ty),* $(,)?) $(-> $result:ty)? $look:block => $driver:ident;)*) => {$(
        unsafe extern "system" fn $name($($of: $type),*) $(-> $result)? {
            // SAFETY: the caller's obligations are those of the driver's function.
            #[allow(unused_unsafe, reason = "some look at numbers alone")]
            let next = unsafe { $look };
            // SAFETY: as above.
            unsafe { (next.fp_v1_0().$driver)($($of),*) }
        }
    )*};
}

in_front! {
    fn allocate(
        device: vk::Device, info: *const vk::MemoryAllocateInfo<'static>, callbacks: Callbacks,
        memory: *mut vk::DeviceMemory,
    ) -> vk::Result {
        let bytes = (*info).allocation_size;
        look(&format!("vkAllocateMemory of {bytes} bytes"), |watched| {
            watched.alive += 1;
            watched.most_alive = watched.most_alive.max(watched.alive);
            bytes <= watched.limits.max_allocation && watched.alive <= ALLOCATIONS
        })
    } => allocate_memory;

    fn free(device: vk::Device, memory: vk::DeviceMemory, callbacks: Callbacks) {
        look("vkFreeMemory", |watched| {
            watched.alive -= 1;
            true
        })
    } => free_memory;

    fn create_buffer(
        device: vk::Device, info: *const vk::BufferCreateInfo<'static>, callbacks: Callbacks, buffer: *mut vk::Buffer,
    ) -> vk::Result {
        let size = (*info).size;
        look(&format!("vkCreateBuffer of {size} bytes"), |watched| size <= watched.limits.max_buffer)
    } => create_buffer;

    fn create_set_layout(
        device: vk::Device, info: *const vk::DescriptorSetLayoutCreateInfo<'static>, callbacks: Callbacks,
        layout: *mut vk::DescriptorSetLayout,
    ) -> vk::Result {
        let bindings = std::slice::from_raw_parts((*info).p_bindings, (*info).binding_count as usize);
        let buffers = bindings.iter().filter(|binding| BUFFERS.contains(&binding.descriptor_type));
        let count: u32 = buffers.map(|binding| binding.descriptor_count).sum();
        look(&format!("vkCreateDescriptorSetLayout of {count} storage buffers"), |watched| {
            count <= watched.limits.max_storage_buffers
        })
    } => create_descriptor_set_layout;

    fn update_sets(
        device: vk::Device, writes: u32, write: *const vk::WriteDescriptorSet<'static>, copies: u32,
        copy: *const vk::CopyDescriptorSet<'static>,
    ) {
        let all = std::slice::from_raw_parts(write, writes as usize);
        for one in all.iter().filter(|one| BUFFERS.contains(&one.descriptor_type)) {
            let buffers = std::slice::from_raw_parts(one.p_buffer_info, one.descriptor_count as usize);
            for vk::DescriptorBufferInfo { offset, range, .. } in buffers {
                look(&format!("vkUpdateDescriptorSets of {range} bytes at {offset}"), |watched| {
                    offset.is_multiple_of(ALIGNMENT) && *range <= watched.limits.max_storage_range
                });
            }
        }
        look("vkUpdateDescriptorSets", |_| true)
    } => update_descriptor_sets;

    fn bind_sets(
        cmd: vk::CommandBuffer, point: vk::PipelineBindPoint, layout: vk::PipelineLayout, first: u32, count: u32,
        sets: *const vk::DescriptorSet, offset_count: u32, offsets: *const u32,
    ) {
        look("vkCmdBindDescriptorSets with an offset that is not aligned", |_| {
            (0..offset_count as usize).all(|i| u64::from(*offsets.add(i)).is_multiple_of(ALIGNMENT))
        })
    } => cmd_bind_descriptor_sets;

    fn dispatch(cmd: vk::CommandBuffer, x: u32, y: u32, z: u32) {
        look(&format!("vkCmdDispatch of {x} × {y} × {z} workgroups"), |watched| {
            [x, y, z].iter().all(|n| *n <= watched.limits.max_workgroups)
        })
    } => cmd_dispatch;

    fn push(
        cmd: vk::CommandBuffer, layout: vk::PipelineLayout, stages: vk::ShaderStageFlags, offset: u32, size: u32,
        values: *const c_void,
    ) {
        look(&format!("vkCmdPushConstants of {size} bytes at {offset}"), |watched| {
            offset + size <= watched.limits.max_push_constants
        })
    } => cmd_push_constants;
}

/// Makes an engine within limits whose calls are checked.
fn engine(headless: &Headless, limits: &DeviceCaps) -> MorphEngine {
    let (instance, physical, device) = headless.handles();
    let limits = gpu::limited(headless.caps().clone(), |caps| caps.clamp_to(limits));
    let watched =
        Watched { device: device.clone(), limits: limits.clone(), alive: 0, most_alive: 0, calls: 0, broken: vec![] };
    *WATCHED.lock().expect("no panic meanwhile") = Some(watched);
    let load = |name: &CStr| match name.to_bytes() {
        b"vkAllocateMemory" => allocate as *const c_void,
        b"vkFreeMemory" => free as *const c_void,
        b"vkCreateBuffer" => create_buffer as *const c_void,
        b"vkCreateDescriptorSetLayout" => create_set_layout as *const c_void,
        b"vkUpdateDescriptorSets" => update_sets as *const c_void,
        b"vkCmdBindDescriptorSets" => bind_sets as *const c_void,
        b"vkCmdDispatch" => dispatch as *const c_void,
        b"vkCmdPushConstants" => push as *const c_void,
        // SAFETY: the device is alive.
        _ => unsafe { instance.get_device_proc_addr(device.handle(), name.as_ptr()) }
            .map_or(std::ptr::null(), |function| function as *const c_void),
    };
    // SAFETY: the functions are the device's, which is alive and belongs to the others; it outlives the engine.
    unsafe {
        let device = ash::Device::load_with(load, device.handle());
        MorphEngine::new(&DeviceDesc { caps: Some(limits), ..DeviceDesc::new(instance, physical, &device) })
            .expect("an engine")
    }
}

/// Two instances, with post-morph passes: decoded; skinned, and normals of the surface.
fn check(headless: &Headless, engine: &MorphEngine, mesh: &KeptMesh, (format, update): (DeltaFormat, UpdateDesc)) {
    let what = format!("{} {format:?} {update:?}", headless.caps().name);
    let packed = gpu::packed(engine, mesh, format);
    let (vertices, diagonal) = (packed.layout().vertex_count, f64::from(packed.layout().diagonal));
    let host = Buffers::new(headless);
    let joint = [1.0f32, 0.0, 0.0, 7.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let joints = host.shared(48);
    let places = [(268, 40, Some(16)), (0, 24, Some(12)), (4, 12, None)];
    let outputs = places.map(|place| Written::new(&host, vertices, place));
    host.write(&joints, 0, &joint);
    let (names, shares) = (vec![0u16; 4 * vertices], [1.0f32, 0.0, 0.0, 0.0].repeat(vertices));
    // SAFETY: buffers are recording, run once and are waited for; everything they use lives until then.
    unsafe {
        let (mut uploaded, mut skin, mut surface) = headless
            .run(|cmd| {
                let skin = engine.upload_skin(
                    cmd,
                    &packed,
                    &SkinDesc { influences: 4, joint_count: 1, joints: &names, weights: &shares },
                )?;
                let surface = engine.upload_normals(cmd, &packed)?;
                Ok((engine.upload(cmd, &packed)?, skin, surface))
            })
            .expect(&what);
        uploaded.release_staging();
        skin.release_staging();
        surface.release_staging();
        let consumers = Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES;
        let desc = CrowdDesc { instances: 2, consumers, ..CrowdDesc::new(update) };
        let mut crowd = engine.create_crowd(&uploaded, &desc).expect(&what);
        let decode =
            OutputTarget { offset: 268, stride: 40, normals: Some(16), ..OutputTarget::new(outputs[0].buffer) };
        engine.set_output_target(&mut crowd, 0, Some(&decode)).expect(&what);
        let joints = Some(Joints::new(&skin, joints.buffer, 48));
        let target = OutputTarget { stride: 24, normals: Some(12), joints, ..OutputTarget::new(outputs[1].buffer) };
        engine.set_output_target(&mut crowd, 1, Some(&target)).expect(&what);
        let recomputed = NormalsTarget { offset: 4, ..NormalsTarget::new(outputs[2].buffer) };
        engine.set_normals_target(&mut crowd, 1, Some((&surface, &recomputed))).expect(&what);
        let mut readback = engine.readback();
        for frame in 0..3 {
            let weights = [0, 1].map(|seed| -> Vec<f32> {
                gpu::weights(&packed, frame, seed).iter().map(|weight| weight / 2.0).collect()
            });
            (0..).zip(&weights).for_each(|(i, weights)| crowd.set_weights(i, weights).expect(&what));
            headless.run(|cmd| engine.record_update(cmd, &mut crowd).map(drop)).expect(&what);
            headless.run(|cmd| readback.record(cmd, &crowd, &[0, 1])).expect(&what);
            for (pose, weights) in readback.poses().expect(&what).iter().zip(&weights) {
                let error = compare(&pose.vertices, &gpu::reference(&packed, &update, weights));
                assert!(error.within(1e-5 * diagonal, NORMAL), "{what}, frame {frame}: {error:?}");
            }
            let taken = outputs.each_ref().map(|output| output.take().iter().flatten().count());
            assert!(taken.iter().all(|count| *count > 0), "{what}, frame {frame}: {taken:?} vertices are written");
        }
    }
}

/// One test, since only one device can be checked at a time.
#[test]
fn every_call_keeps_to_the_limits_and_poses_are_right() {
    let mesh = head(&HeadDesc { vertices: 900, targets: 37, sparsity: 0.15, seed: 3 });
    let mesh = mesh.kept(Tolerance::default()).expect("a mesh");
    let dense = |batch| (DeltaFormat::Float32, UpdateDesc::new(UpdatePath::Compute, batch));
    let updates = [
        (DeltaFormat::Fast, UpdateDesc::blocks()),
        (DeltaFormat::Small, UpdateDesc { pose: PoseFormat::Fixed16, ..UpdateDesc::blocks() }),
        dense(BatchSize::Targets(3)),
        dense(BatchSize::All),
    ];
    for (index, driver) in gpu::drivers().iter().enumerate() {
        let headless = gpu::device(driver, true, None);
        for (clamp, limits) in clamps() {
            // The limits decide the recorded commands, which one driver shows.
            if index > 0 && clamp != "small" {
                continue;
            }
            let engine = engine(&headless, &limits);
            for update in updates {
                check(&headless, &engine, &mesh, update);
            }
            if clamp == "allocations of 64 MiB" {
                let packed = gpu::packed(&engine, &mesh, DeltaFormat::Fast);
                let uploaded = gpu::upload(&headless, &engine, &packed);
                let desc = CrowdDesc { instances: 4000, ..CrowdDesc::new(UpdateDesc::blocks()) };
                crate::testing::says(engine.create_crowd(&uploaded, &desc), &["67108864"]);
            }
            drop(engine);
            let watched = WATCHED.lock().expect("no panic meanwhile").take().expect("a device");
            let name = &headless.caps().name;
            assert_eq!(watched.broken, [""; 0], "{name}, {clamp}");
            assert_eq!(watched.alive, 0, "{name}, {clamp}: memory that was not given back");
            println!("{name}, {clamp}: {} calls, {} allocations at most", watched.calls, watched.most_alive);
            assert!(watched.calls > 100, "the calls are looked at");
        }
        assert_eq!(gpu::complaints(&headless), [""; 0], "{driver}");
    }
}
