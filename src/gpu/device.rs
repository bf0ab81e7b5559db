//! The host's device, borrowed: handles, limits, allocator.

use super::caps::DeviceCaps;
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use std::any::Any;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A gpu-allocator that host and engine may share.
pub type SharedAllocator = Arc<Mutex<Allocator>>;

/// What the host hands in.
pub struct DeviceDesc<'a> {
    /// The instance, created for Vulkan 1.1 or later.
    pub instance: &'a ash::Instance,
    /// The physical device.
    pub physical_device: vk::PhysicalDevice,
    /// The device, with the extensions and features of [`requirements`](super::caps::requirements) enabled for
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
    /// The host's allocator; `None`: the engine makes one of its own.
    pub allocator: Option<SharedAllocator>,
}

/// Device functions and limits, shared by everything that the engine creates.
pub(crate) struct Device {
    pub(crate) raw: ash::Device,
    pub(crate) feedback: Option<ash::ext::transform_feedback::Device>,
    pub(crate) caps: DeviceCaps,
    allocator: SharedAllocator,
    /// What owns the handles, where that is not the host. Drops last.
    _owner: Option<Arc<dyn Any + Send + Sync>>,
}

impl Device {
    /// # Safety
    /// - The handles of `desc` are alive, belong together, and outlive the value returned and all made from it, or live as
    ///   long as `owner`.
    /// - `desc.caps` does not exceed what the device has.
    /// - `desc.transform_feedback_enabled` is true only if extension and feature were enabled, and
    ///   `desc.enabled_features` has no other features than those that were.
    pub(crate) unsafe fn borrow(desc: &DeviceDesc<'_>, owner: Option<Arc<dyn Any + Send + Sync>>) -> Result<Self> {
        let mut caps = match &desc.caps {
            Some(caps) => caps.clone(),
            // SAFETY: physical device and instance belong together and are alive: the caller's first obligation.
            None => unsafe { DeviceCaps::query(desc.instance, desc.physical_device) },
        };
        if !desc.transform_feedback_enabled {
            caps.transform_feedback = None;
        }
        caps.vertex_stores &= desc.enabled_features.vertex_pipeline_stores_and_atomics == vk::TRUE;
        caps.int64 &= desc.enabled_features.shader_int64 == vk::TRUE;
        let feedback = caps
            .transform_feedback
            .is_some()
            .then(|| ash::ext::transform_feedback::Device::new(desc.instance, desc.device));
        let allocator = match &desc.allocator {
            Some(allocator) => allocator.clone(),
            None => Arc::new(Mutex::new(
                Allocator::new(&AllocatorCreateDesc {
                    instance: desc.instance.clone(),
                    device: desc.device.clone(),
                    physical_device: desc.physical_device,
                    debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
                    buffer_device_address: false,
                    allocation_sizes: gpu_allocator::AllocationSizes::default(),
                })
                .map_err(|e| allocation_failed("the allocator", 0, &e))?,
            )),
        };
        Ok(Self { raw: desc.device.clone(), feedback, caps, allocator, _owner: owner })
    }

    /// The allocator; a panic elsewhere while it was locked does not spoil it for us.
    pub(crate) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An error for an allocation that failed.
pub(crate) fn allocation_failed(name: &str, bytes: u64, error: &gpu_allocator::AllocationError) -> Error {
    use gpu_allocator::AllocationError as Failure;
    let what = format!("no memory for '{name}' ({bytes} bytes): {error}");
    match error {
        Failure::OutOfMemory | Failure::FailedToMap(_) => {
            Error::out_of_memory(what, "free memory, or use fewer instances, fewer slots or the snorm16 format")
        }
        _ => Error::invalid(what, "report this with the device's name, or hand in an allocator of your own"),
    }
}
