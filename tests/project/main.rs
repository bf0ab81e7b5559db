//! The repository itself: its face, dependencies, modules, examples and set-up.

mod dependencies;
mod examples;
mod face;
mod programs;
mod rooms;
mod spirv;
mod with_vulkan;
