//! The techniques that others published, to be compared with ours: a file per technique, each of which implements
//! [`Technique`](crate::update::technique::Technique) as ours do.
//!
//! `vertex-store` is a dense path with another kernel, `scatter` adds into integer sums, and the direct paths evaluate
//! the pose in every draw (`draws`); `face` is what they add to [`MorphEngine`](crate::engine::MorphEngine).

mod attributes;
mod direct;
mod draws;
mod face;
mod scatter;
mod vertex_store;

#[cfg(test)]
pub(crate) use vertex_store::{STORE_PASS, store_accesses};

use crate::error::Result;
use crate::plan::UpdatePath;
use crate::update::dense::technique::DenseTechnique;
use crate::update::technique::{Context, Technique};
use draws::DrawTechnique;

/// Make the technique of a baseline.
///
/// # Errors
/// No memory; sizes beyond the device's limits; for `scatter`, a mesh that was not uploaded for it.
pub(crate) fn technique(context: Context<'_>) -> Result<Box<dyn Technique>> {
    Ok(match context.desc.update.path {
        UpdatePath::VertexStore => Box::new(DenseTechnique::<vertex_store::StorePasses>::new(context)?),
        UpdatePath::Scatter => Box::new(scatter::ScatterTechnique::new(context)?),
        UpdatePath::Direct => Box::new(DrawTechnique::new(context, direct::DirectDraws::new(context)?)?),
        UpdatePath::DirectAttributes => {
            Box::new(DrawTechnique::new(context, attributes::AttributeDraws::new(context)?)?)
        }
        path @ (UpdatePath::Feedback | UpdatePath::Compute | UpdatePath::Blocks | UpdatePath::Cpu) => {
            unreachable!("'{}' is no baseline", path.name())
        }
    })
}
