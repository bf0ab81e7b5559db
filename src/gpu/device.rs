//! The host's device, borrowed: handles, limits, allocator.

use super::allocation::{Memory, MemoryRequest, MemorySource, Source, properties};
use super::caps::DeviceCaps;
use super::statistics::{MemoryKind, MemoryStats};
use crate::error::{Error, LESS, Result, refuse};
use ash::vk;
use gpu_allocator::vulkan::{AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationError, AllocationSizes};
use std::any::Any;
use std::ffi::CString;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// An object that keeps the host's handles alive. It is dropped after the last of our objects that needs them.
pub(crate) type Owner = Arc<dyn Any + Send + Sync>;

/// A gpu-allocator that host and engine share. Clones share the allocator, and each keeps the owner of the device
/// alive: the last clone to be dropped frees the memory before the device goes, in whatever order clones are dropped.
#[derive(Clone)]
pub struct SharedAllocator {
    allocator: Arc<Mutex<Allocator>>,
    // Drops after the allocator.
    _owner: Option<Owner>,
}

impl SharedAllocator {
    /// Shares an allocator. `owner` is a value that destroys the device when it is dropped. With `None`, or if the host
    /// keeps clones of the allocator's `Arc` elsewhere, the host must drop the allocator before its device.
    pub fn new(allocator: Arc<Mutex<Allocator>>, owner: Option<Owner>) -> Self {
        Self { allocator, _owner: owner }
    }

    /// Locks the allocator. Do not hold the lock while the engine makes or drops anything. The lock is not poisoned by
    /// a panic of another thread.
    pub fn lock(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The host's handles and settings: made by [`new`](Self::new), then changed field by field.
pub struct DeviceDesc<'a> {
    /// The instance, created for Vulkan 1.1 or later.
    pub instance: &'a ash::Instance,
    /// The physical device.
    pub physical_device: vk::PhysicalDevice,
    /// The device, with the extensions and features of [`requirements`](crate::requirements) enabled for
    /// the paths that will be used.
    pub device: &'a ash::Device,
    /// Limits to keep to; `None`: those of the driver. Transform feedback is used only if `transform_feedback_enabled`
    /// is set, too.
    pub caps: Option<DeviceCaps>,
    /// Whether `device` was created with VK_EXT_transform_feedback and its feature `transformFeedback`.
    pub transform_feedback_enabled: bool,
    /// The features that `device` was created with. Two of them are used: `vertexPipelineStoresAndAtomics`, for the
    /// baseline `vertex-store`, and `shaderInt64` on software drivers, which have faster kernels for block formats with
    /// it.
    pub enabled_features: vk::PhysicalDeviceFeatures,
    /// The host's pipeline cache, which the host loads and stores; `null()`: none. It belongs to this device and was
    /// made without `VK_PIPELINE_CACHE_CREATE_EXTERNALLY_SYNCHRONIZED_BIT`: any thread that makes crowds, or sets the
    /// output of post-morph passes, uses it without a lock. It must outlive the engine and everything made by it.
    /// The host may read it at any time (`vkGetPipelineCacheData`), make pipelines with it, and merge it into another;
    /// it may merge others into it (`vkMergePipelineCaches`) only while no thread is in a call of the engine that makes
    /// pipelines.
    pub pipeline_cache: vk::PipelineCache,
    /// The host's allocator; `None`: the engine makes its own. The engine's gives each of the first 128 buffers memory
    /// of exactly its size, returned when the buffer is dropped; further small buffers share blocks of 4 MiB to 64 MiB,
    /// of which one is kept for each type of memory. A host with many meshes, or near the device's limit of allocations
    /// (`maxMemoryAllocationCount`), should pass its own.
    pub allocator: Option<SharedAllocator>,
    /// The host's functions for device memory, if its allocator is not gpu-allocator: each buffer then has memory of
    /// its own from them, and `allocator` is not used. `None`: an allocator.
    pub memory: Option<Arc<dyn MemorySource>>,
    /// Whether `device` was created with the feature `bufferDeviceAddress`, and `allocator`, if given, was made for it:
    /// pose buffers can then have addresses ([`CrowdDesc::pose_usage`](crate::CrowdDesc::pose_usage)).
    pub buffer_device_address: bool,
    /// Whether the instance was created with VK_EXT_debug_utils: buffers, pipelines and descriptor sets then get names,
    /// and updates labels (one around each call that records any, in it one around each
    /// [step](crate::Crowd::step_names)), which layers, debuggers and profilers show.
    pub debug_names: bool,
    /// Families of the queues that use the engine's objects: those that upload, update and draw. With two or more, all
    /// of the engine's buffers are shared by them (`VK_SHARING_MODE_CONCURRENT`), and ownership is never transferred.
    /// Otherwise (none named: all run on one) they are `VK_SHARING_MODE_EXCLUSIVE`.
    /// [`MorphEngine`](crate::MorphEngine#several-queues) explains how to order the queues.
    pub queue_families: &'a [u32],
    /// The owner of the handles, such as an `Arc` that destroys the device when it is dropped. The engine and
    /// everything made by it keep it alive, so that they and the host's own clones may be dropped in any order. `None`:
    /// the host destroys the device after the last of them.
    pub owner: Option<Owner>,
}

impl<'a> DeviceDesc<'a> {
    /// Describes a device without extensions and features, with its own limits, no pipeline cache, and the engine's
    /// allocator.
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
            memory: None,
            buffer_device_address: false,
            debug_names: false,
            queue_families: &[],
            owner: None,
        }
    }
}

