//! The repository itself: its face, dependencies, documents, modules, examples and set-up.

mod dependencies;
mod documents;
mod examples;
mod face;
mod programs;
mod rooms;
mod spirv;
mod with_vulkan;
