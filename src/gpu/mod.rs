//! Below the gpu line: everything that calls Vulkan.
pub mod shaders;
