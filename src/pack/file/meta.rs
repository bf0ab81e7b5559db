//! Metadata of a packed file: the sections 'meta' and 'group'.

use super::Asset;
use super::bytes::{read_f32s, read_u32s, write_f32s, write_u32s};
use super::table::{OLD_VERSION, Section, Sections};
use crate::asset::Tolerance;
use crate::asset::streams::{Semantic, StreamPlace, TRIPLES, group_streams};
use crate::error::{Error, Result};
use crate::pack::blocks::BlockIndex;
use crate::pack::formats::BlockFormat;
use crate::pack::{DeltaFormat, PackedGroup, PackedLayout, PoseError, TARGETS_MAX};

/// The section 'meta'.
pub(super) struct Meta {
    pub format: &'static dyn BlockFormat,
    pub size: u32,
    pub vertices: usize,
    pub targets: usize,
    pub faces: usize,
    pub corners: usize,
    pub texcoords: usize,
    pub diagonal: f32,
    pub weight_max: f32,
    pub tolerance: Tolerance,
}

/// A section 'group'.
pub(super) struct GroupMeta {
    pub streams: Vec<StreamPlace>,
    pub blocks: usize,
    pub entries: usize,
    pub words: usize,
    pub steps: [f32; TRIPLES],
    pub error: PoseError,
}

/// What is wrong with a section.
pub(super) type Fault = (Section, usize, String);

impl Meta {
    /// The section of `asset`, whose surface has the blocks of `index`.
    pub fn bytes(asset: &Asset, index: &BlockIndex) -> Result<Vec<u8>> {
        let (layout, faces) = (asset.mesh.layout(), &asset.faces);
        let texcoords = asset.texcoords.len();
        let counts = [layout.vertex_count, layout.targets.len(), faces.sizes.len(), faces.corners.len(), texcoords];
        let mut bytes = write_u32s([layout.format.row().id, index.size() as u32].into_iter());
        bytes.extend(write_counts(&counts, &layout.name)?);
        let Tolerance { position, normal } = asset.tolerance;
        bytes.extend(write_f32s(&[layout.diagonal, index.parts.weight_max, position, normal]));
        Ok(bytes)
    }

    /// What a file says of the mesh and of each group.
    pub fn read(sections: &Sections<'_>) -> Result<(Self, Vec<GroupMeta>), Fault> {
        let bytes = sections.get(Section::Meta);
        let meta = |what| (Section::Meta, 0, what);
        if sections.version == OLD_VERSION {
            let [mesh, group] = split_old(bytes).map_err(meta)?;
            return Ok((Self::parse(&mesh).map_err(meta)?, vec![GroupMeta::parse(&group).map_err(meta)?]));
        }
        let mesh = Self::parse(bytes).map_err(meta)?;
        let group = |i| GroupMeta::parse(sections.of(Section::Group, i)).map_err(|what| (Section::Group, i, what));
        let groups: Vec<GroupMeta> = (0..sections.groups()).map(group).collect::<Result<_, _>>()?;
        let laid_out = group_streams(groups.iter().flat_map(|group| &group.streams).map(|place| place.semantic));
        match (0..groups.len()).find(|&i| laid_out.get(i) != Some(&groups[i].streams)) {
            Some(i) => Err((Section::Group, i, "holds other streams than it should".into())),
            None => Ok((mesh, groups)),
        }
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let ([format, size, counts @ ..], [diagonal, weight_max, position, normal]) = numbers::<7, 4>(bytes)?;
        let [vertices, targets, faces, corners, texcoords] = counts.map(|n| n as usize);
        let format = DeltaFormat::from_id(format)
            .and_then(DeltaFormat::block_format)
            .ok_or_else(|| format!("names a format {format} that is not known"))?;
        if targets > TARGETS_MAX {
            return Err(format!("names {targets} targets; the kernels name at most {TARGETS_MAX}"));
        }
        let tolerance = Tolerance { position, normal };
        Ok(Self { format, size, vertices, targets, faces, corners, texcoords, diagonal, weight_max, tolerance })
    }
}

