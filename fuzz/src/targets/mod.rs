//! One module for each target.

mod csv;
mod dmorph;
mod gltf;
mod meshopt;
mod obj;

use crate::Target;

/// All of them.
pub const TARGETS: [Target; 5] = [gltf::TARGET, dmorph::TARGET, obj::TARGET, csv::TARGET, meshopt::TARGET];
