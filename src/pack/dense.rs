//! The dense formats: target after target, every vertex.

use super::{DeltaFormat, PackDesc, PackedLayout, PackedMesh, PackedTarget, VERTEX_PADDING, base_words};
use crate::error::{Error, Result};
use crate::mesh::{MorphMesh, MorphTarget};
use glam::Vec3;

const SNORM16_MAX: f32 = 32767.0;

/// The steps of one snorm16 target: the smallest that let its largest component fit.
fn snorm16_steps(target: &MorphTarget) -> (f32, i8) {
    let largest = |deltas: &[Vec3]| deltas.iter().map(|d| d.abs().max_element()).fold(0.0, f32::max);
    let (position, normal) = (largest(&target.positions), largest(&target.normals));
    // A target that only turns normals still needs a step of its own for positions.
    let position = if position > 0.0 { position } else { normal };
    // Not below what a float32 coefficient can carry: a target smaller than that is no target.
    let step = (position / SNORM16_MAX).max(1e-30);
    if normal == 0.0 {
        return (step, 0);
    }
    let exponent = (normal / (SNORM16_MAX * step)).log2().ceil().clamp(-100.0, 100.0);
    (step, exponent as i8)
}

/// Round to the nearest step; zero stays zero.
fn quantise(value: f32, step: f32) -> u32 {
    let q = (f64::from(value) / f64::from(step)).round().clamp(-32767.0, 32767.0) as i16;
    u32::from(q as u16)
}

/// Lay out `mesh` densely.
pub(super) fn pack(mesh: &MorphMesh, desc: &PackDesc) -> Result<PackedMesh> {
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
        let (position_step, normal_exponent) = match desc.format {
            DeltaFormat::Snorm16 => snorm16_steps(target),
            _ => (1.0, 0),
        };
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
        pack_target(&layout, t, target, &mut deltas);
    }
    Ok(PackedMesh { layout, base, words: deltas })
}

/// Write the deltas of target `t` where `layout` wants them.
fn pack_target(layout: &PackedLayout, t: usize, target: &MorphTarget, deltas: &mut [u32]) {
    let info = &layout.targets[t];
    let normal_step = info.normal_step();
    for ((&vertex, p), n) in target.vertices.iter().zip(&target.positions).zip(&target.normals) {
        let at = layout.word_index(t, vertex as usize);
        let out = &mut deltas[at..at + layout.format.words()];
        match layout.format {
            DeltaFormat::Snorm16 => {
                let [px, py, pz] = p.to_array().map(|v| quantise(v, info.position_step));
                let [nx, ny, nz] = n.to_array().map(|v| quantise(v, normal_step));
                out.copy_from_slice(&[px | py << 16, pz | nx << 16, ny | nz << 16]);
            }
            _ => {
                for (word, value) in out.iter_mut().zip(p.to_array().into_iter().chain(n.to_array())) {
                    *word = value.to_bits();
                }
            }
        }
    }
}
