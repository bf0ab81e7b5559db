//! Animation and levels of detail on the GPU.

mod animation;
mod followed;
mod heads;
mod lod;
