//! Packed files with valid checksums: sections are mutated one at a time, and accepted files are used.

use crate::testing;
use crate::{Memory, Random, Target, bounded, check_error, update};
use deltamorph::{
    BatchSize, DeltaFormat, PackDesc, PackedMesh, Tolerance, UpdateDesc, UpdatePath, WeightBounds, WeightClip,
};
use deltamorph_head::{HeadDesc, head};
use std::path::Path;
use std::sync::Arc;

pub const TARGET: Target = Target { name: "dmorph", run, mutate, seeds };

/// "A small multiple of its size" (src/pack/file.rs).
const MEMORY: Memory = Memory { base: 64 << 10, per_byte: 32 };

fn run(data: &[u8]) {
    let mut bytes = data.to_vec();
    repair(&mut bytes);
    let path = Path::new("head.dmorph");
    let read = bounded("PackedMesh::from_bytes", bytes.len(), MEMORY, || PackedMesh::from_bytes(path, &bytes));
    let mesh = match read {
        Ok(mut mesh) => {
            // Damaged clips are left out with a note, which is not written.
            mesh.notes.clear();
            Arc::new(mesh)
        }
        Err(error) => return check_error(error),
    };
    // An accepted file is written back unchanged.
    let again = mesh.to_bytes().expect("it was accepted");
    assert!(PackedMesh::from_bytes(path, &again).expect("it was written") == *mesh);
    let decoded = mesh.unpack().expect("blocks");
    assert!(decoded.targets.iter().all(|target| target.vertices.is_sorted_by(|a, b| a < b)));
    let layout = mesh.layout();
    if let Err(error) = mesh.render_vertices() {
        check_error(error);
    }
    let mut indices: Vec<u32> = (0..layout.vertex_count as u32).collect();
    layout.remap_indices(&mut indices).expect("all are vertices");
    let targets = layout.targets.len();
    if layout.vertex_count > 2000 || targets > 256 {
        return;
    }
    update(&mesh, crc32fast::hash(data));
    match WeightBounds::new(&mesh, &UpdateDesc::new(UpdatePath::Cpu, BatchSize::All)) {
        Ok(bounds) => _ = bounds.of(&vec![0.5; targets], 0.0),
        Err(error) => check_error(error),
    }
}

// A header of 16 bytes, with version and number of sections; a row of 24 for each; checksum and zero; then the
// sections.
const HEADER: usize = 16;
const ROW: usize = 24;

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|bytes| u32::from_le_bytes(*bytes))
}

/// Returns the rows of the table, and its end; `None` if it does not fit the file.
fn rows(bytes: &[u8]) -> Option<(impl Iterator<Item = usize> + use<>, usize)> {
    let end = HEADER + ROW * u32_at(bytes, 12).filter(|count| *count < 200)? as usize;
    (bytes.len() >= end + 8).then_some(((HEADER..end).step_by(ROW), end))
}

/// Returns the content of the section that a row names.
fn section(bytes: &[u8], row: usize) -> Option<&[u8]> {
    let (offset, length) = (u32_at(bytes, row + 8)? as usize, u32_at(bytes, row + 16)? as usize);
    bytes.get(offset..offset.checked_add(length)?)
}

/// Corrects the checksums, if the table is usable.
fn repair(bytes: &mut [u8]) {
    let Some((rows, end)) = rows(bytes) else { return };
    for row in rows {
        if let Some(checksum) = section(bytes, row).map(crc32fast::hash) {
            bytes[row + 4..row + 8].copy_from_slice(&checksum.to_le_bytes());
        }
    }
    let checksum = crc32fast::hash(&bytes[..end]);
    bytes[end..end + 4].copy_from_slice(&checksum.to_le_bytes());
}

/// Replaces the sections of a file, with correct positions and lengths.
fn joined(bytes: &[u8], end: usize, sections: &[Vec<u8>]) -> Vec<u8> {
    let (mut out, mut rest) = (bytes[..end + 8].to_vec(), vec![]);
    for (i, content) in sections.iter().enumerate() {
        let row = HEADER + ROW * i;
        out[row + 8..row + 16].copy_from_slice(&((end + 8 + rest.len()) as u64).to_le_bytes());
        out[row + 16..row + 24].copy_from_slice(&(content.len() as u64).to_le_bytes());
        rest.extend(content);
        rest.resize(rest.len().next_multiple_of(8), 0);
    }
    out.extend(rest);
    out
}

/// Changes words of sections, and makes sections longer or shorter. Small sections are chosen as often as large ones.
fn mutate(data: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let (rows, end) = rows(data)?;
    let mut sections: Vec<Vec<u8>> = rows.map(|row| section(data, row).map(<[u8]>::to_vec)).collect::<Option<_>>()?;
    if sections.is_empty() {
        return None;
    }
    for _ in 0..1 + random.below(3) {
        let chosen = random.below(sections.len());
        let content = &mut sections[chosen];
        match random.below(6) {
            0 => content.truncate(random.below(content.len() + 1) & !3),
            1 => content.extend_from_within(..(4 * random.below(8)).min(content.len())),
            _ => random.change_word(content),
        }
    }
    Some(joined(data, end, &sections))
}

fn seeds() -> Vec<(String, Vec<u8>)> {
    let head = head(&HeadDesc { vertices: 60, targets: 5, ..Default::default() });
    let head = head.kept(Tolerance::default()).expect("the built-in head");
    let streams = testing::with_streams(testing::mesh(40, 3));
    let mut seeds = vec![];
    for format in DeltaFormat::ALL.into_iter().filter(|format| format.is_blocks()) {
        for (name, mesh) in [("head", &head), ("streams", &streams)] {
            let mut packed = PackedMesh::pack(mesh, &PackDesc::new(format)).expect("a mesh for tests");
            seeds.push((format!("{name}-{}", format.name()), packed.to_bytes().expect("it was packed")));
            if format == DeltaFormat::Fast {
                let names = vec!["jawOpen".to_owned(), "x".to_owned()];
                let clip = WeightClip { name: "clip".into(), names, fps: 30.0, values: vec![0.5; 6], notes: vec![] };
                packed.clips = vec![clip];
                seeds.push((format!("{name}-clip"), packed.to_bytes().expect("it was packed")));
            }
        }
    }
    seeds
}
