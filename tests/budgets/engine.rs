//! The compute pipelines that the engine makes, with their specialization constants.
//!
//! The engine gets a device with wrapped functions for shader modules and compute pipelines, which log their calls and
//! call the driver's. So modules and constants are those of crowds as a host makes them, without a second list. The
//! driver is lavapipe; the tuning is that of the GPU. Nothing is submitted.

use crate::prelude::*;
use deltamorph::internals::abi::modules::MODULES;
use deltamorph::internals::abi::worklist::TILE;
use std::sync::Mutex;

/// A pipeline: its module's name under spirv/, and specialization constants 0, 1, …
pub type Pipeline = (String, Vec<u32>);

/// The functions of the current device, which the wrappers call. The next device may have others.
static DRIVER: Mutex<Option<ash::DeviceFnV1_0>> = Mutex::new(None);
/// The last module made, from which the engine makes pipelines next; and the pipelines.
static MADE: Mutex<(String, Vec<Pipeline>)> = Mutex::new((String::new(), vec![]));

fn driver() -> ash::DeviceFnV1_0 {
    DRIVER.lock().expect("no panic before").clone().expect("set before the engine is made")
}

/// Wraps vkCreateShaderModule.
unsafe extern "system" fn create_shader_module(
    device: vk::Device,
    info: *const vk::ShaderModuleCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    module: *mut vk::ShaderModule,
) -> vk::Result {
    // SAFETY: the engine's call is valid, and is passed on unchanged.
    unsafe {
        let words = std::slice::from_raw_parts((*info).p_code, (*info).code_size / 4);
        let known = MODULES.iter().find(|module| module.words() == words).expect("a module of the table");
        MADE.lock().expect("no panic before").0 = known.name.to_owned();
        (driver().create_shader_module)(device, info, allocator, module)
    }
}

/// Wraps vkCreateComputePipelines.
unsafe extern "system" fn create_compute_pipelines(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::ComputePipelineCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    pipelines: *mut vk::Pipeline,
) -> vk::Result {
    // SAFETY: the engine's call is valid, and is passed on unchanged.
    unsafe {
        let (module, made) = &mut *MADE.lock().expect("no panic before");
        for info in std::slice::from_raw_parts(infos, count as usize) {
            made.push((module.clone(), constants(&info.stage)));
        }
        (driver().create_compute_pipelines)(device, cache, count, infos, allocator, pipelines)
    }
}

/// Returns the specialization constants of a stage, which are numbered from 0.
///
/// # Safety
/// The stage's specialization is valid, or null.
unsafe fn constants(stage: &vk::PipelineShaderStageCreateInfo<'_>) -> Vec<u32> {
    // SAFETY: the caller's obligation.
    unsafe {
        let Some(info) = stage.p_specialization_info.as_ref().filter(|info| info.map_entry_count > 0) else {
            return vec![];
        };
        let entries = std::slice::from_raw_parts(info.p_map_entries, info.map_entry_count as usize);
        let numbered = (0..).zip(entries).all(|(i, entry)| entry.constant_id == i && entry.size == 4);
        assert!(numbered, "32-bit constants in the order of their numbers");
        let value = |entry: &vk::SpecializationMapEntry| info.p_data.byte_add(entry.offset as usize).cast::<u32>();
        entries.iter().map(|entry| value(entry).read_unaligned()).collect()
    }
}

/// Returns the pipelines of crowds on devices with this tuning, each once.
pub fn pipelines(tuning: DeviceTuning) -> Vec<Pipeline> {
    static KNOWN: Mutex<Vec<(DeviceTuning, Vec<Pipeline>)>> = Mutex::new(vec![]);
    // Tests run concurrently, and the wrappers cannot tell calls apart: held until all pipelines are made.
    let mut known = KNOWN.lock().expect("no panic before");
    if let Some((_, pipelines)) = known.iter().find(|(of, _)| *of == tuning) {
        return pipelines.clone();
    }
    make(tuning);
    let mut made = std::mem::take(&mut MADE.lock().expect("no panic before").1);
    made.sort_unstable();
    made.dedup();
    known.push((tuning, made.clone()));
    made
}

