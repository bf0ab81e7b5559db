//! The host's device, borrowed: handles, limits, allocator.

use super::caps::DeviceCaps;
use crate::error::{Error, LESS, Result};
use crate::setters::setters;
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationError, AllocationSizes};
use std::any::Any;
use std::ffi::CString;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What keeps handles of the host's alive: dropped when the last of ours that needs them is.
pub(crate) type Owner = Arc<dyn Any + Send + Sync>;

/// A gpu-allocator that host and engine share. Clones are of the same allocator, and each keeps what owns its device
/// alive: the last of them frees the memory before that goes, in whatever order clones are dropped.
#[derive(Clone)]
pub struct SharedAllocator {
    allocator: Arc<Mutex<Allocator>>,
    // Drops after the allocator.
    _owner: Option<Owner>,
}

impl SharedAllocator {
    /// An allocator and what owns its device: a value that destroys the device when it is dropped. With `None`, and with
    /// clones of the `Arc` that the host keeps beside this, the host sees to it that the allocator goes before its device.
    pub fn new(allocator: Arc<Mutex<Allocator>>, owner: Option<Arc<dyn Any + Send + Sync>>) -> Self {
        Self { allocator, _owner: owner }
    }

    /// The allocator, locked: not to be held while the engine makes or drops anything. A panic elsewhere while it was
    /// locked does not spoil it.
    pub fn lock(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What the host hands in: made by [`new`](Self::new), then changed field by field.
#[non_exhaustive]
pub struct DeviceDesc<'a> {
    /// The instance, created for Vulkan 1.1 or later.
    pub instance: &'a ash::Instance,
    /// The physical device.
    pub physical_device: vk::PhysicalDevice,
    /// The device, with the extensions and features of [`requirements`](crate::requirements) enabled for
    /// the paths that will be used.
    pub device: &'a ash::Device,
    /// Limits to keep to; `None`: what the driver says. Transform feedback is used only where
    /// `transform_feedback_enabled` says so, too.
    pub caps: Option<DeviceCaps>,
    /// Whether `device` was created with VK_EXT_transform_feedback and its feature `transformFeedback`.
    pub transform_feedback_enabled: bool,
    /// The features that `device` was created with. Of use are `vertexPipelineStoresAndAtomics`, for the baseline
    /// `vertex-store`, and `shaderInt64` on software drivers, where `fast` in blocks takes half as long with it.
    pub enabled_features: vk::PhysicalDeviceFeatures,
    /// The host's cache of pipelines, which it loads and stores; `null()`: none. Of this device, and made without
    /// `VK_PIPELINE_CACHE_CREATE_EXTERNALLY_SYNCHRONIZED_BIT`: whatever thread makes crowds or sets targets of steps after the
    /// pose makes pipelines with it, without a lock. It lives as long as the engine and all that it makes. The host may read
    /// it at any time (`vkGetPipelineCacheData`), make pipelines with it, and merge it into another; it merges others into
    /// it (`vkMergePipelineCaches`) only while no thread is in a call of the engine that makes pipelines.
    pub pipeline_cache: vk::PipelineCache,
    /// The host's allocator; `None`: the engine makes one of its own. That one gives each of the first 128 buffers
    /// memory of exactly its size, returned as soon as the buffer goes; further small ones share blocks of 4 MiB to 64
    /// MiB, of which one is kept for each type of memory. A host with many meshes, or near the device's limit of
    /// allocations (`maxMemoryAllocationCount`), hands in its own.
    pub allocator: Option<SharedAllocator>,
    /// Whether `device` was created with the feature `bufferDeviceAddress`, and an allocator that is handed in was made for
    /// it: pose buffers can have addresses then ([`CrowdDesc::pose_usage`](field@crate::CrowdDesc::pose_usage)).
    pub buffer_device_address: bool,
    /// Whether the instance was created with VK_EXT_debug_utils: buffers, pipelines and descriptor sets get names then, which
    /// layers and debuggers show.
    pub debug_names: bool,
    /// The families whose queues use what the engine makes: those that upload, update and draw. Where there are two or more,
    /// the engine's buffers are shared by them all (`VK_SHARING_MODE_CONCURRENT`), and no ownership is ever transferred;
    /// otherwise (none named: all run on one) they are `VK_SHARING_MODE_EXCLUSIVE`.
    /// [`MorphEngine`](crate::MorphEngine#several-queues) says what orders the queues.
    pub queue_families: &'a [u32],
    /// What owns the handles, such as an `Arc` of the host's that destroys the device when it is dropped. The engine and
    /// all that it makes keep it alive, so that they and the host's own clones may be dropped in any order. `None`: the
    /// host destroys the device after the last of them.
    pub owner: Option<Arc<dyn Any + Send + Sync>>,
}

setters!(DeviceDesc<'a> {
    caps: Option<DeviceCaps>,
    transform_feedback_enabled: bool,
    enabled_features: vk::PhysicalDeviceFeatures,
    pipeline_cache: vk::PipelineCache,
    allocator: Option<SharedAllocator>,
    buffer_device_address: bool,
    debug_names: bool,
    queue_families: &'a [u32],
    owner: Option<Arc<dyn Any + Send + Sync>>,
});

