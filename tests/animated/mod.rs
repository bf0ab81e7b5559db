//! Animation and levels of detail on the GPU.

mod animation;
mod heads;
mod lod;
