//! The errors that each call may return, by the specification.

use ash::vk;

const HOST: vk::Result = vk::Result::ERROR_OUT_OF_HOST_MEMORY;
const DEVICE: vk::Result = vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
const LOST: vk::Result = vk::Result::ERROR_DEVICE_LOST;
const INITIALIZATION: vk::Result = vk::Result::ERROR_INITIALIZATION_FAILED;
const INCOMPATIBLE: vk::Result = vk::Result::ERROR_INCOMPATIBLE_DRIVER;
const LAYER: vk::Result = vk::Result::ERROR_LAYER_NOT_PRESENT;
const EXTENSION: vk::Result = vk::Result::ERROR_EXTENSION_NOT_PRESENT;
const FEATURE: vk::Result = vk::Result::ERROR_FEATURE_NOT_PRESENT;
const FORMAT: vk::Result = vk::Result::ERROR_FORMAT_NOT_SUPPORTED;
const TOO_MANY: vk::Result = vk::Result::ERROR_TOO_MANY_OBJECTS;
const MAP: vk::Result = vk::Result::ERROR_MEMORY_MAP_FAILED;
const FRAGMENTED: vk::Result = vk::Result::ERROR_FRAGMENTED_POOL;
const POOL: vk::Result = vk::Result::ERROR_OUT_OF_POOL_MEMORY;
const FRAGMENTATION: vk::Result = vk::Result::ERROR_FRAGMENTATION;
const SURFACE: vk::Result = vk::Result::ERROR_SURFACE_LOST_KHR;
const WINDOW: vk::Result = vk::Result::ERROR_NATIVE_WINDOW_IN_USE_KHR;
const DATE: vk::Result = vk::Result::ERROR_OUT_OF_DATE_KHR;

/// Returns the errors of `call`, for calls that the layer sees, without those of extensions that deltamorph does not
/// use.
pub fn errors(call: &str) -> &'static [vk::Result] {
    match call {
        "vkCreateInstance" => &[HOST, DEVICE, INITIALIZATION, LAYER, EXTENSION, INCOMPATIBLE],
        "vkEnumeratePhysicalDevices" => &[HOST, DEVICE, INITIALIZATION],
        "vkEnumerateDeviceExtensionProperties" => &[HOST, DEVICE, LAYER],
        "vkGetPhysicalDeviceImageFormatProperties" => &[HOST, DEVICE, FORMAT],
        "vkCreateDevice" => &[HOST, DEVICE, INITIALIZATION, EXTENSION, FEATURE, TOO_MANY, LOST],
        // The text of both includes TOO_MANY_OBJECTS, though newer lists of their errors omit it.
        "vkAllocateMemory" | "vkCreateSampler" => &[HOST, DEVICE, TOO_MANY],
        "vkMapMemory" => &[HOST, DEVICE, MAP],
        "vkCreateDescriptorPool" => &[HOST, DEVICE, FRAGMENTATION],
        "vkAllocateDescriptorSets" => &[HOST, DEVICE, FRAGMENTED, POOL],
        "vkResetFences" | "vkResetCommandBuffer" | "vkResetCommandPool" => &[DEVICE],
        "vkQueueSubmit"
        | "vkQueueWaitIdle"
        | "vkDeviceWaitIdle"
        | "vkGetFenceStatus"
        | "vkWaitForFences"
        | "vkGetQueryPoolResults" => &[HOST, DEVICE, LOST],
        "vkGetPhysicalDeviceSurfaceCapabilitiesKHR"
        | "vkGetPhysicalDeviceSurfaceFormatsKHR"
        | "vkGetPhysicalDeviceSurfacePresentModesKHR"
        | "vkGetPhysicalDeviceSurfaceSupportKHR" => &[HOST, DEVICE, SURFACE],
        "vkCreateSwapchainKHR" => &[HOST, DEVICE, LOST, SURFACE, WINDOW, INITIALIZATION],
        "vkAcquireNextImageKHR" | "vkQueuePresentKHR" => &[HOST, DEVICE, LOST, DATE, SURFACE],
        _ => &[HOST, DEVICE],
    }
}
