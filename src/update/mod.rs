//! The ways to update poses, a folder each: plan, device side and what the CPU needs of them.
//!
//! A way to update is a `Technique`; [`technique()`] is the one place that knows which there are. What others published,
//! to compare with, are techniques like any other, in `baselines`.

pub mod animated;
pub mod blocks;
mod check;
pub mod dense;
pub(crate) mod technique;

use crate::error::{Error, Result};
use crate::plan::paths::{UpdatePath, update_paths};
pub(crate) use check::Runner;
use technique::{Context, Technique};

macro_rules! make {
    (($context:ident)
        ours { $($(#[$doc:meta])* $path:ident $name:literal $row:tt $technique:ty;)* }
        host { $($(#[$host_doc:meta])* $host:ident $host_name:literal $host_row:tt;)* }
        baselines { $($(#[$baseline_doc:meta])* $baseline:ident $baseline_name:literal $baseline_row:tt $others:ty;)* }
    ) => {
        match $context.desc.update.path {
            $(UpdatePath::$path => Ok(Box::new(<$technique>::new($context)?)),)*
            $(UpdatePath::$host => Err(Error::invalid(
                concat!("update path '", $host_name, "' on a device"),
                concat!("use CpuCrowd for the path '", $host_name, "'"),
            )),)*
            $(
                #[cfg(feature = "baselines")]
                UpdatePath::$baseline => Ok(Box::new(<$others>::new($context)?)),
            )*
            #[cfg(not(feature = "baselines"))]
            path @ ($(UpdatePath::$baseline)|*) => Err(Error::Unsupported {
                path: path.name(),
                device: $context.caps().name.clone(),
                reason: "this build has no baselines".into(),
                remedy: "build with the feature 'baselines', or use the path 'blocks' or 'compute'".into(),
            }),
        }
    };
}

/// Make the technique of `context.desc`, which was checked.
///
/// # Errors
/// No memory; sizes beyond the device's limits; a mesh that was not uploaded for the path; the path `cpu`, which no
/// device carries out; a baseline in a build without them.
pub(crate) fn technique(context: Context<'_>) -> Result<Box<dyn Technique>> {
    update_paths!(make(context))
}

#[cfg(test)]
pub(crate) mod tests;
