//! From the bytes of a file to an asset. Nothing in the file is taken for granted.

use super::Asset;
use super::table::{Section, Sections, complaint, split};
use crate::error::Result;
use crate::mesh::{Corner, Faces, Tolerance};
use crate::pack::blocks::{BlockIndex, Parts, target};
use crate::pack::formats::BlockFormat;
use crate::pack::{DeltaFormat, PackError, PackedLayout, PackedMesh};
use crate::pack::{POSE_FLOATS, POSE_STRIDE, TARGETS_MAX, VERTEX_PADDING};
use glam::Vec2;
use std::path::Path;
use std::sync::Arc;

/// What to do about a file whose checksums are right and whose contents are not.
const INCONSISTENT: &str = "whatever wrote it is at fault: pack the mesh again";

/// Words and bytes of the section 'meta'.
const META_COUNTS: usize = 10;
const META_FLOATS: usize = 6;
const META_BYTES: usize = 4 * (META_COUNTS + META_FLOATS) + 2 * 8;

/// The asset that `bytes` are the file of.
pub(super) fn asset(path: &Path, bytes: &[u8]) -> Result<Asset> {
    // All sections are copied below.
    crate::io::check_room(path, bytes.len() as u64)?;
    let sections = split(path, bytes)?;
    let refuse = |section, what: String| complaint(path, Some(section), what, INCONSISTENT);
    let meta = Meta::read(sections.get(Section::Meta)).map_err(|what| refuse(Section::Meta, what))?;
    meta.check_lengths(&sections).map_err(|(section, what)| refuse(section, what))?;
    let names = names(sections.get(Section::Names), meta.targets).map_err(|what| refuse(Section::Names, what))?;
    let numbers = |section| u32s(sections.get(section));

    let padded = meta.padded();
    let mut base = f32s(sections.get(Section::Base));
    base.resize(padded * POSE_FLOATS, 0.0);
    let words = numbers(Section::Words);
    let parts = Parts {
        format: meta.format,
        size: meta.size,
        order: numbers(Section::Order),
        position_step: meta.steps[0],
        normal_step: meta.steps[1],
        weight_max: meta.weight_max,
        error: meta.error,
        first_entry: numbers(Section::FirstEntries),
        entry_target: numbers(Section::EntryTargets),
    };
    let whole = |what: String| complaint(path, None, format!("its blocks do not fit together: {what}"), INCONSISTENT);
    let index = BlockIndex::new(parts, meta.targets, &words, &base).map_err(whole)?;
    let (name, targets) = names.split_first().map_or(("", &[][..]), |(first, rest)| (*first, rest));
    let layout = PackedLayout {
        name: name.to_owned(),
        format: meta.format.format(),
        vertex_count: meta.vertices,
        chunk_vertices: padded,
        diagonal: meta.diagonal,
        targets: targets.iter().map(|name| target(name, meta.steps)).collect(),
        blocks: Some(Arc::new(index)),
    };
    let texcoords = f32s(sections.get(Section::Texcoords));
    let asset = Asset {
        mesh: PackedMesh { layout, base, words },
        faces: faces(&sections),
        texcoords: texcoords.as_chunks().0.iter().copied().map(Vec2::from_array).collect(),
        tolerance: meta.tolerance,
    };
    match asset.check() {
        Ok(()) => Ok(asset),
        Err(what) => Err(complaint(path, None, what, INCONSISTENT)),
    }
}

/// The section of this name.
struct Meta {
    format: &'static dyn BlockFormat,
    size: u32,
    vertices: usize,
    targets: usize,
    blocks: usize,
    entries: usize,
    words: usize,
    faces: usize,
    corners: usize,
    texcoords: usize,
    steps: [f32; 2],
    diagonal: f32,
    weight_max: f32,
    tolerance: Tolerance,
    error: PackError,
}

impl Meta {
    fn read(bytes: &[u8]) -> Result<Self, String> {
        if bytes.len() != META_BYTES {
            return Err(format!("has {} bytes, {META_BYTES} expected", bytes.len()));
        }
        let (counts, rest) = bytes.split_at(4 * META_COUNTS);
        let (floats, doubles) = rest.split_at(4 * META_FLOATS);
        let (counts, floats) = (u32s(counts), f32s(floats));
        let doubles: Vec<f64> = doubles.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        let count = |i: usize| counts[i] as usize;
        let meta = Self {
            format: DeltaFormat::from_id(counts[0])
                .and_then(DeltaFormat::block_format)
                .ok_or_else(|| format!("names a format {} that is not known", counts[0]))?,
            size: counts[1],
            vertices: count(2),
            targets: count(3),
            blocks: count(4),
            entries: count(5),
            words: count(6),
            faces: count(7),
            corners: count(8),
            texcoords: count(9),
            steps: [floats[0], floats[1]],
            diagonal: floats[2],
            weight_max: floats[3],
            tolerance: Tolerance { position: floats[4], normal: floats[5] },
            error: PackError { position: doubles[0], normal_degrees: doubles[1] },
        };
        if meta.targets > TARGETS_MAX {
            return Err(format!("names {} targets; the kernels name at most {TARGETS_MAX}", meta.targets));
        }
        if let Some(error) = doubles.iter().find(|e| !(e.is_finite() && **e >= 0.0)) {
            return Err(format!("names an error of {error}"));
        }
        Ok(meta)
    }

    /// Vertices with padding, of any block size: the sizes that there are come later.
    fn padded(&self) -> usize {
        self.vertices.next_multiple_of((self.size as usize).clamp(VERTEX_PADDING, 128))
    }

    /// Hold the counts against the lengths of the sections, before memory is taken by them.
    fn check_lengths(&self, sections: &Sections<'_>) -> Result<(), (Section, String)> {
        let expected = [
            (Section::Base, self.vertices, POSE_STRIDE, "vertices"),
            (Section::Order, self.vertices, 4, "vertices"),
            (Section::FirstEntries, self.blocks.saturating_add(1), 4, "blocks and one"),
            (Section::EntryTargets, self.entries, 4, "entries"),
            (Section::Words, self.words, 4, "words"),
            (Section::FaceSizes, self.faces, 4, "faces"),
            (Section::FaceCorners, self.corners, 4, "corners"),
            (Section::Texcoords, self.texcoords, 8, "texture coordinates"),
        ];
        let differs = |section, count: usize, stride: usize, of: &str| {
            let (length, needed) = (sections.get(section).len() as u64, count as u64 * stride as u64);
            let what = || format!("has {length} bytes; {count} {of} take {needed}");
            if length == needed { Ok(()) } else { Err((section, what())) }
        };
        for (section, count, stride, of) in expected {
            differs(section, count, stride, of)?;
        }
        match sections.get(Section::CornerTexcoords) {
            [] => Ok(()),
            _ => differs(Section::CornerTexcoords, self.corners, 4, "corners"),
        }
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

fn faces(sections: &Sections<'_>) -> Faces {
    let positions = u32s(sections.get(Section::FaceCorners));
    let texcoords = u32s(sections.get(Section::CornerTexcoords));
    let corner = |(i, position)| {
        let texcoord = texcoords.get(i).copied().filter(|t| *t != u32::MAX);
        Corner { position, texcoord }
    };
    Faces {
        sizes: u32s(sections.get(Section::FaceSizes)),
        corners: positions.into_iter().enumerate().map(corner).collect(),
    }
}

fn u32s(bytes: &[u8]) -> Vec<u32> {
    bytes.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect()
}

fn f32s(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}
