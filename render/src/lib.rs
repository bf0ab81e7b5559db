//! Draws poses of deltamorph as an engine would: the crowd's pose buffer is the vertex buffer, decoded by the shader
//! code that deltamorph provides (`glsl/host/pose.glsl`). Used for the command line's pictures and window.
//!
//! - [`Heads`] are a crowd on the device or on the processor, and draw it into [`Target`]s: images to copy from, as
//!   into those of a swapchain. They record into the host's command buffer, and never submit or wait.
//! - [`Scene`] describes the picture: a [`Camera`] that fits the scene, a [`Light`], and what to [`Show`].
//! - [`wrinkles`] appear where a pose compresses the skin.
//! - [`parts`] separates skin from eyes and teeth, and takes the [`Surface`] that a file states. Parts that nothing
//!   moves are drawn with each head, without a pose ([`HeadsDesc::still`]).
//! - [`Studio`] submits and waits as well, on a device of [`headless`](deltamorph_headless).
//!
//! Needs Vulkan 1.1 and four samples per pixel, but no extension or feature.

mod camera;
mod cull;
mod glow;
mod heads;
mod memory;
mod model;
mod modules;
mod normals;
mod parts;
mod passes;
mod record;
mod renderer;
mod scene;
pub mod srgb;
mod studio;
mod target;
pub mod wrinkles;

pub use camera::{Camera, View};
pub use heads::{Heads, HeadsDesc, Updated};
pub use parts::{Face, Material, Part, Surface, parts};
pub use scene::{Light, Scene, Show};
pub use studio::Studio;
pub use target::{Picture, Target};
