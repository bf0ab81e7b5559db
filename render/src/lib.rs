//! Draws poses of deltamorph as an engine would: the crowd's pose buffer is the vertex buffer, decoded by the shader
//! code that deltamorph provides (`glsl/host/pose.glsl`). Used for the command line's pictures and window.
//!
//! - [`Renderer`] draws [`Head`]s of a [`Model`] into a [`Target`]: an image view of the host's, for its own image or
//!   one of a swapchain. It records into the host's command buffer, and never submits or waits.
//! - [`Scene`] describes the picture: a [`Camera`] that fits the scene, a [`Light`], and what to [`Show`].
//! - [`wrinkles`] appear where a pose compresses the skin.
//! - [`parts`] separates skin from eyes and teeth, and takes the [`Surface`] that a file states. Parts that nothing moves
//!   are drawn with a model, without a pose ([`Model::set_still`]).
//! - [`Studio`] provides the image as well, on a device of [`headless`](deltamorph_headless), with several frames in
//!   flight.
//!
//! Needs Vulkan 1.1 and four samples per pixel, but no extension or feature.

mod camera;
mod cull;
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
pub mod srgb;
mod step;
mod studio;
mod target;
pub mod wrinkles;

pub use camera::{Camera, View};
pub use cull::PoseBounds;
pub use glow::Glow;
pub use memory::Buffer;
pub use model::Model;
pub use parts::{Face, Material, Part, Surface, parts};
pub use passes::RendererDesc;
pub use poses::{Poses, StoredPose};
pub use renderer::Renderer;
pub use scene::{Head, Light, Masks, Scene, Show, heat};
pub use step::{Step, Stepped};
pub use studio::{Picture, Studio, StudioDesc};
pub use target::Target;
