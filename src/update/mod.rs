//! The ways to update poses, a folder each: plan, device side and what the CPU needs of them.
//!
//! A way to update is a `Technique`; [`technique()`] is the one place that knows which there are. What others published,
//! to compare with, are techniques like any other, in `baselines`.

pub mod animated;
pub mod blocks;
mod check;
#[allow(unsafe_code)]
pub(crate) mod crowd;
pub mod dense;
#[allow(unsafe_code)]
pub(crate) mod technique;

#[cfg(feature = "baselines")]
use crate::baselines;
use crate::error::{Error, Result};
use crate::plan::UpdatePath;
pub(crate) use check::Runner;
pub use check::requirements;
use technique::{Context, Technique};

/// Make the technique of `context.desc`, which was checked.
///
/// # Errors
/// No memory; sizes beyond the device's limits; a mesh that was not uploaded for the path; the path `cpu`, which no
/// device carries out; a baseline in a build without them.
pub(crate) fn technique(context: Context<'_>) -> Result<Box<dyn Technique>> {
    Ok(match context.desc.update.path {
        UpdatePath::Feedback => Box::new(dense::FeedbackTechnique::new(context)?),
        UpdatePath::Compute => Box::new(dense::ComputeTechnique::new(context)?),
        UpdatePath::Blocks => Box::new(blocks::BlocksTechnique::new(context)?),
        path @ UpdatePath::Cpu => {
            let text = format!("update path '{}' on a device", path.name());
            return Err(Error::invalid(text, "use CpuCrowd for it"));
        }
        #[cfg(feature = "baselines")]
        UpdatePath::VertexStore => Box::new(baselines::VertexStoreTechnique::new(context)?),
        #[cfg(feature = "baselines")]
        UpdatePath::Scatter => Box::new(baselines::ScatterTechnique::new(context)?),
        #[cfg(feature = "baselines")]
        UpdatePath::Direct => Box::new(baselines::DirectTechnique::new(context)?),
        #[cfg(feature = "baselines")]
        UpdatePath::DirectAttributes => Box::new(baselines::AttributesTechnique::new(context)?),
        #[cfg(feature = "baselines")]
        UpdatePath::Texture => Box::new(baselines::TextureTechnique::new(context)?),
        #[cfg(not(feature = "baselines"))]
        path @ (UpdatePath::VertexStore
        | UpdatePath::Scatter
        | UpdatePath::Direct
        | UpdatePath::DirectAttributes
        | UpdatePath::Texture) => {
            return Err(Error::Unsupported {
                path: path.name(),
                device: context.caps().name.clone(),
                reason: "this build has no baselines".into(),
                remedy: "build with the feature 'baselines', or use the path 'blocks' or 'compute'".into(),
            });
        }
    })
}

#[cfg(test)]
pub(crate) mod tests;
