//! The compute pipelines that the engine makes, with their specialization constants.
//!
//! Modules and constants are those of crowds as a host makes them, without a second list. The driver is lavapipe; the
//! tuning is that of the GPU. Nothing is submitted.

use crate::prelude::*;
use crate::watched::{hash, log, watched};
use deltamorph::internals::abi::modules::MODULES;
use deltamorph::internals::abi::worklist::TILE;
use std::sync::Mutex;

/// A pipeline: its module's name under spirv/, and specialization constants 0, 1, …
pub type Pipeline = (String, Vec<u32>);

/// Returns the pipelines of crowds on devices with this tuning, each once.
pub fn pipelines(tuning: DeviceTuning) -> Vec<Pipeline> {
    static KNOWN: Mutex<Vec<(DeviceTuning, Vec<Pipeline>)>> = Mutex::new(vec![]);
    // Held until all are made: other GPUs have the same tuning.
    let mut known = KNOWN.lock().expect("no panic before");
    if let Some((_, pipelines)) = known.iter().find(|(of, _)| *of == tuning) {
        return pipelines.clone();
    }
    let mut made = made(&make(tuning));
    made.sort_unstable();
    made.dedup();
    known.push((tuning, made.clone()));
    made
}

/// Returns the pipelines in a list of calls: the engine makes each of the module that it has made last.
fn made(calls: &[String]) -> Vec<Pipeline> {
    let names: HashMap<String, &str> =
        MODULES.iter().map(|module| (format!("module {:x}", hash(&module.words())), module.name)).collect();
    let (mut last, mut made) = ("", vec![]);
    for call in calls {
        if let Some(name) = names.get(call) {
            last = name;
        } else if call.starts_with("pipelines of ") {
            let numbers =
                |constants: &str| constants.split_whitespace().map(|n| n.parse().expect("a number")).collect();
            made.extend(call.split(':').skip(1).map(|constants| (last.to_owned(), numbers(constants))));
        }
    }
    made
}

/// Makes crowds on a lavapipe device with this tuning; returns the calls.
fn make(tuning: DeviceTuning) -> Vec<String> {
    let headless = gpu::device("llvmpipe", false, None);
    let (_, physical, _) = headless.handles();
    let host = Buffers::new(&headless);
    let output = host.shared(1 << 16).buffer;
    let (instance, device) = watched(&headless);
    let caps = gpu::limited(headless.caps().clone(), |caps| caps.tuning = tuning);
    let desc = DeviceDesc { caps: Some(caps), ..DeviceDesc::new(&instance, physical, &device) };
    // SAFETY: the handles belong together, and outlive the engine.
    let engine = unsafe { MorphEngine::new(&desc) }.expect("an engine");
    engine.set_techniques(&deltamorph_baselines::TECHNIQUES);
    let recorded = headless.run(|cmd| {
        // SAFETY: the buffer is recording, and is not submitted; the output is large enough.
        unsafe { make_crowds(&engine, cmd, output) };
        Err::<(), _>(Error::Invalid { what: "not submitted".into(), remedy: String::new() })
    });
    assert!(recorded.is_err());
    log()
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
    let streams = [Semantic::Position, Semantic::Normal].map(|semantic| OutputStream::new(semantic, output));
    let formats = [vk::Format::R8G8B8A8_SNORM, vk::Format::A2B10G10R10_SNORM_PACK32, vk::Format::R16G16B16A16_SNORM];
    for format in [streams[1].format].into_iter().chain(formats) {
        for pose_order in [false, true] {
            let streams = [streams[0], OutputStream { format, ..streams[1] }];
            let target = OutputTarget { pose_order, ..OutputTarget::new(&streams) };
            // SAFETY: the caller's obligations.
            let _ = unsafe { engine.set_output_target(crowd, 0, Some(&target)) };
        }
    }
    // SAFETY: as above.
    let surface = unsafe { engine.upload_normals(cmd, packed) }.expect("a surface");
    // SAFETY: as above.
    let _ = unsafe { engine.set_normals_target(crowd, 0, Some((&surface, &OutputTarget::new(&streams[1..])))) };
    for influences in [4, 8] {
        let count = packed.layout().vertex_count * influences as usize;
        let (joints, weights) = (vec![0; count], vec![1.0; count]);
        let desc = SkinDesc { influences, joint_count: 1, joints: &joints, weights: &weights };
        // SAFETY: as above.
        let skin = unsafe { engine.upload_skin(cmd, packed, &desc) }.expect("a skin");
        for method in [SkinMethod::Linear, SkinMethod::DualQuaternion] {
            let joints = Some(Joints { method, ..Joints::new(&skin, output, 48) });
            let target = OutputTarget { joints, ..OutputTarget::new(&streams) };
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
