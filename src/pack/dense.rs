//! The dense formats: target after target, every vertex.

use super::formats::DenseFormat;
use super::{PackDesc, PackedLayout, PackedMesh, PackedTarget, VERTEX_PADDING, base_words};
use crate::error::{Error, Result};
use crate::mesh::{MorphMesh, MorphTarget};
use glam::Vec3;

/// Lay out `mesh` densely.
pub(super) fn pack(mesh: &MorphMesh, desc: &PackDesc, format: &impl DenseFormat) -> Result<PackedMesh> {
    let vertex_count = mesh.vertex_count();
    let padded = vertex_count.next_multiple_of(VERTEX_PADDING);
    let target_count = mesh.targets.len();
    let words = desc.format.words();
    let per_padding = target_count * VERTEX_PADDING * desc.format.stride();
    if per_padding as u64 > desc.max_chunk_bytes {
        return Err(Error::invalid(
            format!(
                "mesh '{}': {target_count} targets need {per_padding} bytes of deltas for {VERTEX_PADDING} vertices, \
                 but the device binds at most {} bytes at once",
                mesh.name, desc.max_chunk_bytes
            ),
            "use fewer targets or the snorm16 format",
        ));
    }
    // Whole workgroups, at least one.
    let groups = desc.max_chunk_bytes.checked_div(per_padding as u64).unwrap_or(u64::MAX);
    let groups = groups.min(desc.max_chunk_vertices / VERTEX_PADDING as u64).max(1);
    let chunk_vertices = groups.saturating_mul(VERTEX_PADDING as u64).min(padded as u64) as usize;

    let base = base_words(mesh, padded, None);
    let describe = |target: &MorphTarget| {
        let largest = |deltas: &[Vec3]| deltas.iter().map(|d| d.abs().max_element()).fold(0.0, f32::max);
        let (position_step, normal_exponent) = format.steps([largest(&target.positions), largest(&target.normals)]);
        PackedTarget { name: target.name.clone(), position_step, normal_exponent }
    };
    let layout = PackedLayout {
        name: mesh.name.clone(),
        format: desc.format,
        vertex_count,
        chunk_vertices,
        diagonal: mesh.diagonal,
        targets: mesh.targets.iter().map(describe).collect(),
        blocks: None,
    };
    let mut deltas = vec![0; padded * target_count * words];
    for (t, target) in mesh.targets.iter().enumerate() {
        pack_target(&layout, format, t, target, &mut deltas);
    }
    Ok(PackedMesh { layout, base, words: deltas })
}

/// Write the deltas of target `t` where `layout` wants them.
fn pack_target(layout: &PackedLayout, format: &impl DenseFormat, t: usize, target: &MorphTarget, deltas: &mut [u32]) {
    let info = &layout.targets[t];
    let steps = [info.position_step, info.normal_step()];
    for ((&vertex, p), n) in target.vertices.iter().zip(&target.positions).zip(&target.normals) {
        let at = layout.word_index(t, vertex as usize);
        let out = &mut deltas[at..at + layout.format.words()];
        format.encode([p.x, p.y, p.z, n.x, n.y, n.z], steps, out);
    }
}