/// Returns the queue families, each once.
pub(super) fn distinct(families: &[u32]) -> Vec<u32> {
    let mut families = families.to_vec();
    families.sort_unstable();
    families.dedup();
    families
}

/// Number of buffers to which the engine's own allocator gives dedicated memory: a small part of the 4,096 allocations
/// that every device allows, but enough that a host with a few faces allocates no more than it needs.
const DEDICATED_MOST: u32 = 128;

/// Where memory comes from.
enum Allocators {
    Shared(SharedAllocator),
    Host(Arc<dyn MemorySource>),
}

/// Device functions and limits, shared by everything that the engine creates.
pub struct Device {
    /// The handle and its functions.
    pub raw: ash::Device,
    /// Functions of VK_EXT_transform_feedback, where the host enabled it.
    pub feedback: Option<ash::ext::transform_feedback::Device>,
    /// Limits and features.
    pub caps: DeviceCaps,
    /// The host's pipeline cache, or null.
    pub pipeline_cache: vk::PipelineCache,
    /// Whether buffers can have addresses.
    pub(crate) device_address: bool,
    /// The queue families that the host named, each once.
    pub families: Vec<u32>,
    names: Option<ash::ext::debug_utils::Device>,
    memory: Allocators,
    /// Number of buffers with dedicated memory, at most `DEDICATED_MOST`; none with a host's allocator.
    dedicated: AtomicU32,
    dedicated_most: u32,
    used: Mutex<MemoryStats>,
    /// The owner of the handles. Dropped last.
    _owner: Option<Owner>,
}

