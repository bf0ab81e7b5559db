//! From the bytes of a file to an asset. Nothing in the file is taken for granted.

use super::Asset;
use super::bytes::{read_f32s, read_u32s};
use super::meta::{Fault, Meta};
use super::table::{Section, malformed, split};
use crate::asset::{Corner, Faces};
use crate::error::Result;
use crate::io::room;
use crate::pack::blocks::Parts;
use crate::pack::{BASE_STRIDE, POSE_FLOATS, PackedGroup, PackedMesh, VERTEX_PADDING};
use glam::Vec2;
use std::path::Path;
use std::sync::Arc;

/// What to do about a file whose checksums are right and whose contents are not.
const INCONSISTENT: &str = "whatever wrote it is at fault: pack the mesh again";

/// The asset that `bytes` are the file of.
pub(super) fn asset(path: &Path, bytes: &[u8]) -> Result<Asset> {
    // All sections are copied below.
    room(path, bytes.len() as u64)?;
    let sections = split(path, bytes)?;
    let refuse = |(section, group, what): Fault| malformed(path, Some((section, group)), what, INCONSISTENT);
    let (meta, group_metas) = Meta::read(&sections).map_err(refuse)?;
    // Counts are held against the lengths of sections, before memory is taken by them.
    let checked = |section, group, count: usize, stride: usize, of: &str| {
        let bytes = sections.of(section, group);
        let needed = count as u64 * stride as u64;
        let what = || format!("has {} bytes; {count} {of} take {needed}", bytes.len());
        if bytes.len() as u64 == needed { Ok(bytes) } else { Err(refuse((section, group, what()))) }
    };
    let optional = |section, count, of| match sections.get(section).is_empty() {
        true => Ok(&[][..]),
        false => checked(section, 0, count, 4, of),
    };
    let names = names(sections.get(Section::Names), meta.targets).map_err(|what| refuse((Section::Names, 0, what)))?;
    let (name, targets) = names.split_first().map_or(("", &[][..]), |(first, rest)| (*first, rest));
    let order: Arc<[u32]> = read_u32s(checked(Section::Order, 0, meta.vertices, 4, "vertices")?).into();
    // Of any block size: whether there are blocks of this size is checked with the blocks.
    let padded = meta.vertices.next_multiple_of((meta.size as usize).clamp(VERTEX_PADDING, 128));

    let mut groups = vec![];
    for (i, group) in group_metas.into_iter().enumerate() {
        let mut base = read_f32s(checked(Section::Base, i, meta.vertices, BASE_STRIDE, "vertices")?);
        base.resize(padded * POSE_FLOATS, 0.0);
        let words = read_u32s(checked(Section::Words, i, group.words, 4, "words")?);
        let firsts = checked(Section::FirstEntries, i, group.blocks.saturating_add(1), 4, "blocks and one")?;
        let parts = Parts {
            format: meta.format,
            size: meta.size,
            order: order.clone(),
            steps: group.steps,
            weight_max: meta.weight_max,
            error: group.error,
            first_entry: read_u32s(firsts),
            entry_target: read_u32s(checked(Section::EntryTargets, i, group.entries, 4, "entries")?),
        };
        let targets = targets.iter().copied();
        let group = PackedGroup::in_blocks(name, meta.diagonal, targets, group.streams, parts, base, words);
        groups.push(group.map_err(|what| {
            let of = if i == 0 { "its blocks".to_owned() } else { format!("the blocks of group {i}") };
            malformed(path, None, format!("{of} do not fit together: {what}"), INCONSISTENT)
        })?);
    }
    let texcoords = read_f32s(checked(Section::Texcoords, 0, meta.texcoords, 8, "texture coordinates")?);
    let positions = read_u32s(checked(Section::FaceCorners, 0, meta.corners, 4, "corners")?);
    let corner_texcoords = read_u32s(optional(Section::CornerTexcoords, meta.corners, "corners")?);
    let corner = |(i, position)| {
        let texcoord = corner_texcoords.get(i).copied().filter(|t| *t != u32::MAX);
        Corner { position, texcoord }
    };
    let asset = Asset {
        mesh: PackedMesh::of_groups(groups),
        faces: Faces {
            sizes: read_u32s(checked(Section::FaceSizes, 0, meta.faces, 4, "faces")?),
            corners: positions.into_iter().enumerate().map(corner).collect(),
        },
        texcoords: texcoords.as_chunks().0.iter().copied().map(Vec2::from_array).collect(),
        welds: read_u32s(optional(Section::Welds, meta.vertices, "vertices")?),
        tolerance: meta.tolerance,
    };
    match asset.check() {
        Ok(()) => Ok(asset),
        Err(what) => Err(malformed(path, None, what, INCONSISTENT)),
    }
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
