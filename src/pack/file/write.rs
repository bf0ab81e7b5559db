//! From an asset to the bytes of its file.

use super::Asset;
use super::bytes::{write_f32s, write_u32s};
use super::meta::{GroupMeta, Meta};
use super::table::{GROUPS_MAX, Section, join};
use crate::error::{Error, Result};
use crate::pack::POSE_FLOATS;

/// The bytes of `asset`, whose groups have blocks.
pub(super) fn bytes(asset: &Asset) -> Result<Vec<u8>> {
    let (layout, faces) = (asset.mesh.layout(), &asset.faces);
    let index = layout.index()?;
    let groups = asset.mesh.groups();
    if groups.len() > GROUPS_MAX {
        let what = format!("mesh '{}' has {} groups of streams; a file has {GROUPS_MAX}", layout.name, groups.len());
        return Err(Error::invalid(what, "leave streams out"));
    }
    let mut names = vec![];
    for name in std::iter::once(&layout.name).chain(layout.targets.iter().map(|t| &t.name)) {
        let length = u32::try_from(name.len())
            .map_err(|_| Error::invalid(format!("a name of {} bytes", name.len()), "shorten it"))?;
        names.extend(length.to_le_bytes());
        names.extend(name.as_bytes());
    }
    let mut corner_texcoords = vec![];
    if faces.corners.iter().any(|c| c.texcoord.is_some()) {
        corner_texcoords = write_u32s(faces.corners.iter().map(|c| c.texcoord.unwrap_or(u32::MAX)));
    }
    let mut contents = vec![
        ((Section::Meta, 0), Meta::bytes(asset, index)?),
        ((Section::Names, 0), names),
        ((Section::Order, 0), write_u32s(index.order().iter().copied())),
        ((Section::FaceSizes, 0), write_u32s(faces.sizes.iter().copied())),
        ((Section::FaceCorners, 0), write_u32s(faces.corners.iter().map(|c| c.position))),
        ((Section::CornerTexcoords, 0), corner_texcoords),
        ((Section::Texcoords, 0), write_u32s(asset.texcoords.iter().flat_map(|t| t.to_array().map(f32::to_bits)))),
        ((Section::Welds, 0), write_u32s(asset.welds.iter().copied())),
    ];
    for (i, group) in groups.iter().enumerate() {
        let index = group.layout().index()?;
        contents.extend([
            ((Section::Group, i), GroupMeta::bytes(group, index)?),
            ((Section::Base, i), write_f32s(&group.base()[..layout.vertex_count * POSE_FLOATS])),
            ((Section::FirstEntries, i), write_u32s(index.parts.first_entry.iter().copied())),
            ((Section::EntryTargets, i), write_u32s(index.parts.entry_target.iter().copied())),
            ((Section::Words, i), write_u32s(group.deltas().iter().copied())),
        ]);
    }
    Ok(join(&contents))
}
