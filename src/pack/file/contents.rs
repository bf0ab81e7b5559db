//! Sections of a packed file: writing and reading. Every value read is checked.

use super::clips;
use super::table::*;
use crate::asset::streams::{Semantic, TRIPLES, group_streams};
use crate::asset::{Corner, Faces, Tolerance};
use crate::error::{Result, ensure};
use crate::io::room;
use crate::pack::blocks::Parts;
use crate::pack::{
    BASE_STRIDE, DeltaFormat, POSE_FLOATS, PackedGroup, PackedMesh, PoseError, TARGETS_MAX, VERTEX_PADDING,
};
use crate::weights::WeightClip;
use glam::Vec2;
use std::borrow::Borrow;
use std::path::Path;
use std::sync::Arc;

/// Remedy for a file with valid checksums and invalid contents.
const INCONSISTENT: &str = "the program that wrote it is at fault: pack the mesh again";

/// The file of `mesh`, which is in a block format.
pub(super) fn write(mesh: &PackedMesh) -> Result<Vec<u8>> {
    let layout = mesh.layout();
    let faces = &mesh.faces;
    let index = layout.index()?;
    let groups = mesh.groups();
    let what = format!("mesh '{}' has {} groups of streams; a file has {GROUPS_MAX}", layout.name, groups.len());
    ensure!(groups.len() <= GROUPS_MAX, what, "leave streams out");
    let counts = |counts: &[usize]| counts.iter().map(|count| counted(*count)).collect::<Result<Vec<u32>>>();
    let corners = faces.corners.len();
    let texcoords = mesh.texcoords.len();
    let Tolerance { position, normal } = mesh.tolerance;
    let meta = [
        &[layout.format.row().id, index.parts.size][..],
        &counts(&[layout.vertex_count, layout.targets.len(), faces.sizes.len(), corners, texcoords])?,
        &[layout.diagonal, index.parts.weight_max, position, normal].map(f32::to_bits),
    ]
    .concat();
    let mut names = vec![];
    for name in std::iter::once(&layout.name).chain(layout.targets.iter().map(|t| &t.name)) {
        push_name(&mut names, name)?;
    }
    let textured = faces.corners.iter().any(|c| c.texcoord.is_some());
    let corner_texcoords = faces.corners.iter().filter(|_| textured).map(|c| c.texcoord.unwrap_or(u32::MAX));
    let mut contents = vec![
        ((META, 0), bytes_of(meta)),
        ((NAMES, 0), names),
        ((ORDER, 0), bytes_of(index.order())),
        ((FACES, 0), bytes_of(&faces.sizes)),
        ((CORNERS, 0), bytes_of(faces.corners.iter().map(|c| c.position))),
        ((CORNER_TEXCOORDS, 0), bytes_of(corner_texcoords)),
        ((TEXCOORDS, 0), bytes_of(mesh.texcoords.iter().flat_map(|t| t.to_array().map(f32::to_bits)))),
        ((WELDS, 0), bytes_of(&mesh.welds)),
    ];
    if !mesh.clips.is_empty() {
        contents.push(((CLIPS, 0), clips::write(&mesh.clips)?));
    }
    for (i, group) in groups.iter().enumerate() {
        let streams = &group.layout().streams;
        let index = group.layout().index()?;
        let mut head = counts(&[streams.len(), index.count(), index.entry_count(), group.deltas().len()])?;
        head.extend(index.steps().map(f32::to_bits));
        for semantic in streams.iter().map(|place| place.semantic) {
            let error = index.error().of(semantic).to_bits();
            head.extend([semantic.id(), 0, error as u32, (error >> 32) as u32]);
        }
        // Files store positions relative to 0. Adding the subtracted origin is exact; adding 0 would turn -0 into 0.
        let origin = if i == 0 { layout.origin.to_array() } else { [0.0; 3] };
        let base = group.base()[..layout.vertex_count * POSE_FLOATS].iter().enumerate().map(|(at, &number)| {
            let of = origin.get(at % POSE_FLOATS).copied().filter(|of| *of != 0.0);
            of.map_or(number, |of| number + of)
        });
        contents.extend([
            ((GROUP, i), bytes_of(head)),
            ((BASE, i), bytes_of(base.map(f32::to_bits))),
            ((FIRST_ENTRIES, i), bytes_of(&index.parts.first_entry)),
            // Numbers below `TARGETS_MAX`, which is 65,536.
            ((ENTRY_TARGETS, i), index.parts.entry_target.iter().flat_map(|t| (*t as u16).to_le_bytes()).collect()),
            ((WORDS, i), bytes_of(group.deltas())),
        ]);
    }
    Ok(join(&contents))
}

