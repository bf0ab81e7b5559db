//! The repository: its public items, dependencies, documents, modules, examples and set-up.

mod dependencies;
mod documents;
mod examples;
mod face;
mod programs;
mod rooms;
mod spirv;
mod with_vulkan;
