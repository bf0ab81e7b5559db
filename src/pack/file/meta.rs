//! Metadata of a packed file: the sections 'meta' and 'group'.

use super::Asset;
use super::bytes::{read_f32s, read_u32s, write_f32s, write_u32s};
use super::table::{OLD_VERSION, Section, Sections};
use crate::asset::Tolerance;
use crate::asset::streams::{Semantic, StreamPlace, TRIPLES, group_streams};
use crate::error::{Error, Result};
use crate::pack::blocks::BlockIndex;
use crate::pack::formats::BlockFormat;
use crate::pack::{DeltaFormat, PackedGroup, PoseError, TARGETS_MAX};

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
    pub fn of(asset: &Asset) -> Result<Self> {
        let layout = asset.mesh.layout();
        let Some(index) = &layout.blocks else { return Err(Error::invalid("a mesh without blocks", "pack it")) };
        let meta = Self {
            format: index.format(),
            size: index.size() as u32,
            vertices: layout.vertex_count,
            targets: layout.targets.len(),
            faces: asset.faces.sizes.len(),
            corners: asset.faces.corners.len(),
            texcoords: asset.texcoords.len(),
            diagonal: layout.diagonal,
            weight_max: index.weight_max(),
            tolerance: asset.tolerance,
        };
        let counts = [meta.vertices, meta.targets, meta.faces, meta.corners, meta.texcoords];
        check_counts(&counts, &layout.name).map(|()| meta)
    }

    pub fn to_bytes(&self) -> Vec<u8> {
        let counts = [self.vertices, self.targets, self.faces, self.corners, self.texcoords];
        let mut bytes =
            write_u32s([self.format.format().row().id, self.size].into_iter().chain(counts.map(|n| n as u32)));
        let Tolerance { position, normal } = self.tolerance;
        bytes.extend(write_f32s(&[self.diagonal, self.weight_max, position, normal]));
        bytes
    }

    /// What a file says of the mesh and of each group.
    pub fn read(sections: &Sections<'_>) -> Result<(Self, Vec<GroupMeta>), Fault> {
        let bytes = sections.get(Section::Meta);
        let meta = |what| (Section::Meta, 0, what);
        if sections.version == OLD_VERSION {
            let (mesh, group) = Self::read_old(bytes).map_err(meta)?;
            return Ok((mesh, vec![group]));
        }
        let ([format, size, counts @ ..], [diagonal, weight_max, position, normal]) =
            numbers::<7, 4>(bytes).map_err(meta)?;
        let tolerance = Tolerance { position, normal };
        let mesh = Self::checked(format, size, counts, diagonal, weight_max, tolerance).map_err(meta)?;
        let group = |i| GroupMeta::read(sections.of(Section::Group, i)).map_err(|what| (Section::Group, i, what));
        let groups: Vec<GroupMeta> = (0..sections.groups()).map(group).collect::<Result<_, _>>()?;
        let semantics = groups.iter().flat_map(|group| &group.streams).map(|place| place.semantic);
        let laid_out = group_streams(semantics);
        match (0..groups.len()).find(|&i| laid_out.get(i) != Some(&groups[i].streams)) {
            Some(i) => Err((Section::Group, i, "holds other streams than it should".into())),
            None => Ok((mesh, groups)),
        }
    }

    /// Version 2: one group, whose numbers are among those of the mesh.
    fn read_old(bytes: &[u8]) -> Result<(Self, GroupMeta), String> {
        let Some((numbers_of_all, errors)) = bytes.split_at_checked(64).filter(|(_, errors)| errors.len() == 16) else {
            return Err(format!("has {} bytes, 80 expected", bytes.len()));
        };
        let (
            [format, size, vertices, targets, blocks, entries, words, faces, corners, texcoords],
            [first, second, diagonal, weight_max, position, normal],
        ) = numbers::<10, 6>(numbers_of_all)?;
        let errors: Vec<f64> = errors.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        let tolerance = Tolerance { position, normal };
        let counts = [vertices, targets, faces, corners, texcoords];
        let mesh = Self::checked(format, size, counts, diagonal, weight_max, tolerance)?;
        let [blocks, entries, words] = [blocks, entries, words].map(|n| n as usize);
        let streams = group_streams([]).swap_remove(0);
        let error = checked_error(&streams, &errors)?;
        Ok((mesh, GroupMeta { streams, blocks, entries, words, steps: [first, second], error }))
    }

    fn checked(
        format: u32,
        size: u32,
        counts: [u32; 5],
        diagonal: f32,
        weight_max: f32,
        tolerance: Tolerance,
    ) -> Result<Self, String> {
        let [vertices, targets, faces, corners, texcoords] = counts.map(|n| n as usize);
        let format = DeltaFormat::from_id(format)
            .and_then(DeltaFormat::block_format)
            .ok_or_else(|| format!("names a format {format} that is not known"))?;
        if targets > TARGETS_MAX {
            return Err(format!("names {targets} targets; the kernels name at most {TARGETS_MAX}"));
        }
        Ok(Self { format, size, vertices, targets, faces, corners, texcoords, diagonal, weight_max, tolerance })
    }
}