/// The clips of a file of these sections.
pub(super) fn clips_of(path: &Path, sections: &Sections<'_>) -> Result<Vec<WeightClip>> {
    let place = (CLIPS, 0);
    clips::read(sections.get(place)?).map_err(|what| malformed(path, Some(place), what, INCONSISTENT))
}

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<PackedMesh> {
    // All sections are copied below.
    room(path, bytes.len() as u64)?;
    let sections = split(path, bytes)?;
    let refuse = |place: Place, what: String| malformed(path, Some(place), what, INCONSISTENT);
    // Counts are checked against section lengths before allocation.
    let sized = |place: Place, count: usize, stride: usize, of: &str| {
        let bytes = sections.get(place)?;
        let needed = count as u64 * stride as u64;
        let what = format!("has {} bytes; {count} {of} take {needed}", bytes.len());
        if bytes.len() as u64 == needed { Ok(bytes) } else { Err(refuse(place, what)) }
    };
    let checked = |place, count, stride, of: &str| sized(place, count, stride, of).map(words_of);
    let targets_of = |place, entries| {
        let bytes = sized(place, entries, 2, "entries")?;
        Ok(bytes.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b).into()).collect())
    };
    let optional = |section, count, of| match sections.get((section, 0))?.is_empty() {
        true => Ok(vec![]),
        false => checked((section, 0), count, 4, of),
    };

    let at_meta = (META, 0);
    let meta = sections.get(at_meta)?;
    let words: Option<[u32; 11]> = words_of(meta).try_into().ok().filter(|_| meta.len().is_multiple_of(4));
    let [format, size, counts @ .., diagonal, weight_max, position, normal] =
        words.ok_or_else(|| refuse(at_meta, format!("has {} bytes, 44 expected", meta.len())))?;
    let [vertices, target_count, face_count, corners, texcoords] = counts.map(|n| n as usize);
    let [diagonal, weight_max, position, normal] = [diagonal, weight_max, position, normal].map(f32::from_bits);
    let format = DeltaFormat::from_id(format)
        .ok_or_else(|| refuse(at_meta, format!("names a format {format} that is not known")))?;
    let what = format!("names {target_count} targets; the kernels name at most {TARGETS_MAX}");
    ensure!(target_count <= TARGETS_MAX, refuse(at_meta, what));
    let head = |group| Head::parse(sections.get((GROUP, group))?).map_err(|what| refuse((GROUP, group), what));
    let heads = (0..sections.groups()).map(head).collect::<Result<Vec<_>>>()?;
    let laid_out = group_streams(heads.iter().flat_map(|head| &head.semantics).copied());

    let names = names(sections.get((NAMES, 0))?, target_count);
    let names = names.map_err(|what| refuse((NAMES, 0), what))?;
    let (name, targets) = names.split_first().map_or(("", &[][..]), |(first, rest)| (*first, rest));
    let order: Arc<[u32]> = checked((ORDER, 0), vertices, 4, "vertices")?.into();
    // Large enough for every block size; the size itself is checked with the blocks.
    let padded = vertices.next_multiple_of((size as usize).clamp(VERTEX_PADDING, 128));

    let mut groups = vec![];
    for (i, head) in heads.into_iter().enumerate() {
        let streams = laid_out.get(i).filter(|places| places.iter().map(|p| p.semantic).eq(head.semantics));
        let Some(streams) = streams else {
            return Err(refuse((GROUP, i), "holds other streams than it should".into()));
        };
        let mut base = floats_of(checked((BASE, i), vertices, BASE_STRIDE, "vertices")?);
        base.resize(padded * POSE_FLOATS, 0.0);
        let words = checked((WORDS, i), head.words, 4, "words")?;
        let parts = Parts {
            format,
            size,
            order: order.clone(),
            steps: head.steps,
            weight_max,
            error: head.error,
            first_entry: checked((FIRST_ENTRIES, i), head.blocks.saturating_add(1), 4, "blocks and one")?,
            entry_target: targets_of((ENTRY_TARGETS, i), head.entries)?,
        };
        let targets = targets.iter().copied();
        let group = PackedGroup::in_blocks(name, diagonal, targets, streams.clone(), parts, base, words);
        groups.push(group.map_err(|what| {
            let of = if i == 0 { "its blocks".to_owned() } else { format!("the blocks of group {i}") };
            malformed(path, None, format!("{of} do not fit together: {what}"), INCONSISTENT)
        })?);
    }
    let texcoords = floats_of(checked((TEXCOORDS, 0), texcoords, 8, "texture coordinates")?);
    let positions = checked((CORNERS, 0), corners, 4, "corners")?;
    let corner_texcoords = optional(CORNER_TEXCOORDS, corners, "corners")?;
    let corner = |(i, position)| {
        let texcoord = corner_texcoords.get(i).copied().filter(|t| *t != u32::MAX);
        Corner { position, texcoord }
    };
    let mut notes = vec![];
    let clips = clips_of(path, &sections).unwrap_or_else(|error| {
        notes.push(format!("{error}; the clips are left out"));
        vec![]
    });
    let mesh = PackedMesh {
        groups,
        faces: Faces {
            sizes: checked((FACES, 0), face_count, 4, "faces")?,
            corners: positions.into_iter().enumerate().map(corner).collect(),
        },
        texcoords: texcoords.as_chunks().0.iter().copied().map(Vec2::from_array).collect(),
        welds: optional(WELDS, vertices, "vertices")?,
        tolerance: Tolerance { position, normal },
        clips,
        notes,
    };
    mesh.check().map_err(|what| malformed(path, None, what, INCONSISTENT))?;
    mesh.complete()
}