impl<'a> DeviceDesc<'a> {
    /// A device without extensions and features, its own limits, no pipeline cache, and an allocator of the engine's.
    pub fn new(instance: &'a ash::Instance, physical_device: vk::PhysicalDevice, device: &'a ash::Device) -> Self {
        Self {
            instance,
            physical_device,
            device,
            caps: None,
            transform_feedback_enabled: false,
            enabled_features: vk::PhysicalDeviceFeatures::default(),
            pipeline_cache: vk::PipelineCache::null(),
            allocator: None,
            buffer_device_address: false,
            debug_names: false,
            queue_families: &[],
            owner: None,
        }
    }
}

/// Queue families, each once.
pub(super) fn distinct(families: &[u32]) -> Vec<u32> {
    let mut families = families.to_vec();
    families.sort_unstable();
    families.dedup();
    families
}

/// Buffers that the engine's own allocator gives memory of their own: a small part of the 4,096 allocations that every
/// device allows, and enough that a host with a few faces takes what they need, and no block beside it.
const DEDICATED_MOST: u32 = 128;

/// Device functions and limits, shared by everything that the engine creates.
pub struct Device {
    /// Its functions.
    pub raw: ash::Device,
    /// Those of transform feedback, where it is enabled.
    pub feedback: Option<ash::ext::transform_feedback::Device>,
    /// Limits and features to keep to.
    pub caps: DeviceCaps,
    /// The host's cache, or none.
    pub pipeline_cache: vk::PipelineCache,
    /// Buffers can have addresses.
    pub(crate) device_address: bool,
    /// The queue families that the host named, each once.
    pub families: Vec<u32>,
    names: Option<ash::ext::debug_utils::Device>,
    allocator: SharedAllocator,
    /// Buffers with memory of their own, and how many may have: none from a host's allocator.
    dedicated: AtomicU32,
    dedicated_most: u32,
    /// What owns the handles. Drops last.
    _owner: Option<Owner>,
}

impl Device {
    /// # Safety
    /// As [`MorphEngine::new`](crate::MorphEngine::new).
    pub(crate) unsafe fn borrow(desc: &DeviceDesc<'_>) -> Result<Self> {
        let mut caps = match &desc.caps {
            Some(caps) => caps.clone(),
            // SAFETY: physical device and instance belong together and are alive: the caller's obligation.
            None => unsafe { DeviceCaps::query(desc.instance, desc.physical_device) }?,
        };
        if !desc.transform_feedback_enabled {
            caps.transform_feedback = None;
        }
        caps.vertex_stores &= desc.enabled_features.vertex_pipeline_stores_and_atomics == vk::TRUE;
        caps.int64 &= desc.enabled_features.shader_int64 == vk::TRUE;
        caps.tuning.check()?;
        desc.queue_families.iter().try_for_each(|&family| caps.queue_flags(family).map(drop))?;
        let extension = |_| ash::ext::transform_feedback::Device::new(desc.instance, desc.device);
        let feedback = caps.transform_feedback.map(extension);
        let dedicated_most = if desc.allocator.is_none() { DEDICATED_MOST } else { 0 };
        let allocator = match &desc.allocator {
            Some(allocator) => allocator.clone(),
            None => {
                let allocator = Allocator::new(&AllocatorCreateDesc {
                    instance: desc.instance.clone(),
                    device: desc.device.clone(),
                    physical_device: desc.physical_device,
                    debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
                    buffer_device_address: desc.buffer_device_address,
                    allocation_sizes: AllocationSizes::new(4 << 20, 4 << 20)
                        .with_max_device_memblock_size(64 << 20)
                        .with_max_host_memblock_size(64 << 20),
                })
                .map_err(|e| allocation_failed("the allocator", 0, &e))?;
                SharedAllocator::new(Arc::new(Mutex::new(allocator)), desc.owner.clone())
            }
        };
        Ok(Self {
            raw: desc.device.clone(),
            feedback,
            caps,
            pipeline_cache: desc.pipeline_cache,
            device_address: desc.buffer_device_address,
            families: distinct(desc.queue_families),
            names: desc.debug_names.then(|| ash::ext::debug_utils::Device::new(desc.instance, desc.device)),
            allocator,
            dedicated: AtomicU32::new(0),
            dedicated_most,
            _owner: desc.owner.clone(),
        })
    }

