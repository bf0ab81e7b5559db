//! Structures for the device.

use deltamorph::ash::vk;
use std::ffi::{c_char, c_void};

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
    /// The host's functions for device memory, both or neither: each buffer of the library's then has memory of its own
    /// from them. Called within calls of the library, on any thread, also on several at once; they call no function of
    /// the library. Null: the library allocates.
    pub allocate_memory: DmAllocateMemory,
    /// Takes back what `allocate_memory` handed out.
    pub free_memory: DmFreeMemory,
    /// Passed to both functions. It and they have to live until the engine, and all meshes and crowds made with it, are
    /// destroyed.
    pub memory_user: *mut c_void,
}

/// What memory a buffer needs.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmMemoryRequest {
    /// Bytes.
    pub size: u64,
    /// The offset is a multiple of it.
    pub alignment: u64,
    /// Types of memory that will do (VkMemoryRequirements::memoryTypeBits).
    pub type_bits: u32,
    /// VkMemoryPropertyFlags that it has to have: HOST_VISIBLE and HOST_COHERENT where the host reads or writes.
    pub required: u32,
    /// VkMemoryPropertyFlags that make updates faster.
    pub preferred: u32,
    /// Zero.
    pub reserved: u32,
}

/// Memory for a buffer.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmHostMemory {
    /// The memory, allocated for addresses if DmEngineDesc::buffer_device_address is set.
    pub memory: vk::DeviceMemory,
    /// Offset of the first byte.
    pub offset: u64,
    /// Where the first byte is mapped, until it is freed; null if HOST_VISIBLE was not required.
    pub mapped: *mut c_void,
    /// Any value, by which the host identifies the memory.
    pub token: u64,
}

/// Allocates memory that meets the request, and overlaps nothing that was not freed. Returns VK_SUCCESS or an error,
/// such as VK_ERROR_OUT_OF_DEVICE_MEMORY, which becomes that of the call.
pub type DmAllocateMemory =
    Option<unsafe extern "C" fn(user: *mut c_void, request: *const DmMemoryRequest, memory: *mut DmHostMemory) -> i32>;

/// Frees memory, which the device no longer uses.
pub type DmFreeMemory = Option<unsafe extern "C" fn(user: *mut c_void, memory: *const DmHostMemory)>;

/// Properties of an engine's device, and its memory by purpose. Buffers of the host's are not counted.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmEngineInfo {
    /// sizeof(DmEngineInfo).
    pub struct_size: u32,
    /// Not 0: a software driver.
    pub is_software: u32,
    /// Bytes that a storage-buffer descriptor may cover.
    pub max_storage_range: u64,
    /// Bytes of device and staging memory that the engine has allocated from the driver, with unused parts of blocks.
    pub allocated_bytes: u64,
    /// The device's name, ended by a zero.
    pub device_name: [c_char; 256],
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

/// Memory of one kind: bytes, and how many buffers they are.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmMemoryUse {
    /// Bytes, as allocated.
    pub bytes: u64,
    /// Buffers.
    pub allocations: u64,
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
