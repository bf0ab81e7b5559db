//! The techniques that others published, to be compared with ours: a file per technique, each of which implements
//! [`Technique`](crate::update::technique::Technique) as ours do.
//!
//! `vertex-store` is a dense path with another kernel, `scatter` adds into integer sums, and the direct paths evaluate
//! the pose in every draw (`draws`), and `texture` blends displacements into textures that draws fetch; `face` is what they add to [`MorphEngine`](crate::engine::MorphEngine).

mod attributes;
mod direct;
mod draws;
mod face;
mod scatter;
mod texture;
mod vertex_store;

#[cfg(test)]
pub(crate) use vertex_store::StorePasses;

#[cfg(feature = "ktx2")]
pub use texture::file as textures;

pub(crate) use scatter::ScatterTechnique;
pub(crate) use texture::TextureTechnique;

pub(crate) type VertexStoreTechnique = crate::update::dense::technique::DenseTechnique<vertex_store::StorePasses>;
pub(crate) type DirectTechnique = draws::DrawTechnique<direct::DirectDraws>;
pub(crate) type AttributesTechnique = draws::DrawTechnique<attributes::AttributeDraws>;
