//! The dense formats: target after target, every vertex.

use super::formats::{DenseFormat, Lane};
use super::source::largest;
use super::{PackDesc, PackedGroup, PackedLayout, PackedTarget, Source, VERTEX_PADDING};
use crate::error::{Error, Result};

/// Lay out a group densely.
pub(super) fn pack(source: &Source<'_>, desc: &PackDesc, format: &impl DenseFormat) -> Result<PackedGroup> {
    let mesh = source.mesh;
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

    let base = source.base_pose(padded, None);
    let describe = |name: &str, deltas: &[Lane]| {
        let (position_step, normal_exponent) = format.steps(largest(deltas));
        PackedTarget { name: name.to_owned(), position_step, normal_exponent }
    };
    let targets = mesh.targets.iter().map(|target| describe(&target.name, &source.deltas(target))).collect();
    let layout = PackedLayout {
        name: mesh.name.clone(),
        format: desc.format,
        streams: source.streams.clone(),
        vertex_count,
        chunk_vertices,
        diagonal: mesh.diagonal,
        targets,
        blocks: None,
    };
    let mut words_of_all = vec![0; padded * target_count * words];
    for (t, target) in mesh.targets.iter().enumerate() {
        let steps = layout.targets[t].steps();
        for (vertex, delta) in source.deltas(target) {
            let at = layout.word_index(t, vertex as usize);
            format.encode(delta, steps, &mut words_of_all[at..at + words]);
        }
    }
    Ok(PackedGroup { layout, base, words: words_of_all })
}
