//! Packing in dense formats: every vertex of every target.

use super::formats::{DenseFormat, Lane};
use super::grid::{MeshSums, Reached, Sums};
use super::source::largest;
use super::{POSE_FLOATS, PackDesc, PackedGroup, PackedLayout, PackedTarget, Source, VERTEX_PADDING};
use crate::asset::streams::{StreamPlace, TRIPLE, TRIPLES};
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
    let mut layout = PackedLayout {
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
    let mut reached = desc.format.has_integers().then(|| Added::new(padded));
    let mut words_of_all = vec![0; padded * target_count * words];
    for (t, target) in mesh.targets.iter().enumerate() {
        let steps = layout.targets[t].steps();
        for (vertex, delta) in source.deltas(target) {
            let at = layout.word_index(t, vertex as usize);
            format.encode(delta, steps, &mut words_of_all[at..at + words]);
            let moved = reached.as_mut().map(|reached| (reached, format.decode(&words_of_all[at..at + words], steps)));
            moved.into_iter().for_each(|(reached, delta)| reached.add(vertex as usize, delta, steps));
        }
    }
    layout.sums = reached.map(|reached| MeshSums::of(reached.sums(desc, &source.streams)));
    layout.take_base(&base);
    Ok(PackedGroup { layout, base, words: words_of_all })
}

/// Bounds on the sums of each vertex.
struct Added {
    /// By vertex: Σ|delta| of each component, and the number of targets that move it.
    vertices: Vec<([f64; POSE_FLOATS], usize)>,
    /// By triple: the finest and the coarsest step of the targets that move it.
    steps: [(f32, f32); TRIPLES],
}

impl Added {
    fn new(vertices: usize) -> Self {
        Self { vertices: vec![([0.0; POSE_FLOATS], 0); vertices], steps: [(f32::INFINITY, 0.0); TRIPLES] }
    }

    fn add(&mut self, vertex: usize, delta: [f64; POSE_FLOATS], steps: [f32; TRIPLES]) {
        let (sums, targets) = &mut self.vertices[vertex];
        *targets += usize::from(delta != [0.0; POSE_FLOATS]);
        for (c, number) in delta.into_iter().enumerate().filter(|(_, number)| *number != 0.0) {
            let (finest, coarsest) = &mut self.steps[c / TRIPLE];
            (*finest, *coarsest) = (finest.min(steps[c / TRIPLE]), coarsest.max(steps[c / TRIPLE]));
            sums[c] += number.abs();
        }
    }

    fn sums(self, desc: &PackDesc, streams: &[StreamPlace]) -> Sums {
        // A triple that nothing moves may have any step. The ratio of two steps may exceed float32's range.
        let found = self.steps.map(|(finest, coarsest)| if coarsest > 0.0 { (finest, coarsest) } else { (1.0, 1.0) });
        let steps = found.map(|(finest, _)| finest);
        let range = found.map(|(finest, coarsest)| (f64::from(coarsest) / f64::from(finest)).log2() as u32);
        let reached = self.vertices.chunks(VERTEX_PADDING).map(|vertices| {
            let largest = |c: usize| vertices.iter().fold(0.0, |most: f64, (sums, _)| most.max(sums[c]));
            Reached { sums: std::array::from_fn(|c| largest(c) / f64::from(steps[c / TRIPLE])), ..Reached::default() }
        });
        let targets = self.vertices.iter().map(|(_, targets)| *targets).max().unwrap_or(0);
        let sums = Sums::new(desc.format, steps, streams, reached.collect(), desc.blocks.weight_max);
        Sums { coarsest: Some(range), targets, ..sums }
    }
}
