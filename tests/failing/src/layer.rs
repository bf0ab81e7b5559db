//! The Vulkan functions of the layer, and their lookup by the loader.
#![allow(non_snake_case)] // functions have the names of their types

use crate::state::{Function, Next, below, enter, fails, next, state};
use ash::vk::{self, Handle as _};
use std::ffi::{CStr, c_char, c_void};
use std::mem::transmute;

/// Converts `PFN_vkCall` to `vkCall`, null-terminated.
const fn name(pfn: &'static str) -> &'static CStr {
    match CStr::from_bytes_with_nul(pfn.as_bytes().split_at(4).1) {
        Ok(name) => name,
        Err(_) => panic!("one zero, at the end"),
    }
}

macro_rules! name {
    ($pfn:ident) => {
        name(concat!(stringify!($pfn), "\0"))
    };
}

/// Defines functions, and a list of their names.
macro_rules! functions {
    ($find:ident, $names:ident: $($pfn:ident)*) => {
        fn $find(name: &CStr) -> Option<*const ()> {
            $(if name == name!($pfn) {
                return Some($pfn as vk::$pfn as *const ());
            })*
            None
        }
        pub(crate) const $names: &[&CStr] = &[$(name!($pfn)),*];
    };
}

/// Defines calls that make no objects: counted, and passed on unless they fail. Named by their types, which the
/// compiler checks.
macro_rules! calls {
    ($($pfn:ident($handle:ident: $of:ty $(, $more:ident: $type:ty)*);)*) => {
        $(
            unsafe extern "system" fn $pfn($handle: $of $(, $more: $type)*) -> vk::Result {
                // SAFETY: the caller follows the specification, so the handle is alive; the function below has this
                // type.
                unsafe {
                    match enter(name!($pfn), $handle.as_raw()) {
                        Ok(below) => transmute::<Function, vk::$pfn>(below)($handle $(, $more)*),
                        Err(error) => error,
                    }
                }
            }
        )*
        functions!(call, CALLS: $($pfn)*);
    };
}

calls! {
    PFN_vkEnumeratePhysicalDevices(instance: vk::Instance, count: *mut u32, devices: *mut vk::PhysicalDevice);
    PFN_vkEnumerateDeviceExtensionProperties(
        device: vk::PhysicalDevice, layer: *const c_char, count: *mut u32, properties: *mut vk::ExtensionProperties);
    PFN_vkGetPhysicalDeviceImageFormatProperties(
        device: vk::PhysicalDevice, format: vk::Format, kind: vk::ImageType, tiling: vk::ImageTiling,
        usage: vk::ImageUsageFlags, flags: vk::ImageCreateFlags, properties: *mut vk::ImageFormatProperties);
    PFN_vkGetPhysicalDeviceSurfaceCapabilitiesKHR(
        device: vk::PhysicalDevice, surface: vk::SurfaceKHR, capabilities: *mut vk::SurfaceCapabilitiesKHR);
    PFN_vkGetPhysicalDeviceSurfaceFormatsKHR(
        device: vk::PhysicalDevice, surface: vk::SurfaceKHR, count: *mut u32, formats: *mut vk::SurfaceFormatKHR);
    PFN_vkGetPhysicalDeviceSurfacePresentModesKHR(
        device: vk::PhysicalDevice, surface: vk::SurfaceKHR, count: *mut u32, modes: *mut vk::PresentModeKHR);
    PFN_vkGetPhysicalDeviceSurfaceSupportKHR(
        device: vk::PhysicalDevice, family: u32, surface: vk::SurfaceKHR, supported: *mut vk::Bool32);
    PFN_vkMapMemory(
        device: vk::Device, memory: vk::DeviceMemory, at: u64, size: u64, flags: vk::MemoryMapFlags, data: *mut *mut c_void);
    PFN_vkFlushMappedMemoryRanges(device: vk::Device, count: u32, ranges: *const vk::MappedMemoryRange<'_>);
    PFN_vkInvalidateMappedMemoryRanges(device: vk::Device, count: u32, ranges: *const vk::MappedMemoryRange<'_>);
    PFN_vkBindBufferMemory(device: vk::Device, buffer: vk::Buffer, memory: vk::DeviceMemory, at: u64);
    PFN_vkBindImageMemory(device: vk::Device, image: vk::Image, memory: vk::DeviceMemory, at: u64);
    PFN_vkDeviceWaitIdle(device: vk::Device);
    PFN_vkResetFences(device: vk::Device, count: u32, fences: *const vk::Fence);
    PFN_vkGetFenceStatus(device: vk::Device, fence: vk::Fence);
    PFN_vkWaitForFences(device: vk::Device, count: u32, fences: *const vk::Fence, all: vk::Bool32, timeout: u64);
    PFN_vkGetQueryPoolResults(
        device: vk::Device, pool: vk::QueryPool, first: u32, count: u32, size: usize, data: *mut c_void, stride: u64,
        flags: vk::QueryResultFlags);
    PFN_vkGetPipelineCacheData(device: vk::Device, cache: vk::PipelineCache, size: *mut usize, data: *mut c_void);
    PFN_vkAllocateDescriptorSets(
        device: vk::Device, info: *const vk::DescriptorSetAllocateInfo<'_>, sets: *mut vk::DescriptorSet);
    PFN_vkResetCommandPool(device: vk::Device, pool: vk::CommandPool, flags: vk::CommandPoolResetFlags);
    PFN_vkAllocateCommandBuffers(
        device: vk::Device, info: *const vk::CommandBufferAllocateInfo<'_>, buffers: *mut vk::CommandBuffer);
    PFN_vkBeginCommandBuffer(buffer: vk::CommandBuffer, info: *const vk::CommandBufferBeginInfo<'_>);
    PFN_vkEndCommandBuffer(buffer: vk::CommandBuffer);
    PFN_vkResetCommandBuffer(buffer: vk::CommandBuffer, flags: vk::CommandBufferResetFlags);
    PFN_vkQueueSubmit(queue: vk::Queue, count: u32, submits: *const vk::SubmitInfo<'_>, fence: vk::Fence);
    PFN_vkQueueWaitIdle(queue: vk::Queue);
    PFN_vkGetSwapchainImagesKHR(
        device: vk::Device, swapchain: vk::SwapchainKHR, count: *mut u32, images: *mut vk::Image);
    PFN_vkAcquireNextImageKHR(
        device: vk::Device, swapchain: vk::SwapchainKHR, timeout: u64, semaphore: vk::Semaphore, fence: vk::Fence,
        image: *mut u32);
    PFN_vkQueuePresentKHR(queue: vk::Queue, info: *const vk::PresentInfoKHR<'_>);
}

/// Defines calls that make an object (memory, too), and those that destroy it.
macro_rules! objects {
    ($($object:ident of $owner:ident: $destroy:ident $(, $create:ident $info:ident)*;)*) => {
        $(
            $(unsafe extern "system" fn $create(
                owner: vk::$owner,
                info: *const vk::$info<'_>,
                allocator: *const vk::AllocationCallbacks<'_>,
                object: *mut vk::$object,
            ) -> vk::Result {
                // SAFETY: as in `calls`; after success there is an object.
                unsafe {
                    let below = match enter(name!($create), owner.as_raw()) {
                        Ok(below) => transmute::<Function, vk::$create>(below),
                        Err(error) => return error,
                    };
                    let result = below(owner, info, allocator, object);
                    if result == vk::Result::SUCCESS {
                        state().born(stringify!($object), (*object).as_raw(), owner.as_raw());
                    }
                    result
                }
            })*

            unsafe extern "system" fn $destroy(
                owner: vk::$owner,
                object: vk::$object,
                allocator: *const vk::AllocationCallbacks<'_>,
            ) {
                // Handles that are not alive are not passed on, null included.
                if state().gone(stringify!($object), object.as_raw()) {
                    // SAFETY: as in `calls`.
                    unsafe {
                        let below = below(name!($destroy), owner.as_raw());
                        transmute::<Function, vk::$destroy>(below)(owner, object, allocator);
                    }
                }
            }
        )*
        functions!(object, OBJECTS: $($($create)*)*);
        functions!(destroyed, DESTROYED: $($destroy)*);
    };
}

objects! {
    Fence of Device: PFN_vkDestroyFence, PFN_vkCreateFence FenceCreateInfo;
    Semaphore of Device: PFN_vkDestroySemaphore, PFN_vkCreateSemaphore SemaphoreCreateInfo;
    Event of Device: PFN_vkDestroyEvent, PFN_vkCreateEvent EventCreateInfo;
    QueryPool of Device: PFN_vkDestroyQueryPool, PFN_vkCreateQueryPool QueryPoolCreateInfo;
    Buffer of Device: PFN_vkDestroyBuffer, PFN_vkCreateBuffer BufferCreateInfo;
    BufferView of Device: PFN_vkDestroyBufferView, PFN_vkCreateBufferView BufferViewCreateInfo;
    Image of Device: PFN_vkDestroyImage, PFN_vkCreateImage ImageCreateInfo;
    ImageView of Device: PFN_vkDestroyImageView, PFN_vkCreateImageView ImageViewCreateInfo;
    ShaderModule of Device: PFN_vkDestroyShaderModule, PFN_vkCreateShaderModule ShaderModuleCreateInfo;
    PipelineCache of Device: PFN_vkDestroyPipelineCache, PFN_vkCreatePipelineCache PipelineCacheCreateInfo;
    PipelineLayout of Device: PFN_vkDestroyPipelineLayout, PFN_vkCreatePipelineLayout PipelineLayoutCreateInfo;
    Sampler of Device: PFN_vkDestroySampler, PFN_vkCreateSampler SamplerCreateInfo;
    DescriptorSetLayout of Device: PFN_vkDestroyDescriptorSetLayout, PFN_vkCreateDescriptorSetLayout DescriptorSetLayoutCreateInfo;
    DescriptorPool of Device: PFN_vkDestroyDescriptorPool, PFN_vkCreateDescriptorPool DescriptorPoolCreateInfo;
    Framebuffer of Device: PFN_vkDestroyFramebuffer, PFN_vkCreateFramebuffer FramebufferCreateInfo;
    RenderPass of Device: PFN_vkDestroyRenderPass, PFN_vkCreateRenderPass RenderPassCreateInfo;
    CommandPool of Device: PFN_vkDestroyCommandPool, PFN_vkCreateCommandPool CommandPoolCreateInfo;
    DeviceMemory of Device: PFN_vkFreeMemory, PFN_vkAllocateMemory MemoryAllocateInfo;
    Pipeline of Device: PFN_vkDestroyPipeline;
    SwapchainKHR of Device: PFN_vkDestroySwapchainKHR, PFN_vkCreateSwapchainKHR SwapchainCreateInfoKHR;
    SurfaceKHR of Instance: PFN_vkDestroySurfaceKHR, PFN_vkCreateXlibSurfaceKHR XlibSurfaceCreateInfoKHR,
        PFN_vkCreateXcbSurfaceKHR XcbSurfaceCreateInfoKHR;
}

/// Defines calls that make several pipelines at once.
macro_rules! pipelines {
    ($($create:ident as $info:ident;)*) => {
        $(
            unsafe extern "system" fn $create(
                device: vk::Device,
                cache: vk::PipelineCache,
                count: u32,
                infos: *const vk::$info<'_>,
                allocator: *const vk::AllocationCallbacks<'_>,
                pipelines: *mut vk::Pipeline,
            ) -> vk::Result {
                // SAFETY: as in `calls`; there is room for this many pipelines.
                unsafe {
                    let all = std::slice::from_raw_parts_mut(pipelines, count as usize);
                    // Pipelines that could not be made are null.
                    all.fill(vk::Pipeline::null());
                    let below = match enter(name!($create), device.as_raw()) {
                        Ok(below) => transmute::<Function, vk::$create>(below),
                        Err(error) => return error,
                    };
                    let result = below(device, cache, count, infos, allocator, pipelines);
                    for made in all.iter().filter(|pipeline| !pipeline.is_null()) {
                        state().born("Pipeline", made.as_raw(), device.as_raw());
                    }
                    result
                }
            }
        )*
        functions!(pipeline, PIPELINES: $($create)*);
    };
}

pipelines! {
    PFN_vkCreateGraphicsPipelines as GraphicsPipelineCreateInfo;
    PFN_vkCreateComputePipelines as ComputePipelineCreateInfo;
}

/// The loader's structure in the creation information of instances and devices for each layer: the next layer's
/// functions.
#[repr(C)]
struct LoaderInfo<L> {
    kind: vk::StructureType,
    next: *mut Self,
    /// 0 for this kind.
    function: u32,
    link: *mut L,
}

#[repr(C)]
struct InstanceLink {
    next: *mut Self,
    get: vk::PFN_vkGetInstanceProcAddr,
}

#[repr(C)]
struct DeviceLink {
    next: *mut Self,
    of_instance: vk::PFN_vkGetInstanceProcAddr,
    get: vk::PFN_vkGetDeviceProcAddr,
}

/// Finds the pointer to this layer's link, to be read and advanced to the next.
///
/// # Safety
/// `chain` is the loader's chain for a layer, of this kind, with links `L`.
unsafe fn link<'a, L>(chain: *const c_void, kind: vk::StructureType) -> &'a mut *mut L {
    let mut info = chain.cast_mut().cast::<LoaderInfo<L>>();
    // SAFETY: all elements of the chain begin with a kind and a next pointer; one of them is the one looked for.
    unsafe {
        while (*info).kind != kind || (*info).function != 0 {
            info = (*info).next;
        }
        &mut (*info).link
    }
}

unsafe extern "system" fn PFN_vkCreateInstance(
    info: *const vk::InstanceCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    instance: *mut vk::Instance,
) -> vk::Result {
    // SAFETY: the loader follows its interface; the function below has this type.
    unsafe {
        if let Some(error) = fails(name!(PFN_vkCreateInstance), 0) {
            return error;
        }
        let place = link::<InstanceLink>((*info).p_next, vk::StructureType::LOADER_INSTANCE_CREATE_INFO);
        let get = (**place).get;
        *place = (**place).next;
        let below = get(vk::Instance::null(), c"vkCreateInstance".as_ptr()).expect("a function below");
        let result = transmute::<Function, vk::PFN_vkCreateInstance>(below)(info, allocator, instance);
        if result == vk::Result::SUCCESS {
            state().made((*instance).as_raw(), Next::Instance(*instance, get));
        }
        result
    }
}

unsafe extern "system" fn PFN_vkCreateDevice(
    physical: vk::PhysicalDevice,
    info: *const vk::DeviceCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    device: *mut vk::Device,
) -> vk::Result {
    // SAFETY: as for `PFN_vkCreateInstance`; a physical device belongs to an instance.
    unsafe {
        if let Some(error) = fails(name!(PFN_vkCreateDevice), physical.as_raw()) {
            return error;
        }
        let Some(Next::Instance(instance, _)) = next(physical.as_raw()) else {
            unreachable!("a device of no instance")
        };
        let place = link::<DeviceLink>((*info).p_next, vk::StructureType::LOADER_DEVICE_CREATE_INFO);
        let DeviceLink { of_instance, get, .. } = **place;
        *place = (**place).next;
        let below = of_instance(instance, c"vkCreateDevice".as_ptr()).expect("a function below");
        let result = transmute::<Function, vk::PFN_vkCreateDevice>(below)(physical, info, allocator, device);
        if result == vk::Result::SUCCESS {
            state().made((*device).as_raw(), Next::Device(*device, get));
        }
        result
    }
}

/// Defines the destruction of parents: their children are counted before.
macro_rules! parents {
    ($($parent:ident: $destroy:ident;)*) => {
        $(unsafe extern "system" fn $destroy(parent: vk::$parent, allocator: *const vk::AllocationCallbacks<'_>) {
            if !parent.is_null() {
                // SAFETY: as in `calls`.
                unsafe {
                    let below = below(name!($destroy), parent.as_raw());
                    state().unmade(parent.as_raw());
                    transmute::<Function, vk::$destroy>(below)(parent, allocator);
                }
            }
        })*
    };
}

parents! {
    Instance: PFN_vkDestroyInstance;
    Device: PFN_vkDestroyDevice;
}

functions!(parent, PARENTS: PFN_vkCreateInstance PFN_vkCreateDevice);
functions!(entry, ENTRIES: PFN_vkDestroyInstance PFN_vkDestroyDevice PFN_vkGetInstanceProcAddr PFN_vkGetDeviceProcAddr);

/// All functions of the layer.
pub(crate) const ALL: [&[&CStr]; 6] = [CALLS, OBJECTS, DESTROYED, PIPELINES, PARENTS, ENTRIES];

/// Returns the layer's function, if it has one, unless the layers below lack it: extensions that are not enabled.
///
/// # Safety
/// `handle` is a live dispatchable handle, or 0; `name` is null-terminated.
pub(crate) unsafe fn find(handle: u64, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: the caller's obligation.
    let (name, next) = unsafe { (CStr::from_ptr(name), if handle == 0 { None } else { next(handle) }) };
    let all = [call, object, destroyed, pipeline, parent, entry];
    let ours = all.iter().find_map(|find| find(name));
    // SAFETY: it is a function's address, and the caller knows its type by its name.
    let ours = ours.map(|ours| unsafe { transmute::<*const (), Function>(ours) });
    match next {
        Some(next) => next.function(name).map(|below| ours.unwrap_or(below)),
        None => ours,
    }
}

unsafe extern "system" fn PFN_vkGetInstanceProcAddr(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    // SAFETY: as in `calls`.
    unsafe { find(instance.as_raw(), name) }
}

unsafe extern "system" fn PFN_vkGetDeviceProcAddr(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: as in `calls`.
    unsafe { find(device.as_raw(), name) }
}

/// The interface negotiation of loader and layer.
#[repr(C)]
pub struct Negotiation {
    kind: i32,
    next: *mut c_void,
    version: u32,
    instance: vk::PFN_vkGetInstanceProcAddr,
    device: vk::PFN_vkGetDeviceProcAddr,
    physical: Option<vk::PFN_vkGetInstanceProcAddr>,
}

/// The loader's entry point.
///
/// # Safety
/// Called by the loader, with valid arguments.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vkNegotiateLoaderLayerInterfaceVersion(with: *mut Negotiation) -> vk::Result {
    // SAFETY: the caller's obligation.
    let with = unsafe { &mut *with };
    (with.version, with.physical) = (2, None);
    (with.instance, with.device) = (PFN_vkGetInstanceProcAddr, PFN_vkGetDeviceProcAddr);
    vk::Result::SUCCESS
}
