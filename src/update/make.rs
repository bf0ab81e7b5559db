//! Which technique carries a description out.

use super::blocks::BlocksTechnique;
use super::dense::compute::ComputePasses;
use super::dense::feedback::Feedback;
use super::dense::technique::DenseTechnique;
use super::technique::{Context, Technique};
use crate::error::{Error, Result};
use crate::plan::UpdatePath;
use std::sync::Arc;

/// Make the technique of `context.desc`, which was checked.
///
/// # Errors
/// No memory; sizes beyond the device's limits; the path `cpu`, which no device carries out; a baseline in a build
/// without them.
pub(crate) fn technique(context: Context<'_>) -> Result<Box<dyn Technique>> {
    let path = context.desc.update.path;
    Ok(match path {
        UpdatePath::Feedback => Box::new(DenseTechnique::<Arc<Feedback>>::new(context)?),
        UpdatePath::Compute => Box::new(DenseTechnique::<ComputePasses>::new(context)?),
        UpdatePath::Blocks => Box::new(BlocksTechnique::new(context)?),
        UpdatePath::Cpu => {
            return Err(Error::invalid(
                format!("update path '{}' on a device", path.name()),
                "use CpuCrowd for the path 'cpu'",
            ));
        }
        #[cfg(feature = "baselines")]
        UpdatePath::VertexStore | UpdatePath::Scatter | UpdatePath::Direct | UpdatePath::DirectAttributes => {
            return crate::baselines::technique(context);
        }
        #[cfg(not(feature = "baselines"))]
        UpdatePath::VertexStore | UpdatePath::Scatter | UpdatePath::Direct | UpdatePath::DirectAttributes => {
            return Err(Error::Unsupported {
                path: path.name(),
                device: context.caps().name.clone(),
                reason: "this build has no baselines".into(),
                remedy: "build with the feature 'baselines', or use the path 'blocks' or 'compute'".into(),
            });
        }
    })
}
