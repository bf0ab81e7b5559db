//! From the bytes of a file to an asset. Nothing in the file is taken for granted.

use super::Asset;
use super::bytes::{read_f32s, read_u32s};
use super::meta::{Fault, GroupMeta, Meta};
use super::table::{Section, Sections, complaint, split};
use crate::asset::{Corner, Faces};
use crate::error::Result;
use crate::io::check_room;
use crate::pack::blocks::{BlockIndex, Parts, target};
use crate::pack::{BASE_STRIDE, POSE_FLOATS, PackedGroup, PackedLayout, PackedMesh, VERTEX_PADDING};
use glam::Vec2;
use std::path::Path;
use std::sync::Arc;

/// What to do about a file whose checksums are right and whose contents are not.
const INCONSISTENT: &str = "whatever wrote it is at fault: pack the mesh again";

/// The asset that `bytes` are the file of.
pub(super) fn asset(path: &Path, bytes: &[u8]) -> Result<Asset> {
    // All sections are copied below.
    check_room(path, bytes.len() as u64)?;
    let sections = split(path, bytes)?;
    let refuse = |(section, group, what): Fault| complaint(path, Some((section, group)), what, INCONSISTENT);
    let (meta, group_metas) = Meta::read(&sections).map_err(refuse)?;
    check_lengths(&sections, &meta, &group_metas).map_err(refuse)?;
    let names = names(sections.get(Section::Names), meta.targets).map_err(|what| refuse((Section::Names, 0, what)))?;
    let (name, targets) = names.split_first().map_or(("", &[][..]), |(first, rest)| (*first, rest));
    let order: Arc<[u32]> = read_u32s(sections.get(Section::Order)).into();
    let padded = meta.padded();

    let mut groups = vec![];
    for (i, group) in group_metas.into_iter().enumerate() {
        let mut base = read_f32s(sections.of(Section::Base, i));
        base.resize(padded * POSE_FLOATS, 0.0);
        let words = read_u32s(sections.of(Section::Words, i));
        let parts = Parts {
            format: meta.format,
            size: meta.size,
            order: order.clone(),
            steps: group.steps,
            weight_max: meta.weight_max,
            error: group.error,
            first_entry: read_u32s(sections.of(Section::FirstEntries, i)),
            entry_target: read_u32s(sections.of(Section::EntryTargets, i)),
        };
        let index = BlockIndex::new(parts, meta.targets, &group.streams, &words, &base).map_err(|what| {
            let of = if i == 0 { "its blocks".to_owned() } else { format!("the blocks of group {i}") };
            complaint(path, None, format!("{of} do not fit together: {what}"), INCONSISTENT)
        })?;
        let layout = PackedLayout {
            name: name.to_owned(),
            format: meta.format.format(),
            streams: group.streams,
            vertex_count: meta.vertices,
            chunk_vertices: padded,
            diagonal: meta.diagonal,
            targets: targets.iter().map(|name| target(name, group.steps)).collect(),
            blocks: Some(Arc::new(index)),
        };
        groups.push(PackedGroup { layout, base, words });
    }
    let texcoords = read_f32s(sections.get(Section::Texcoords));
    let asset = Asset {
        mesh: PackedMesh::of_groups(groups),
        faces: faces(&sections),
        texcoords: texcoords.as_chunks().0.iter().copied().map(Vec2::from_array).collect(),
        welds: read_u32s(sections.get(Section::Welds)),
        tolerance: meta.tolerance,
    };
    match asset.check() {
        Ok(()) => Ok(asset),
        Err(what) => Err(complaint(path, None, what, INCONSISTENT)),
    }
}

impl Meta {
    /// Vertices with padding, of any block size: the sizes that there are come later.
    fn padded(&self) -> usize {
        self.vertices.next_multiple_of((self.size as usize).clamp(VERTEX_PADDING, 128))
    }
}

/// Hold the counts against the lengths of the sections, before memory is taken by them.
fn check_lengths(sections: &Sections<'_>, meta: &Meta, groups: &[GroupMeta]) -> Result<(), Fault> {
    let differs = |(section, group, count, stride, of): (Section, usize, usize, usize, &str)| {
        let (length, needed) = (sections.of(section, group).len() as u64, count as u64 * stride as u64);
        let what = || format!("has {length} bytes; {count} {of} take {needed}");
        if length == needed { Ok(()) } else { Err((section, group, what())) }
    };
    for (i, group) in groups.iter().enumerate() {
        differs((Section::Base, i, meta.vertices, BASE_STRIDE, "vertices"))?;
        differs((Section::FirstEntries, i, group.blocks.saturating_add(1), 4, "blocks and one"))?;
        differs((Section::EntryTargets, i, group.entries, 4, "entries"))?;
        differs((Section::Words, i, group.words, 4, "words"))?;
    }
    differs((Section::Order, 0, meta.vertices, 4, "vertices"))?;
    differs((Section::FaceSizes, 0, meta.faces, 4, "faces"))?;
    differs((Section::FaceCorners, 0, meta.corners, 4, "corners"))?;
    differs((Section::Texcoords, 0, meta.texcoords, 8, "texture coordinates"))?;
    // These two may be empty.
    for (section, count, of) in
        [(Section::CornerTexcoords, meta.corners, "corners"), (Section::Welds, meta.vertices, "vertices")]
    {
        if !sections.get(section).is_empty() {
            differs((section, 0, count, 4, of))?;
        }
    }
    Ok(())
}

/// The name of the mesh, then that of each target.
fn names(mut bytes: &[u8], targets: usize) -> Result<Vec<&str>, String> {
    // As many as there is room for, whatever the count says.
    let mut names = Vec::with_capacity((targets + 1).min(bytes.len() / 4));
    for i in 0..=targets {
        let of = || if i == 0 { "the mesh".to_owned() } else { format!("target {}", i - 1) };
        let Some((length, rest)) = bytes.split_first_chunk() else {
            return Err(format!("ends before the name of {}", of()));
        };
        let length = u32::from_le_bytes(*length) as usize;
        let Some((name, rest)) = rest.split_at_checked(length) else {
            return Err(format!("ends within the name of {}, which has {length} bytes", of()));
        };
        names.push(std::str::from_utf8(name).map_err(|_| format!("the name of {} is not UTF-8", of()))?);
        bytes = rest;
    }
    match bytes.len() {
        0 => Ok(names),
        n => Err(format!("has {n} bytes after the last name")),
    }
}

fn faces(sections: &Sections<'_>) -> Faces {
    let positions = read_u32s(sections.get(Section::FaceCorners));
    let texcoords = read_u32s(sections.get(Section::CornerTexcoords));
    let corner = |(i, position)| {
        let texcoord = texcoords.get(i).copied().filter(|t| *t != u32::MAX);
        Corner { position, texcoord }
    };
    Faces {
        sizes: read_u32s(sections.get(Section::FaceSizes)),
        corners: positions.into_iter().enumerate().map(corner).collect(),
    }
}
