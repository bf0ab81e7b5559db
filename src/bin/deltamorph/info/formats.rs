//! What each delta format costs in bytes and in error.

use super::record::FormatRow;
use crate::output::Failure;
use deltamorph::mesh::MorphMesh;
use deltamorph::mesh::packed::{DeltaFormat, PackDesc, PackError, PackedMesh};

/// A row for every format. That of `held`, where `mesh` comes from a packed file, is the file's own: with the error
/// that was measured when it was packed. The others pack what the file holds, and their errors are against that.
///
/// # Errors
/// The mesh cannot be packed.
pub fn format_rows(mesh: &MorphMesh, held: Option<&PackedMesh>) -> Result<Vec<FormatRow>, Failure> {
    let row = |format| match held.filter(|held| held.layout().format == format) {
        Some(held) => {
            let error = held.layout().blocks.as_ref().map_or_else(PackError::default, |blocks| blocks.error());
            Ok(describe(mesh, held, error))
        }
        None => format_row(mesh, format),
    };
    DeltaFormat::ALL.into_iter().map(row).collect()
}

fn format_row(mesh: &MorphMesh, format: DeltaFormat) -> Result<FormatRow, Failure> {
    // One chunk, whatever a device would bind: chunks change neither bytes nor values.
    let desc = PackDesc { max_chunk_bytes: u64::MAX, max_chunk_vertices: u64::MAX, ..PackDesc::new(format) };
    let packed = PackedMesh::pack(mesh, &desc)?;
    Ok(describe(mesh, &packed, packed.measure_error(mesh)))
}

fn describe(mesh: &MorphMesh, packed: &PackedMesh, error: PackError) -> FormatRow {
    let dense = (mesh.vertex_count() * mesh.targets.len() * DeltaFormat::Float32.stride()) as u64;
    FormatRow {
        name: packed.layout().format.name().to_owned(),
        delta_bytes: packed.layout().delta_bytes(),
        index_bytes: packed.layout().index_bytes(),
        dense_f32_bytes: dense,
        position_error: error.position,
        position_error_rel: if mesh.diagonal > 0.0 { error.position / f64::from(mesh.diagonal) } else { 0.0 },
        normal_error_deg: error.normal_degrees,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::mesh::packed::file::Asset;

    #[test]
    fn float32_is_exact_and_snorm16_is_half_of_it() {
        let mesh = super::super::tests::mesh();
        let rows = format_rows(&mesh, None).expect("packed");
        let row = |name: &str| rows.iter().find(|r| r.name == name).expect("a row for each format");
        let (float32, snorm16) = (row("float32"), row("snorm16"));
        assert_eq!((float32.position_error, float32.normal_error_deg), (0.0, 0.0));
        assert_eq!(snorm16.delta_bytes * 2, float32.delta_bytes);
        assert!(snorm16.position_error > 0.0 && snorm16.position_error_rel < 1e-5, "{snorm16:?}");
        assert!(snorm16.normal_error_deg < 0.01, "{snorm16:?}");
    }

    #[test]
    fn a_packed_file_shows_its_own_error() {
        let mesh = super::super::tests::mesh();
        let asset = Asset::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).expect("packed");
        let rows = format_rows(&asset.to_mesh().expect("decoded"), Some(&asset.mesh)).expect("rows");
        let error = asset.mesh.measure_error(&mesh);
        let small = rows.iter().find(|r| r.name == "small").expect("a row");
        assert_eq!((small.position_error, small.normal_error_deg), (error.position, error.normal_degrees));
        assert!(small.position_error > 0.0);
        assert_eq!(rows[0].position_error, 0.0, "float32 holds what the file holds");
    }
}
