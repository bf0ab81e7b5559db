//! From an asset to the bytes of its file.

use super::Asset;
use super::table::join;
use crate::error::{Error, Result};
use crate::pack::POSE_FLOATS;
use crate::pack::blocks::BlockIndex;

/// The bytes of `asset`, whose blocks are `index`.
pub(super) fn bytes(asset: &Asset, index: &BlockIndex) -> Result<Vec<u8>> {
    let (layout, words) = (asset.mesh.layout(), asset.mesh.words());
    let faces = &asset.faces;
    let counts = [
        layout.vertex_count,
        layout.targets.len(),
        index.count(),
        index.entry_count(),
        words.len(),
        faces.sizes.len(),
        faces.corners.len(),
        asset.texcoords.len(),
    ];
    if let Some(n) = counts.iter().find(|n| u32::try_from(**n).is_err()) {
        return Err(Error::invalid(format!("mesh '{}' has {n} of something", layout.name), "split the mesh"));
    }
    let steps = index.steps();
    let floats =
        [steps[0], steps[1], layout.diagonal, index.weight_max(), asset.tolerance.position, asset.tolerance.normal];
    let mut meta = u32s([layout.format.row().id, index.size() as u32].into_iter().chain(counts.map(|n| n as u32)));
    meta.extend(f32s(&floats));
    meta.extend([index.error().position, index.error().normal_degrees].into_iter().flat_map(f64::to_le_bytes));

    let mut names = vec![];
    for name in std::iter::once(&layout.name).chain(layout.targets.iter().map(|t| &t.name)) {
        let length = u32::try_from(name.len())
            .map_err(|_| Error::invalid(format!("a name of {} bytes", name.len()), "shorten it"))?;
        names.extend(length.to_le_bytes());
        names.extend(name.as_bytes());
    }
    let mut corner_texcoords = vec![];
    if faces.corners.iter().any(|c| c.texcoord.is_some()) {
        corner_texcoords = u32s(faces.corners.iter().map(|c| c.texcoord.unwrap_or(u32::MAX)));
    }
    Ok(join(&[
        meta,
        names,
        f32s(&asset.mesh.base()[..layout.vertex_count * POSE_FLOATS]),
        u32s(index.order().iter().copied()),
        u32s(index.first_entries().iter().copied()),
        u32s(index.entry_targets().iter().copied()),
        u32s(words.iter().copied()),
        u32s(faces.sizes.iter().copied()),
        u32s(faces.corners.iter().map(|c| c.position)),
        corner_texcoords,
        u32s(asset.texcoords.iter().flat_map(|t| t.to_array().map(f32::to_bits))),
    ]))
}

fn u32s(values: impl Iterator<Item = u32>) -> Vec<u8> {
    values.flat_map(u32::to_le_bytes).collect()
}

fn f32s(values: &[f32]) -> Vec<u8> {
    u32s(values.iter().map(|v| v.to_bits()))
}
