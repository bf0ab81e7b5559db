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
#[allow(clippy::wildcard_enum_match_arm, reason = "baselines have their own table, and tests try every path")]
pub(crate) fn technique(context: Context<'_>, others: Option<&Techniques>) -> Result<Box<dyn Technique>> {
    let path = context.desc.update.path;
    if path.is_baseline() {
        return (Techniques::of(others, path, context.caps())?.make)(context);
    }
    Ok(match path {
        UpdatePath::Feedback => Box::new(dense::FeedbackTechnique::new(context)?),
        UpdatePath::Compute => Box::new(dense::ComputeTechnique::new(context)?),
        UpdatePath::Blocks => Box::new(blocks::BlocksTechnique::new(context)?),
        _ => return refuse(format!("update path '{}' on a device", path.name()), "use CpuCrowd for it"),
    })
}

#[cfg(test)]
pub(crate) mod tests;
