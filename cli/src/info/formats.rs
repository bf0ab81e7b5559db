//! What each delta format costs in bytes and in error.

use super::record::{Blocks, FormatRow};
use crate::output::Failure;
use deltamorph::{BlockDesc, DeltaFormat, MorphMesh, PackDesc, PackedMesh};
use std::sync::Arc;

/// `mesh` in every format; `held`, where it comes from a packed file, as the file has it. The others pack what the file
/// holds, and their errors are against that.
pub fn pack_all(mesh: &MorphMesh, held: Option<&Arc<PackedMesh>>) -> Result<Vec<Arc<PackedMesh>>, Failure> {
    let pack = |format| match held.filter(|held| held.layout().format == format) {
        Some(held) => Ok(held.clone()),
        None => pack(mesh, format, BlockDesc::default()).map(Arc::new),
    };
    DeltaFormat::ALL.into_iter().map(pack).collect()
}

/// `mesh` in one format.
pub fn pack(mesh: &MorphMesh, format: DeltaFormat, blocks: BlockDesc) -> Result<PackedMesh, Failure> {
    // One chunk, whatever a device would bind: chunks change neither bytes nor values.
    let desc = PackDesc { max_chunk_bytes: u64::MAX, max_chunk_vertices: u64::MAX, blocks, ..PackDesc::new(format) };
    Ok(PackedMesh::pack(mesh, &desc)?)
}

/// Bytes of every vertex' delta in every target, as six floats.
pub fn dense_bytes(mesh: &MorphMesh) -> u64 {
    (mesh.vertex_count() * mesh.targets.len() * DeltaFormat::Float32.stride()) as u64
}

/// What `packed` costs. The mesh that a file held has the error that was measured when it was packed.
pub fn format_row(mesh: &MorphMesh, held: Option<&PackedMesh>, packed: &PackedMesh) -> FormatRow {
    let error = match (held.is_some_and(|held| held.layout().format == packed.layout().format), &packed.layout().blocks)
    {
        (true, Some(blocks)) => blocks.error(),
        _ => packed.measure_error(mesh),
    };
    FormatRow {
        name: packed.layout().format.name().to_owned(),
        delta_bytes: packed.layout().delta_bytes(),
        index_bytes: packed.layout().index_bytes(),
        dense_f32_bytes: dense_bytes(mesh),
        position_error: error.position,
        position_error_rel: if mesh.diagonal > 0.0 { error.position / f64::from(mesh.diagonal) } else { 0.0 },
        normal_error_deg: error.normal_degrees,
    }
}

/// How tightly the targets fill the blocks of `packed`; nothing for a dense format.
pub fn blocks(packed: &PackedMesh) -> Blocks {
    let Some(index) = &packed.layout().blocks else { return Blocks::default() };
    let mut deltas = 0usize;
    for target in 0..packed.layout().targets.len() {
        packed.for_each_delta(target, |_, delta| deltas += usize::from(delta != [0.0; 6]));
    }
    let incidence = index.entry_count();
    Blocks {
        size: index.size(),
        count: index.count(),
        incidence,
        fill: deltas as f64 / (incidence * index.size()).max(1) as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::info::tests::mesh;
    use deltamorph::Asset;

    #[test]
    fn every_format_has_a_row_with_its_bytes_and_errors() {
        let mesh = mesh();
        let packed = pack_all(&mesh, None).expect("packed");
        let rows: Vec<FormatRow> = packed.iter().map(|p| format_row(&mesh, None, p)).collect();
        let row = |name: &str| rows.iter().find(|r| r.name == name).expect("a row for each format");
        let (float32, snorm16) = (row("float32"), row("snorm16"));
        assert_eq!((float32.position_error, float32.normal_error_deg), (0.0, 0.0));
        assert_eq!(snorm16.delta_bytes * 2, float32.delta_bytes);
        assert!(snorm16.position_error > 0.0 && snorm16.position_error_rel < 1e-5, "{snorm16:?}");
        assert!(snorm16.normal_error_deg < 0.01, "{snorm16:?}");
        for (name, allowed) in [("block-float32", 0.0), ("fast", 1e-5), ("small", 1e-5), ("pair", 1e-4)] {
            let row = row(name);
            assert!(row.delta_bytes > 0 && row.position_error_rel <= allowed, "{row:?}");
            assert!(row.index_bytes > 0 || name == "block-float32", "{row:?}");
        }
    }

    #[test]
    fn blocks_count_what_is_touched() {
        let mut mesh = mesh();
        let small = |mesh: &MorphMesh| pack(mesh, DeltaFormat::Small, BlockDesc::default()).expect("packed");
        let found = blocks(&small(&mesh));
        // Vertices that move together lie together: 64 of one target take two blocks, three of another at most three.
        assert_eq!((found.size, found.count), (32, 6));
        assert!((3..=5).contains(&found.incidence), "{found:?}");
        assert_eq!(found.fill, 67.0 / (found.incidence * 32) as f64);
        mesh.targets.clear();
        assert_eq!(blocks(&small(&mesh)), Blocks { size: 32, count: 6, incidence: 0, fill: 0.0 });
        assert_eq!(
            blocks(&pack(&mesh, DeltaFormat::Float32, BlockDesc::default()).expect("packed")),
            Blocks::default()
        );
    }

    #[test]
    fn a_packed_file_shows_its_own_error() {
        let mesh = mesh();
        let asset = Asset::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).expect("packed");
        let (decoded, held) = (asset.to_mesh().expect("decoded"), Arc::new(asset.mesh));
        let packed = pack_all(&decoded, Some(&held)).expect("packed");
        let rows: Vec<FormatRow> = packed.iter().map(|p| format_row(&decoded, Some(&held), p)).collect();
        let error = held.measure_error(&mesh);
        let small = rows.iter().find(|r| r.name == "small").expect("a row");
        assert_eq!((small.position_error, small.normal_error_deg), (error.position, error.normal_degrees));
        assert!(small.position_error > 0.0);
        assert_eq!(rows[0].position_error, 0.0, "float32 holds what the file holds");
    }
}
