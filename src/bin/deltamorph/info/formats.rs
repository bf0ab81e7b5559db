//! What each delta format costs in bytes and in error.

use super::record::FormatRow;
use crate::output::Failure;
use deltamorph::mesh::packed::{DeltaFormat, PackDesc, PackedMesh};
use deltamorph::mesh::{MorphMesh, MorphTarget};
use deltamorph::reference::angle_degrees;
use glam::DVec3;

/// A row for every format.
///
/// # Errors
/// The mesh cannot be packed.
pub fn format_rows(mesh: &MorphMesh) -> Result<Vec<FormatRow>, Failure> {
    DeltaFormat::ALL.into_iter().map(|format| format_row(mesh, format)).collect()
}

fn format_row(mesh: &MorphMesh, format: DeltaFormat) -> Result<FormatRow, Failure> {
    // One chunk, whatever a device would bind: chunks change neither bytes nor values.
    let packed = PackedMesh::pack(mesh, &PackDesc { format, max_chunk_bytes: u64::MAX, max_chunk_vertices: u64::MAX })?;
    let errors = mesh.targets.iter().enumerate().map(|(t, target)| target_error(mesh, &packed, t, target));
    let (position, normal) = errors.fold((0.0, 0.0), |(p, n): (f64, f64), e| (p.max(e.0), n.max(e.1)));
    let dense = (mesh.vertex_count() * mesh.targets.len() * DeltaFormat::Float32.stride()) as u64;
    Ok(FormatRow {
        name: format.name().to_owned(),
        delta_bytes: packed.layout().delta_bytes(),
        index_bytes: 0,
        dense_f32_bytes: dense,
        position_error: position,
        position_error_rel: if mesh.diagonal > 0.0 { position / f64::from(mesh.diagonal) } else { 0.0 },
        normal_error_deg: normal,
    })
}

/// Largest position error, and largest angle of the normal at weight 1, of one target.
fn target_error(mesh: &MorphMesh, packed: &PackedMesh, t: usize, target: &MorphTarget) -> (f64, f64) {
    let deltas = target.vertices.iter().zip(target.positions.iter().zip(&target.normals));
    deltas.fold((0.0, 0.0), |(position, normal): (f64, f64), (&v, (p, n))| {
        let [px, py, pz, nx, ny, nz] = packed.delta(t, v as usize);
        let base = mesh.normals[v as usize].as_dvec3();
        let (exact, decoded) = (base + n.as_dvec3(), base + DVec3::new(nx, ny, nz));
        (position.max(p.as_dvec3().distance(DVec3::new(px, py, pz))), normal.max(angle_degrees(exact, decoded)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn float32_is_exact_and_snorm16_is_half_of_it() {
        let mesh = super::super::tests::mesh();
        let rows = format_rows(&mesh).expect("packed");
        let row = |name: &str| rows.iter().find(|r| r.name == name).expect("a row for each format");
        let (float32, snorm16) = (row("float32"), row("snorm16"));
        assert_eq!((float32.position_error, float32.normal_error_deg), (0.0, 0.0));
        assert_eq!(snorm16.delta_bytes * 2, float32.delta_bytes);
        assert!(snorm16.position_error > 0.0 && snorm16.position_error_rel < 1e-5, "{snorm16:?}");
        assert!(snorm16.normal_error_deg < 0.01, "{snorm16:?}");
    }

    #[test]
    fn angles() {
        assert!((angle_degrees(DVec3::X, DVec3::new(2.0, 2.0, 0.0)) - 45.0).abs() < 1e-12);
        assert_eq!(angle_degrees(DVec3::X, DVec3::ZERO), 0.0);
    }
}
