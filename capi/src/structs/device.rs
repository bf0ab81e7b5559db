//! Structures for the device.

use deltamorph::ash::vk;
use std::ffi::c_char;

/// cbindgen:ignore
#[repr(transparent)]
#[derive(Clone, Copy)]
pub struct GetInstanceProcAddr(pub Option<vk::PFN_vkGetInstanceProcAddr>);

/// cbindgen:ignore
#[repr(transparent)]
#[derive(Clone, Copy)]
pub struct GetDeviceProcAddr(pub Option<vk::PFN_vkGetDeviceProcAddr>);

/// The device that an engine is made on. All handles are alive, belong together, and live until the engine and all
/// objects made with it are destroyed. The device has the extensions and features of `dm_requirements` enabled for the
/// paths to be used.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmEngineDesc {
    /// sizeof(DmEngineDesc).
    pub struct_size: u32,
    /// Not 0: `device` was created with VK_EXT_transform_feedback and its feature `transformFeedback`.
    pub transform_feedback: u32,
    /// The instance.
    pub instance: vk::Instance,
    /// The physical device.
    pub physical_device: vk::PhysicalDevice,
    /// The device.
    pub device: vk::Device,
    /// The loader's function, which the library gets all others from.
    pub get_instance_proc_addr: GetInstanceProcAddr,
    /// The device's function; null: taken from the instance.
    pub get_device_proc_addr: GetDeviceProcAddr,
    /// The features that `device` was created with; null: none. Read during the call only.
    pub enabled_features: *const vk::PhysicalDeviceFeatures,
    /// The host's pipeline cache; null: none. Created without VK_PIPELINE_CACHE_CREATE_EXTERNALLY_SYNCHRONIZED_BIT: any
    /// thread that makes crowds or sets targets makes pipelines with it. It lives as long as the engine and all objects
    /// made with it; the host merges others into it only while no call that makes pipelines is running.
    pub pipeline_cache: vk::PipelineCache,
    /// Not 0: keep to the limits of Khronos' VP_ANDROID_baseline_2022 where the device's are larger.
    pub clamp_to_android_baseline: u32,
    /// Zero.
    pub reserved: u32,
    /// Not 0: `instance` was created with VK_EXT_debug_utils; then buffers, pipelines and descriptor sets get names,
    /// and updates labels: one around each call that records any, in it one around each step.
    pub debug_names: u32,
    /// Not 0: `device` was created with the feature `bufferDeviceAddress`; DmCrowdDesc::pose_usage may ask for
    /// addresses.
    pub buffer_device_address: u32,
    /// The families whose queues use the engine's buffers: those that upload, update and draw. Two or more share them
    /// (VK_SHARING_MODE_CONCURRENT), without ownership transfers; across queues the host's semaphores replace the
    /// barriers of a single queue. None: all run on one family. Read during the call only.
    pub queue_families: *const u32,
    /// Families.
    pub queue_family_count: u64,
}

/// Properties of an engine's device.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmEngineInfo {
    /// sizeof(DmEngineInfo).
    pub struct_size: u32,
    /// Not 0: a software driver; a CPU crowd is faster there.
    pub is_software: u32,
    /// Bytes that a storage-buffer descriptor may cover.
    pub max_storage_range: u64,
    /// Bytes of device and staging memory that the engine has allocated from the driver.
    pub allocated_bytes: u64,
    /// The device's name, ended by a zero.
    pub device_name: [c_char; 256],
}

/// Memory of one kind: bytes, and how many buffers they are.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmMemoryUse {
    /// Bytes, as allocated.
    pub bytes: u64,
    /// Buffers.
    pub allocations: u64,
}

/// The memory of an engine and all objects made with it, by what it is for. Buffers of the host's are not counted.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmMemory {
    /// sizeof(DmMemory).
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// Bytes allocated from the driver, including unused parts of blocks.
    pub allocated: u64,
    /// Base poses, deltas, skins and surfaces.
    pub meshes: DmMemoryUse,
    /// Poses, but for those in buffers of the host's.
    pub poses: DmMemoryUse,
    /// Clips of crowds that play them, their weights and plans.
    pub animation: DmMemoryUse,
    /// Lists that are written for updates, for each frame in flight.
    pub lists: DmMemoryUse,
    /// Staging memory of uploads, until it is released.
    pub staging: DmMemoryUse,
    /// Poses read back.
    pub readback: DmMemoryUse,
}

/// An extension or feature that a path needs. Strings live as long as the library is loaded.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmRequirement {
    /// The device extension to enable; null: none.
    pub extension: *const c_char,
    /// The feature to enable; null: none.
    pub feature: *const c_char,
    /// Why the path needs it.
    pub reason: *const c_char,
}
