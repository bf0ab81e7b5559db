//! The ways to update poses, a folder each: plan, device side and what the CPU needs of them.
//!
//! A way to update is a `Technique`; [`technique()`] is the one place that knows which there are. What others
//! published, to compare with, are techniques like any other, which are made outside the library (the package
//! deltamorph-baselines).

pub mod animated;
pub mod blocks;
mod check;
#[allow(unsafe_code)]
pub mod crowd;
pub mod dense;
#[allow(unsafe_code)]
pub mod technique;

use crate::error::{Error, Result};
use crate::plan::UpdatePath;
pub(crate) use check::Runner;
pub use check::requirements;
use technique::{Context, Technique, Techniques};

/// Make the technique of `context.desc`, which was checked.
///
/// # Errors
/// No memory; sizes beyond the device's limits; a mesh that was not uploaded for the path; the path `cpu`, which no
/// device carries out; a technique of others where there are no `others`.
pub(crate) fn technique(context: Context<'_>, others: Option<&Techniques>) -> Result<Box<dyn Technique>> {
    Ok(match context.desc.update.path {
        UpdatePath::Feedback => Box::new(dense::FeedbackTechnique::new(context)?),
        UpdatePath::Compute => Box::new(dense::ComputeTechnique::new(context)?),
        UpdatePath::Blocks => Box::new(blocks::BlocksTechnique::new(context)?),
        path @ UpdatePath::Cpu => {
            let text = format!("update path '{}' on a device", path.name());
            return Err(Error::invalid(text, "use CpuCrowd for it"));
        }
        path @ (UpdatePath::VertexStore
        | UpdatePath::Scatter
        | UpdatePath::Direct
        | UpdatePath::DirectAttributes
        | UpdatePath::Texture) => (Techniques::of(others, path, context.caps())?.make)(context)?,
    })
}

#[cfg(test)]
pub(crate) mod tests;