/// Makes crowds on a lavapipe device with this tuning.
fn make(tuning: DeviceTuning) {
    let headless = gpu::device("llvmpipe", false, None);
    let (instance, physical, device) = headless.handles();
    let mut core = device.fp_v1_0().clone();
    *DRIVER.lock().expect("no panic before") = Some(core.clone());
    core.create_shader_module = create_shader_module;
    core.create_compute_pipelines = create_compute_pipelines;
    let (core1, core2, core3) = (device.fp_v1_1().clone(), device.fp_v1_2().clone(), device.fp_v1_3().clone());
    let watched = ash::Device::from_parts_1_3(device.handle(), core, core1, core2, core3);
    let caps = gpu::limited(headless.caps().clone(), |caps| caps.tuning = tuning);
    let host = Buffers::new(&headless);
    let output = host.shared(1 << 16).buffer;
    // SAFETY: the handles belong together, and outlive the engine.
    let engine =
        unsafe { MorphEngine::new(&DeviceDesc { caps: Some(caps), ..DeviceDesc::new(instance, physical, &watched) }) };
    let engine = engine.expect("an engine");
    engine.set_techniques(&deltamorph_baselines::TECHNIQUES);
    let recorded = headless.run(|cmd| {
        // SAFETY: the buffer is recording, and is not submitted; the output is large enough.
        unsafe { make_crowds(&engine, cmd, output) };
        Err::<(), _>(Error::Invalid { what: "not submitted".into(), remedy: String::new() })
    });
    assert!(recorded.is_err());
}

/// Makes crowds of one instance and of the widest tile, in every supported combination of format, path and pose format.
///
/// # Safety
/// `cmd` is recording, and is never submitted; `output` is a storage buffer of the engine's device.
unsafe fn make_crowds(engine: &MorphEngine, cmd: vk::CommandBuffer, output: vk::Buffer) {
    let head_desc = HeadDesc { vertices: 300, targets: 4, ..Default::default() };
    let mesh = head(&head_desc).kept(Tolerance::default()).expect("a mesh");
    let clips = [head_clip(&head_desc, 2, 30.0)];
    let animation = AnimationDesc::new(&clips);
    for format in DeltaFormat::ALL {
        let packed = PackedMesh::pack(&mesh, &engine.pack_desc(format)).expect("a mesh that fits");
        for update in updates(engine, format) {
            // SAFETY: the caller's obligations.
            let uploaded = unsafe { engine.upload_for(cmd, &packed, update.path) }.expect("an upload");
            for instances in [1, TILE as u32] {
                let desc = CrowdDesc { instances, ..CrowdDesc::new(update) };
                // Unsupported combinations are refused; main.rs checks that every module has a pipeline in the end.
                if let Ok(mut crowd) = engine.create_crowd(&uploaded, &desc) {
                    // SAFETY: as above.
                    unsafe { follow(engine, cmd, &packed, &mut crowd, output) };
                }
                // SAFETY: as above.
                let _ = unsafe { engine.create_animated_crowd(cmd, &uploaded, &desc, &animation) };
            }
        }
    }
}

/// Makes every kind of every post-morph pass.
///
/// # Safety
/// Those of [`make_crowds`].
unsafe fn follow(
    engine: &MorphEngine,
    cmd: vk::CommandBuffer,
    packed: &PackedMesh,
    crowd: &mut Crowd,
    output: vk::Buffer,
) {
    // SAFETY: the caller's obligations.
    let _ = unsafe { engine.set_output_target(crowd, 0, Some(&OutputTarget::new(output))) };
    // SAFETY: as above.
    let surface = unsafe { engine.upload_normals(cmd, packed) }.expect("a surface");
    // SAFETY: as above.
    let _ = unsafe { engine.set_normals_target(crowd, 0, Some((&surface, &NormalsTarget::new(output)))) };
    for influences in [4, 8] {
        let count = packed.layout().vertex_count * influences as usize;
        let (joints, weights) = (vec![0; count], vec![1.0; count]);
        let desc = SkinDesc { influences, joint_count: 1, joints: &joints, weights: &weights };
        // SAFETY: as above.
        let skin = unsafe { engine.upload_skin(cmd, packed, &desc) }.expect("a skin");
        for method in [SkinMethod::Linear, SkinMethod::DualQuaternion] {
            let joints = Some(Joints { method, ..Joints::new(&skin, output, 48) });
            let target = OutputTarget { joints, ..OutputTarget::new(output) };
            // SAFETY: as above.
            let _ = unsafe { engine.set_output_target(crowd, 0, Some(&target)) };
        }
    }
}

/// Returns the updates of a format by compute shaders. Paths whose passes are draws need extensions or features that
/// the device was not created with.
fn updates(engine: &MorphEngine, format: DeltaFormat) -> Vec<UpdateDesc> {
    let mut updates = vec![];
    for path in deltamorph_baselines::PATHS {
        let takes = path.formats().contains(&format) && !path.evaluates_in_draws() && path != UpdatePath::Cpu;
        if !takes || engine.caps().check_path(path).is_err() {
            continue;
        }
        // Batches up to four represent all sixteen.
        for batch in [BatchSize::All, BatchSize::Targets(4)] {
            // A format that shares another's modules does less in them: rounds a sum in place of each product.
            for pose in PoseFormat::ALL.into_iter().filter(|pose| pose.decoder() == pose.name()) {
                updates.push(UpdateDesc { pose, ..UpdateDesc::new(path, batch) });
            }
        }
    }
    updates
}