/// The section 'meta' of version 2, as the two sections that version 3 has in its place.
fn split_old(bytes: &[u8]) -> Result<[Vec<u8>; 2], String> {
    if bytes.len() != 80 {
        return Err(format!("has {} bytes, 80 expected", bytes.len()));
    }
    let words = read_u32s(bytes);
    let mesh = [&words[..4], &words[7..10], &words[12..16]].concat();
    let [position, normal] = [Semantic::Position, Semantic::Normal].map(|semantic| [semantic_id(semantic), 0]);
    let group = [&[2], &words[4..7], &words[10..12], &position, &words[16..18], &normal, &words[18..]].concat();
    Ok([mesh, group].map(|words| write_u32s(words.into_iter())))
}

impl GroupMeta {
    /// The section of `group`, which has the blocks of `index`.
    pub fn bytes(group: &PackedGroup, index: &BlockIndex) -> Result<Vec<u8>> {
        let PackedLayout { name, streams, .. } = group.layout();
        let counts = [streams.len(), index.count(), index.entry_count(), group.deltas().len()];
        let mut bytes = write_counts(&counts, name)?;
        bytes.extend(write_f32s(&index.steps()));
        for place in streams {
            bytes.extend(write_u32s([semantic_id(place.semantic), 0].into_iter()));
            bytes.extend(index.error().of(place.semantic).to_le_bytes());
        }
        Ok(bytes)
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let (head, rest) = bytes.split_at_checked(24).ok_or_else(|| format!("has {} bytes", bytes.len()))?;
        let ([count, blocks, entries, words], steps) = numbers::<4, TRIPLES>(head)?;
        let (rows, tail) = rest.as_chunks::<16>();
        if (rows.len(), tail.len()) != (count as usize, 0) {
            return Err(format!("has {} bytes, {} expected", bytes.len(), 24 + 16 * u64::from(count)));
        }
        let (mut streams, mut errors, mut first) = (vec![], PoseError::default(), 0);
        for row in rows {
            let (ids, error) = row.split_at(8);
            let id = read_u32s(ids);
            let semantic = semantic(id[0]).filter(|_| id[1] == 0);
            let semantic = semantic.ok_or_else(|| format!("names a stream {:#x} that is not known", id[0]))?;
            streams.push(StreamPlace { semantic, first });
            first += semantic.components();
            let error = error.first_chunk().map_or(f64::NAN, |bytes| f64::from_le_bytes(*bytes));
            if !(error.is_finite() && error >= 0.0) {
                return Err(format!("names an error of {error}"));
            }
            errors = errors.max(PoseError::only(semantic, error));
        }
        let [blocks, entries, words] = [blocks, entries, words].map(|n| n as usize);
        Ok(Self { streams, blocks, entries, words, steps, error: errors })
    }
}

/// N counts and M floats, and nothing else.
fn numbers<const N: usize, const M: usize>(bytes: &[u8]) -> Result<([u32; N], [f32; M]), String> {
    let wrong = || format!("has {} bytes, {} expected", bytes.len(), 4 * (N + M));
    let (counts, floats) = bytes.split_at_checked(4 * N).ok_or_else(wrong)?;
    match (read_u32s(counts).try_into(), read_f32s(floats).try_into()) {
        (Ok(counts), Ok(floats)) if bytes.len() == 4 * (N + M) => Ok((counts, floats)),
        _ => Err(wrong()),
    }
}

fn write_counts(counts: &[usize], name: &str) -> Result<Vec<u8>> {
    match counts.iter().find(|n| u32::try_from(**n).is_err()) {
        Some(n) => Err(Error::invalid(format!("mesh '{name}' has {n} of something"), "split the mesh")),
        None => Ok(write_u32s(counts.iter().map(|n| *n as u32))),
    }
}

/// The number of a stream in a file: what it is, and which set of it.
fn semantic_id(semantic: Semantic) -> u32 {
    match semantic {
        Semantic::Position => 1,
        Semantic::Normal => 2,
        Semantic::Tangent => 3,
        Semantic::TexCoord(set) => 4 | u32::from(set) << 8,
        Semantic::Color(set) => 5 | u32::from(set) << 8,
    }
}

fn semantic(id: u32) -> Option<Semantic> {
    let set = u8::try_from(id >> 8).ok()?;
    let semantic = match id & 0xff {
        1 => Semantic::Position,
        2 => Semantic::Normal,
        3 => Semantic::Tangent,
        4 => Semantic::TexCoord(set),
        5 => Semantic::Color(set),
        _ => return None,
    };
    (semantic_id(semantic) == id).then_some(semantic)
}
