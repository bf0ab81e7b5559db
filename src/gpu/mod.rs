//! The GPU layer: all code that calls Vulkan.
//!
//! Files by Vulkan concern: [`caps`] (limits and features of a device), `tuning` (kernel choices that suit it),
//! [`device`] (the host's device, borrowed), `memory` (buffers, rings of lists), `mesh` (an uploaded mesh), `parts`
//! (parts of an asset that is too large for one descriptor), `descriptors`, `pipelines`, `barriers`; for baselines
//! `images` and `blending`. No file here knows a technique.

pub(crate) mod barriers;
#[cfg(feature = "baselines")]
mod blending;
pub mod caps;
pub mod descriptors;
pub mod device;
#[cfg(feature = "baselines")]
pub(crate) mod images;
pub mod memory;
pub(crate) mod mesh;
pub(crate) mod parts;
pub mod pipelines;
pub(crate) mod tuning;

use crate::error::Error;
use ash::vk;

/// Returns a function for `map_err` that makes an [`Error::Vulkan`] for `call`.
pub(crate) fn failed(call: &'static str) -> impl Fn(vk::Result) -> Error {
    Error::vulkan(call)
}

/// The remedy if there is no memory for a buffer.
pub(crate) const LESS: &str = "free memory, or use fewer instances, slots or frames in flight, 16-bit poses (fixed16) \
                               or the format 'small'";

/// The remedy for a call that returned `result`.
pub(crate) fn remedy(call: &str, result: vk::Result) -> &'static str {
    use vk::Result as Vk;
    match result {
        Vk::ERROR_OUT_OF_HOST_MEMORY
        | Vk::ERROR_OUT_OF_DEVICE_MEMORY
        | Vk::ERROR_OUT_OF_POOL_MEMORY
        | Vk::ERROR_FRAGMENTED_POOL
        | Vk::ERROR_FRAGMENTATION
        | Vk::ERROR_MEMORY_MAP_FAILED => match call {
            "vkAllocateMemory"
            | "vkCreateBuffer"
            | "vkBindBufferMemory"
            | "vkMapMemory"
            | "vkCreateBufferView"
            | "vkCreateDescriptorPool"
            | "vkAllocateDescriptorSets" => LESS,
            "vkCreateImage" | "vkBindImageMemory" | "vkCreateImageView" | "vkCreateSwapchainKHR" => {
                "free memory, or use smaller images"
            }
            // Other objects are small, whatever the host does.
            _ => "free memory: end other programs, or destroy objects that are no longer needed",
        },
        Vk::ERROR_TOO_MANY_OBJECTS => "destroy objects that are no longer needed",
        Vk::ERROR_DEVICE_LOST => "create the device anew; its buffers are gone",
        Vk::ERROR_SURFACE_LOST_KHR | Vk::ERROR_NATIVE_WINDOW_IN_USE_KHR => "open the window anew",
        Vk::ERROR_INCOMPATIBLE_DRIVER | Vk::ERROR_INITIALIZATION_FAILED => {
            "check that a Vulkan 1.1 driver is installed and works (./with-vulkan installs lavapipe), or use the path \
             'cpu'"
        }
        _ => "this is a bug in deltamorph or in the driver: run with the validation layers on",
    }
}

#[cfg(test)]
mod tests {
    use super::remedy;
    use ash::vk::Result as Vk;

    #[test]
    fn remedies_fit_call_and_result() {
        for memory in [Vk::ERROR_OUT_OF_HOST_MEMORY, Vk::ERROR_OUT_OF_DEVICE_MEMORY, Vk::ERROR_OUT_OF_POOL_MEMORY] {
            // Fewer instances do not make these objects smaller.
            for call in ["vkCreateInstance", "vkCreateDevice", "vkCreateFence", "vkCreateQueryPool", "vkWaitForFences"]
            {
                let text = remedy(call, memory);
                assert!(text.starts_with("free memory") && !text.contains("instances"), "{call}: {text}");
            }
            for call in ["vkAllocateMemory", "vkCreateBuffer", "vkCreateDescriptorPool"] {
                let text = remedy(call, memory);
                assert!(
                    ["instances", "slots", "frames in flight", "fixed16"].iter().all(|s| text.contains(s)),
                    "{text}"
                );
                assert!(!text.contains("snorm16"), "poses, not deltas, take the memory: {text}");
            }
            assert!(remedy("vkCreateImage", memory).contains("smaller images"));
        }
        for call in ["vkCreateBuffer", "vkQueueSubmit", "vkAcquireNextImageKHR"] {
            assert!(remedy(call, Vk::ERROR_DEVICE_LOST).starts_with("create the device anew"), "{call}");
        }
        assert!(remedy("vkCreateInstance", Vk::ERROR_INCOMPATIBLE_DRIVER).contains("driver is installed"));
        assert!(remedy("vkQueuePresentKHR", Vk::ERROR_SURFACE_LOST_KHR).contains("window"));
        assert!(remedy("vkCreateBuffer", Vk::ERROR_UNKNOWN).contains("validation layers"));
    }
}
