//! The engine on a device of the host's.

use crate::allocate::Functions;
use crate::handles::{DmEngine, Handle, handle};
use crate::memory::{Place, Versioned, characters, check_place, read, slice};
use crate::result::{DmResult, Failure, Result, ensure, enter};
use crate::structs::{DmEngineDesc, DmEngineInfo, DmMemoryUse};
use deltamorph::ash::vk::{self, Handle as _};
use deltamorph::memory::{MemorySource, MemoryUse};
use deltamorph::{DeviceCaps, DeviceDesc, MorphEngine, ash};
use std::ffi::{CStr, c_void};
use std::sync::Arc;

/// The object of a `DmEngine`. Objects made with it refer to it.
pub struct Engine {
    pub(crate) morph: MorphEngine,
}

handle!(DmEngine for Engine);

/// Make an engine on a device of the host's. It never submits, waits, or makes a queue or a thread.
///
/// Errors: DM_ERROR_INVALID for null handles, an instance or device of Vulkan 1.0, or queue families that the device
/// does not have; DM_ERROR_OUT_OF_MEMORY.
///
/// # Safety
/// `desc` is a structure that meets the conditions in its documentation; `engine` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_engine_create(desc: *const DmEngineDesc, engine: *mut DmEngine) -> DmResult {
    enter("dm_engine_create", || {
        check_place(engine, "engine")?;
        // SAFETY: the caller's obligations.
        unsafe {
            let morph = morph_engine(&read(desc)?)?;
            engine.write(DmEngine::insert(Engine { morph }));
        }
        Ok(())
    })
}

/// # Safety
/// The conditions of [`dm_engine_create`].
unsafe fn morph_engine(desc: &DmEngineDesc) -> Result<MorphEngine> {
    let functions = desc.get_instance_proc_addr.0;
    for (what, is_null) in [
        ("get_instance_proc_addr", functions.is_none()),
        ("instance", desc.instance.is_null()),
        ("physical_device", desc.physical_device.is_null()),
        ("device", desc.device.is_null()),
    ] {
        ensure!(!is_null, "'{what}' is null; hand in the host's own");
    }
    // SAFETY: the handles are alive and belong together, and the functions are theirs: the caller's obligations.
    unsafe {
        let load = |name: &CStr| functions.and_then(|get| get(desc.instance, name.as_ptr()));
        // Checked before any call that Vulkan 1.0 does not have.
        let pointer = |function: vk::PFN_vkVoidFunction| function.map_or(std::ptr::null(), |f| f as *const c_void);
        let instance = ash::Instance::load_with(|name| pointer(load(name)), desc.instance);
        let version = load(c"vkGetPhysicalDeviceProperties2")
            .map_or(0, |_| instance.get_physical_device_properties(desc.physical_device).api_version);
        ensure!(
            version >= vk::API_VERSION_1_1,
            "instance or device are of Vulkan 1.0; create the instance with apiVersion 1.1 or later, on a device that \
             has it"
        );
        let device = match desc.get_device_proc_addr.0 {
            None => ash::Device::load(instance.fp_v1_0(), desc.device),
            Some(get) => ash::Device::load_with(|name| pointer(get(desc.device, name.as_ptr())), desc.device),
        };
        let features = if desc.enabled_features.is_null() {
            vk::PhysicalDeviceFeatures::default()
        } else {
            desc.enabled_features.read_unaligned()
        };
        let families = slice(desc.queue_families, desc.queue_family_count as usize, "queue_families")?;
        let device_desc = DeviceDesc {
            transform_feedback_enabled: desc.transform_feedback != 0,
            enabled_features: features,
            pipeline_cache: desc.pipeline_cache,
            debug_names: desc.debug_names != 0,
            buffer_device_address: desc.buffer_device_address != 0,
            queue_families: families,
            ..DeviceDesc::new(&instance, desc.physical_device, &device)
        };
        let memory = memory(desc)?;
        let mut caps = DeviceCaps::query(&instance, desc.physical_device)?;
        if desc.clamp_to_android_baseline != 0 {
            caps.clamp_to(&DeviceCaps::android_baseline());
        }
        Ok(MorphEngine::new(&DeviceDesc { memory, caps: Some(caps), ..device_desc })?)
    }
}

/// The host's functions for memory.
fn memory(desc: &DmEngineDesc) -> Result<Option<Arc<dyn MemorySource>>> {
    match (desc.allocate_memory, desc.free_memory) {
        (None, None) => Ok(None),
        (Some(allocate), Some(free)) => Ok(Some(Arc::new(Functions { allocate, free, user: desc.memory_user }))),
        _ => Err(Failure::invalid("'allocate_memory' without 'free_memory', or the reverse; set both or neither")),
    }
}

/// Write the properties of an engine's device, and how much memory the engine and all objects made with it take.
///
/// # Safety
/// `info` is a structure that can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_engine_info(engine: DmEngine, info: *mut DmEngineInfo) -> DmResult {
    enter("dm_engine_info", || {
        // SAFETY: the caller's obligation.
        let place = unsafe { Place::new(info) }?;
        let engine = engine.get()?;
        let caps = engine.morph.caps();
        let memory = engine.morph.memory();
        let of = |used: MemoryUse| DmMemoryUse { bytes: used.bytes, allocations: used.allocations };
        place.write(DmEngineInfo {
            is_software: caps.is_software().into(),
            max_storage_range: caps.max_storage_range,
            allocated_bytes: memory.allocated,
            device_name: characters(&caps.name),
            meshes: of(memory.meshes),
            poses: of(memory.poses),
            animation: of(memory.animation),
            lists: of(memory.lists),
            staging: of(memory.staging),
            readback: of(memory.readback),
            ..DmEngineInfo::zeroed()
        });
        Ok(())
    })
}
