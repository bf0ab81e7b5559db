//! Draws the poses of deltamorph as an engine would: the crowd's own buffer is the vertex buffer, decoded by the shader that
//! deltamorph ships (`glsl/host/pose.glsl`). For pictures from the command line, and for its window.
//!
//! - [`Renderer`] draws [`Head`]s of a [`Model`] into a [`Target`], which is an image view of the host's: an image of its own,
//!   or one of a swapchain. It records into the host's command buffer, and never submits or waits.
//! - [`Scene`] says how: a [`Camera`] that fits what there is to see, a [`Light`], what to [`Show`].
//! - [`wrinkles`] come where a pose compresses the skin.
//! - [`parts`] tells skin from eyes and teeth.
//! - [`Studio`] brings the image as well, on a device of [`headless`](deltamorph_headless), with several frames in flight.
//!
//! Vulkan 1.1, four samples a pixel, no extension or feature.

mod camera;
mod glow;
mod memory;
mod model;
mod modules;
mod parts;
mod passes;
mod poses;
mod record;
mod renderer;
mod scene;
mod studio;
mod target;
pub mod wrinkles;

pub use camera::{Camera, View};
pub use glow::Glow;
pub use memory::Buffer;
pub use model::Model;
pub use parts::{Material, Part, parts};
pub use passes::RendererDesc;
pub use poses::{Poses, StoredPose};
pub use renderer::Renderer;
pub use scene::{Head, Light, Masks, Scene, Show, heat};
pub use studio::{Picture, Studio, StudioDesc};
pub use target::Target;
