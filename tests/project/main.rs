//! The repository: dependencies, documents, modules, examples and set-up.

mod dependencies;
mod documents;
mod examples;
mod programs;
mod rooms;
mod spirv;
mod with_vulkan;
