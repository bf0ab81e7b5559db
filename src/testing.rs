//! Meshes for unit tests.

#[path = "../tests/common/testing.rs"]
mod shared;

use crate::asset::{Corner, Faces, Mesh, MorphTarget};
pub(crate) use shared::*;

/// The built-in head. Its package is built with this crate as others link it, whose types are not those of the unit
/// tests.
pub(crate) fn head(desc: &deltamorph_head::HeadDesc) -> Mesh {
    let built = deltamorph_head::head(desc);
    let corners = built.faces.corners.iter().map(|c| Corner { position: c.position, texcoord: c.texcoord });
    let targets = built.targets.into_iter();
    Mesh {
        name: built.name,
        positions: built.positions,
        texcoords: built.texcoords,
        faces: Faces { corners: corners.collect(), sizes: built.faces.sizes },
        targets: targets.map(|t| MorphTarget { name: t.name, positions: t.positions, ..Default::default() }).collect(),
        ..Default::default()
    }
}