impl GroupMeta {
    pub fn of(group: &PackedGroup, index: &BlockIndex) -> Result<Self> {
        let streams = group.layout().streams.clone();
        let (blocks, entries, words) = (index.count(), index.entry_count(), group.deltas().len());
        check_counts(&[blocks, entries, words], &group.layout().name)?;
        Ok(Self { streams, blocks, entries, words, steps: index.steps(), error: index.error() })
    }

    pub fn to_bytes(&self) -> Vec<u8> {
        let counts = [self.streams.len(), self.blocks, self.entries, self.words];
        let mut bytes = write_u32s(counts.into_iter().map(|n| n as u32));
        bytes.extend(write_f32s(&self.steps));
        for place in &self.streams {
            bytes.extend(write_u32s([semantic_id(place.semantic), 0].into_iter()));
            bytes.extend(self.error.of(place.semantic).to_le_bytes());
        }
        bytes
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let (head, rest) = bytes.split_at_checked(24).ok_or_else(|| format!("has {} bytes", bytes.len()))?;
        let ([streams, blocks, entries, words], steps) = numbers::<4, TRIPLES>(head)?;
        let (rows, tail) = rest.as_chunks::<16>();
        if (rows.len(), tail.len()) != (streams as usize, 0) {
            return Err(format!("has {} bytes, {} expected", bytes.len(), 24 + 16 * u64::from(streams)));
        }
        let mut semantics = vec![];
        let mut errors = vec![];
        for row in rows {
            let (ids, error) = row.split_at(8);
            let id = read_u32s(ids);
            let semantic = semantic(id[0]).filter(|_| id[1] == 0);
            semantics.push(semantic.ok_or_else(|| format!("names a stream {:#x} that is not known", id[0]))?);
            errors.extend(error.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)));
        }
        let mut first = 0;
        let place = |semantic: Semantic| {
            first += semantic.components();
            StreamPlace { semantic, first: first - semantic.components() }
        };
        let streams: Vec<StreamPlace> = semantics.into_iter().map(place).collect();
        let error = checked_error(&streams, &errors)?;
        let [blocks, entries, words] = [blocks, entries, words].map(|n| n as usize);
        Ok(Self { streams, blocks, entries, words, steps, error })
    }
}

/// The errors of streams, in their order.
fn checked_error(streams: &[StreamPlace], errors: &[f64]) -> Result<PoseError, String> {
    let mut all = PoseError::default();
    for (place, &error) in streams.iter().zip(errors) {
        if !(error.is_finite() && error >= 0.0) {
            return Err(format!("names an error of {error}"));
        }
        let mut one = PoseError::default();
        one.set(place.semantic, error);
        all = all.max(one);
    }
    Ok(all)
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

fn check_counts(counts: &[usize], name: &str) -> Result<()> {
    match counts.iter().find(|n| u32::try_from(**n).is_err()) {
        Some(n) => Err(Error::invalid(format!("mesh '{name}' has {n} of something"), "split the mesh")),
        None => Ok(()),
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