/// Section 'group'.
struct Head {
    semantics: Vec<Semantic>,
    blocks: usize,
    entries: usize,
    words: usize,
    steps: [f32; TRIPLES],
    error: PoseError,
}

impl Head {
    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let words = words_of(bytes);
        let length = bytes.len() as u64;
        let (&[count, blocks, entries, words, first, second], rest) =
            words.split_first_chunk::<6>().ok_or_else(|| format!("has {length} bytes"))?;
        let expected = 24 + 16 * u64::from(count);
        ensure!(length == expected, format!("has {length} bytes, {expected} expected"));
        let mut semantics = vec![];
        let mut error = PoseError::default();
        for &[id, zero, low, high] in rest.as_chunks().0 {
            let known = Semantic::from_id(id).filter(|_| zero == 0);
            let semantic = known.ok_or_else(|| format!("names a stream {id:#x} that is not known"))?;
            let stated = f64::from_bits(u64::from(low) | u64::from(high) << 32);
            ensure!(stated.is_finite() && stated >= 0.0, format!("names an error of {stated}"));
            semantics.push(semantic);
            error.add(semantic, stated);
        }
        let [blocks, entries, words] = [blocks, entries, words].map(|n| n as usize);
        Ok(Self { semantics, blocks, entries, words, steps: [first, second].map(f32::from_bits), error })
    }
}

/// The names of the mesh and of each target.
fn names(mut rest: &[u8], targets: usize) -> Result<Vec<&str>, String> {
    // Bounded by the bytes, whatever the count says.
    let mut names = Vec::with_capacity((targets + 1).min(rest.len() / 4));
    for i in 0..=targets {
        let of = || if i == 0 { "the mesh".to_owned() } else { format!("target {}", i - 1) };
        names.push(name_of(&mut rest).map_err(|what| format!("{what}, at the name of {}", of()))?);
    }
    ensure!(rest.is_empty(), format!("has {} bytes after the last name", rest.len()));
    Ok(names)
}

fn words_of(bytes: &[u8]) -> Vec<u32> {
    bytes.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect()
}

fn floats_of(words: Vec<u32>) -> Vec<f32> {
    words.into_iter().map(f32::from_bits).collect()
}

fn bytes_of(words: impl IntoIterator<Item: Borrow<u32>>) -> Vec<u8> {
    words.into_iter().flat_map(|word| word.borrow().to_le_bytes()).collect()
}
