//! Which technique carries a description out.

use super::technique::{Context, Technique};
use crate::error::{Error, Result};
use crate::plan::paths::{UpdatePath, update_paths};

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
