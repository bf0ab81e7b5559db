//! One module for each target.

mod capi;
mod csv;
mod dmorph;
mod gltf;
mod meshopt;
mod obj;
mod planner;

use crate::Target;

/// All of them.
pub const TARGETS: [Target; 7] =
    [gltf::TARGET, dmorph::TARGET, obj::TARGET, csv::TARGET, meshopt::TARGET, planner::TARGET, capi::TARGET];