    /// Give an object of this device, that was made just now, a name where the host wants names.
    pub fn name(&self, object: impl vk::Handle, name: impl FnOnce() -> String) {
        let Some(functions) = &self.names else { return };
        // Names of meshes may have anything in them.
        let Ok(name) = CString::new(name().replace('\0', " ")) else { return };
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
        // SAFETY: the host says that the extension is enabled; the object is of this device, and no other thread has it yet.
        // Who cannot be told the name does without.
        let _ = unsafe { functions.set_debug_utils_object_name(&info) };
    }

    /// Memory for a buffer.
    pub fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        own: AllocationScheme,
        location: MemoryLocation,
    ) -> Result<Allocation, AllocationError> {
        // Images are tiled as the device likes.
        let linear = !matches!(own, AllocationScheme::DedicatedImage(_));
        let allocate = |allocation_scheme| {
            let desc = AllocationCreateDesc { name, requirements, location, linear, allocation_scheme };
            self.allocator().allocate(&desc)
        };
        let allocation = match self.dedicated.load(Ordering::Relaxed) < self.dedicated_most {
            true => allocate(own)?,
            // Where there is no room for another block there may be for the buffer.
            false => allocate(AllocationScheme::GpuAllocatorManaged).or_else(|_| allocate(own))?,
        };
        if allocation.is_dedicated() {
            self.dedicated.fetch_add(1, Ordering::Relaxed);
        }
        Ok(allocation)
    }

    /// Give memory back.
    pub fn free(&self, allocation: Allocation) {
        if allocation.is_dedicated() {
            self.dedicated.fetch_sub(1, Ordering::Relaxed);
        }
        // An error here means that the allocator lost track of it; there is nobody to tell.
        let _ = self.allocator().free(allocation);
    }

    pub(crate) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock()
    }
}

/// What the failure to allocate `bytes` for `name` is to hosts.
pub fn allocation_failed(name: &str, bytes: u64, error: &AllocationError) -> Error {
    // What vkAllocateMemory returns comes as text, but for ERROR_OUT_OF_DEVICE_MEMORY.
    let says =
        |text: &str, result: vk::Result| text.contains("vkAllocateMemory") && text.ends_with(&format!("{result:?}"));
    let returned = |result: vk::Result| matches!(error, AllocationError::Internal(text) if says(text, result));
    let (host, count) = (vk::Result::ERROR_OUT_OF_HOST_MEMORY, vk::Result::ERROR_TOO_MANY_OBJECTS);
    let what = |why: &dyn std::fmt::Display| format!("no memory for '{name}' ({bytes} bytes): {why}");
    if returned(host) {
        Error::out_of_memory(what(&format_args!("vkAllocateMemory failed: {host:?}")), LESS)
    } else if returned(count) {
        let remedy =
            "destroy what is no longer needed, or hand in an allocator of your own that makes fewer allocations";
        Error::out_of_memory(what(&format_args!("vkAllocateMemory failed: {count:?}")), remedy)
    } else if matches!(error, AllocationError::OutOfMemory | AllocationError::FailedToMap(_)) {
        Error::out_of_memory(what(error), LESS)
    } else {
        Error::invalid(what(error), "report this with the device's name, or hand in an allocator of your own")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;

    /// What gpu-allocator makes of `result`, as its version 0.28 does (vulkan/mod.rs, `MemoryBlock::new`).
    fn refused(result: vk::Result) -> AllocationError {
        match result {
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => AllocationError::OutOfMemory,
            other => AllocationError::Internal(format!("Unexpected error in vkAllocateMemory: {other:?}")),
        }
    }

    #[test]
    fn memory_that_is_refused_is_no_mistake_of_the_hosts() {
        for (result, remedy) in [
            (vk::Result::ERROR_OUT_OF_HOST_MEMORY, "fewer instances"),
            (vk::Result::ERROR_OUT_OF_DEVICE_MEMORY, "fewer instances"),
            (vk::Result::ERROR_TOO_MANY_OBJECTS, "an allocator of your own"),
        ] {
            let error = allocation_failed("poses", 96, &refused(result));
            let text = error.to_string();
            assert_eq!(error.kind(), ErrorKind::OutOfMemory, "{text}");
            assert!(text.starts_with("no memory for 'poses' (96 bytes): ") && text.contains(remedy), "{text}");
            assert!(!text.contains("Internal") && !text.contains("report"), "{text}");
        }
        let odd = allocation_failed("poses", 96, &AllocationError::Internal("Memory block must be Some".into()));
        assert!(odd.kind() == ErrorKind::Invalid && odd.to_string().contains("report this"), "{odd}");
    }
}
