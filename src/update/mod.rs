//! Update techniques, one folder each: plan, device side, and what the CPU shares.
//!
//! An update technique implements `Technique`; [`technique()`] constructs them. Baselines (published techniques, to
//! compare with) implement it too, in the package deltamorph-baselines.

pub mod animated;
pub mod blocks;
mod check;
#[allow(unsafe_code)]
pub mod crowd;
pub mod dense;
#[allow(unsafe_code)]
pub mod technique;

use crate::error::{Result, refuse};
use crate::plan::UpdatePath;
pub(crate) use check::Runner;
pub use check::requirements;
use technique::{Context, Technique, Techniques};

/// Creates the technique of `context.desc`, which was checked. `others` are the baselines.
///
/// # Errors
/// No memory; sizes beyond device limits; a mesh uploaded for another path; path `cpu`, which has no device; a baseline
/// without `others`.
pub(crate) fn technique(context: Context<'_>, others: Option<&Techniques>) -> Result<Box<dyn Technique>> {
    let path = context.desc.update.path;
    Ok(match path {
        UpdatePath::Feedback => Box::new(dense::FeedbackTechnique::new(context)?),
        UpdatePath::Compute => Box::new(dense::ComputeTechnique::new(context)?),
        UpdatePath::Blocks => Box::new(blocks::BlocksTechnique::new(context)?),
        UpdatePath::Cpu => return refuse("update path 'cpu' on a device", "use CpuCrowd for it"),
        UpdatePath::Baseline(_) => (Techniques::of(others, path, context.caps())?.make)(context)?,
    })
}

#[cfg(test)]
pub(crate) mod tests;
