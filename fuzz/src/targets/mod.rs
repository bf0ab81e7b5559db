//! One module for each target.

mod capi;
mod csv;
mod dmorph;
mod gltf;
mod ktx2;
mod meshopt;
mod obj;
mod planner;

use crate::Target;

/// All of them.
pub const TARGETS: [Target; 8] = [
    gltf::TARGET,
    dmorph::TARGET,
    obj::TARGET,
    csv::TARGET,
    ktx2::TARGET,
    meshopt::TARGET,
    planner::TARGET,
    capi::TARGET,
];
