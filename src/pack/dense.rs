//! Packing in dense formats: every vertex of every target.

use super::formats::{DenseFormat, Lane};
use super::source::largest;
use super::{PackDesc, PackedGroup, PackedLayout, PackedTarget, Source, VERTEX_PADDING};
use crate::error::{Result, ensure};
use std::sync::Arc;

pub(super) fn pack(source: &Source<'_>, desc: &PackDesc, format: &impl DenseFormat) -> Result<PackedGroup> {
    let mesh = source.mesh;
    let vertex_count = mesh.vertex_count();
    let padded = vertex_count.next_multiple_of(VERTEX_PADDING);
    let target_count = mesh.targets.len();
    let words = desc.format.words();
    let per_padding = target_count * VERTEX_PADDING * desc.format.stride();
    let most = desc.max_chunk_bytes;
    let what = format!("{target_count} targets need {per_padding} bytes of deltas for {VERTEX_PADDING} vertices");
    let what = format!("mesh '{}': {what}, but the device binds at most {most} bytes at once", mesh.name);
    ensure!(per_padding as u64 <= most, what, "use fewer targets or the snorm16 format");
    // Whole workgroups, at least one.
    let groups = most.checked_div(per_padding as u64).unwrap_or(u64::MAX);
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
        origin: mesh.origin,
        targets,
        indices: Arc::default(),
        blocks: None,
        sums: None,
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