impl Device {
    /// # Safety
    /// Those of [`MorphEngine::new`](crate::MorphEngine::new).
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
        let memory = match (&desc.memory, &desc.allocator) {
            (Some(memory), _) => Allocators::Host(memory.clone()),
            (None, Some(allocator)) => Allocators::Shared(allocator.clone()),
            (None, None) => {
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
                Allocators::Shared(SharedAllocator::new(Arc::new(Mutex::new(allocator)), desc.owner.clone()))
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
            memory,
            dedicated: AtomicU32::new(0),
            dedicated_most,
            used: Mutex::default(),
            _owner: desc.owner.clone(),
        })
    }

    /// Names an object that this device made just now, if the host wants names.
    pub fn name(&self, object: impl vk::Handle, name: impl FnOnce() -> String) {
        let Some(functions) = &self.names else { return };
        // Names of meshes may contain any character.
        let Ok(name) = CString::new(name().replace('\0', " ")) else { return };
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
        // SAFETY: the host states that the extension is enabled; the object is of this device, and no other thread has
        // it yet. A failure to set the name does no harm.
        let _ = unsafe { functions.set_debug_utils_object_name(&info) };
    }

    /// Begins a label in `cmd`, if the host wants names.
    ///
    /// # Safety
    /// `cmd` is in the recording state on this device, and [`end_label`](Self::end_label) follows.
    pub unsafe fn begin_label(&self, cmd: vk::CommandBuffer, name: &str) {
        let Some(functions) = &self.names else { return };
        let name = CString::new(name).unwrap_or_default();
        // SAFETY: the host states that the extension is enabled; and the caller's obligations.
        unsafe { functions.cmd_begin_debug_utils_label(cmd, &vk::DebugUtilsLabelEXT::default().label_name(&name)) };
    }

    /// Ends the label begun last.
    ///
    /// # Safety
    /// See [`begin_label`](Self::begin_label), which was called.
    pub unsafe fn end_label(&self, cmd: vk::CommandBuffer) {
        // SAFETY: as there.
        self.names.iter().for_each(|functions| unsafe { functions.cmd_end_debug_utils_label(cmd) });
    }

    /// Memory for a buffer or an image.
    ///
    /// # Errors
    /// There is none; memory of the host's that is not mapped.
    pub fn allocate(
        &self,
        kind: MemoryKind,
        name: &str,
        requirements: vk::MemoryRequirements,
        own: AllocationScheme,
    ) -> Result<Memory> {
        let vk::MemoryRequirements { size, alignment, memory_type_bits: type_bits } = requirements;
        let memory = match &self.memory {
            Allocators::Host(source) => {
                let (required, preferred) = properties(kind.location());
                let request = MemoryRequest { size, alignment, type_bits, required, preferred };
                let host = source.allocate(&request).map_err(Error::vulkan("vkAllocateMemory"))?;
                let memory = Memory { kind, bytes: size, source: Source::Host(host) };
                if !required.is_empty() && host.mapped.is_null() {
                    source.free(host);
                    let text = format!("memory of the host's for '{name}' is not mapped");
                    return refuse(text, "map what is asked for with HOST_VISIBLE");
                }
                memory
            }
            Allocators::Shared(allocator) => {
                // Images have optimal tiling.
                let linear = !matches!(own, AllocationScheme::DedicatedImage(_));
                let location = kind.location();
                let allocate = |allocation_scheme| {
                    let desc = AllocationCreateDesc { name, requirements, location, linear, allocation_scheme };
                    allocator.lock().allocate(&desc)
                };
                let allocation = match self.dedicated.load(Ordering::Relaxed) < self.dedicated_most {
                    true => allocate(own),
                    // If there is no room for another block, there may be for this buffer alone.
                    false => allocate(AllocationScheme::GpuAllocatorManaged).or_else(|_| allocate(own)),
                };
                let allocation = allocation.map_err(|e| allocation_failed(name, size, &e))?;
                self.dedicated.fetch_add(allocation.is_dedicated().into(), Ordering::Relaxed);
                Memory { kind, bytes: allocation.size(), source: Source::Allocator(allocation) }
            }
        };
        let mut used = self.lock_used();
        let used = used.of(kind);
        (used.bytes, used.allocations) = (used.bytes + memory.bytes, used.allocations + 1);
        Ok(memory)
    }

    /// Gives memory back.
    pub fn free(&self, memory: Memory) {
        {
            let mut used = self.lock_used();
            let used = used.of(memory.kind);
            (used.bytes, used.allocations) = (used.bytes - memory.bytes, used.allocations - 1);
        }
        match (&self.memory, memory.source) {
            (Allocators::Shared(allocator), Source::Allocator(allocation)) => {
                self.dedicated.fetch_sub(allocation.is_dedicated().into(), Ordering::Relaxed);
                // An error here means that the allocator lost track of the memory; there is no caller to report it to.
                let _ = allocator.lock().free(allocation);
            }
            (Allocators::Host(source), Source::Host(memory)) => source.free(memory),
            _ => unreachable!("memory comes from where it goes to"),
        }
    }

    fn lock_used(&self) -> MutexGuard<'_, MemoryStats> {
        self.used.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Memory by kind, and in all.
    pub(crate) fn used(&self) -> MemoryStats {
        let used = *self.lock_used();
        let allocated = match &self.memory {
            Allocators::Shared(allocator) => allocator.lock().capacity(),
            Allocators::Host(_) => used.total(),
        };
        MemoryStats { allocated, ..used }
    }
}

/// The error for an allocation of `bytes` for `name` that failed.
pub fn allocation_failed(name: &str, bytes: u64, error: &AllocationError) -> Error {
    // Except for ERROR_OUT_OF_DEVICE_MEMORY, gpu-allocator reports the result of vkAllocateMemory as text.
    let text = error.to_string();
    let what = |why: &str| format!("no memory for '{name}' ({bytes} bytes): {why}");
    let fewer = "destroy objects that are no longer needed, or pass your own allocator that makes fewer allocations";
    let results = [(vk::Result::ERROR_OUT_OF_HOST_MEMORY, LESS), (vk::Result::ERROR_TOO_MANY_OBJECTS, fewer)];
    for (result, remedy) in results {
        if text.contains("vkAllocateMemory") && text.ends_with(&format!("{result:?}")) {
            return Error::out_of_memory(what(&format!("vkAllocateMemory failed: {result:?}")), remedy);
        }
    }
    if matches!(error, AllocationError::OutOfMemory | AllocationError::FailedToMap(_)) {
        return Error::out_of_memory(what(&text), LESS);
    }
    Error::invalid(what(&text), "report this with the device's name, or pass your own allocator")
}
