//! Costs of delta formats: bytes, and errors of deltas.

use super::pose_formats::{PoseCost, Sample, pose_costs};
use crate::input::Input;
use crate::output::{Output, Result};
use crate::verify::scale;
use deltamorph::{DeltaFormat, KeptMesh, PackDesc, PackedMesh};
use serde::Serialize;
use std::sync::Arc;

/// The blocks of a format, with vertices in packed order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Blocks {
    pub format: &'static str,
    pub size: usize,
    pub count: usize,
    /// Pairs of a block and a target that moves some of its vertices.
    pub incidence: usize,
    /// Deltas per vertex of these pairs: 1 if each target moves all vertices of the blocks it touches.
    pub fill: f64,
}

/// The costs and errors of a packed mesh, in the JSON of `info` and `pack`.
#[derive(Serialize)]
pub struct Measured {
    pub name: &'static str,
    pub delta_bytes: u64,
    /// Bytes of vertex indices (dense formats have none).
    pub index_bytes: u64,
    /// Bytes of all vertices' deltas as six floats.
    pub dense_f32_bytes: u64,
    /// Largest error of a position delta, in input units, and as a fraction of the diagonal.
    pub position_error: f64,
    pub position_error_rel: f64,
    /// Largest angle between the exact and the decoded normal at weight 1, in degrees.
    pub normal_error_deg: f64,
    /// Costs and errors of each pose format with these deltas.
    pub pose_formats: Vec<PoseCost>,
    /// Zeros for a dense format.
    #[serde(skip)]
    pub blocks: Blocks,
}

impl Measured {
    /// `held`: a packed file's own mesh.
    pub fn of(packed: &Arc<PackedMesh>, held: bool, sample: &Sample<'_>) -> Self {
        let layout = packed.layout();
        // Blocks know their error.
        let error = layout.error().unwrap_or_else(|| packed.measure_error(&sample.input.kept));
        Self {
            name: layout.format.name(),
            delta_bytes: layout.delta_bytes(),
            index_bytes: layout.index_bytes(),
            dense_f32_bytes: (layout.vertex_count * layout.targets.len() * DeltaFormat::Float32.stride()) as u64,
            position_error: error.position,
            position_error_rel: error.position / scale(layout.diagonal),
            normal_error_deg: error.normal_degrees,
            pose_formats: pose_costs(packed, held, sample),
            blocks: blocks(packed),
        }
    }
}

/// Packs the mesh of `input` in each of `formats`, one after the other. The mesh of a packed file is used as it is for
/// its own format, with the error measured when it was packed. The other formats pack the deltas of the file, and their
/// errors are relative to those.
pub fn measure_all(formats: &[DeltaFormat], input: &Input, sample: &Sample<'_>, out: &Output) -> Result<Vec<Measured>> {
    let bar = out.bar(formats.len() as u64);
    let one = |format: &DeltaFormat| {
        bar.set_message(format!("packing and measuring {}", format.name()));
        let held = input.packed.as_ref().filter(|held| held.layout().format == *format);
        let packed = held.map_or_else(|| pack(&input.kept, *format), |held| Ok(held.clone()))?;
        let measured = Measured::of(&packed, held.is_some(), sample);
        bar.inc(1);
        Ok(measured)
    };
    formats.iter().map(one).collect()
}

fn pack(mesh: &KeptMesh, format: DeltaFormat) -> deltamorph::Result<Arc<PackedMesh>> {
    // One chunk, regardless of devices: chunks change neither bytes nor values.
    let desc = PackDesc { max_chunk_bytes: u64::MAX, max_chunk_vertices: u64::MAX, ..PackDesc::new(format) };
    Ok(Arc::new(PackedMesh::pack(mesh, &desc)?))
}

/// Block statistics of `packed`; zeros for a dense format.
fn blocks(packed: &PackedMesh) -> Blocks {
    let Some(index) = &packed.layout().blocks else { return Blocks::default() };
    let mut deltas = 0usize;
    for target in 0..packed.layout().targets.len() {
        packed.for_each_delta(target, |_, delta| deltas += usize::from(delta != [0.0; 6]));
    }
    let incidence = index.entry_count();
    Blocks {
        format: packed.layout().format.name(),
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

    #[test]
    fn blocks_count_what_is_touched() {
        let mut mesh = mesh();
        let found = |mesh: &KeptMesh, format| blocks(&pack(mesh, format).expect("packed"));
        let small = found(&mesh, DeltaFormat::Small);
        // Vertices that move together are adjacent: 64 of one target take two blocks, three of another at most three.
        assert_eq!((small.size, small.count), (32, 6));
        assert!((3..=5).contains(&small.incidence), "{small:?}");
        assert_eq!(small.fill, 67.0 / (small.incidence * 32) as f64);
        mesh.targets.clear();
        assert_eq!(
            found(&mesh, DeltaFormat::Small),
            Blocks { format: "small", size: 32, count: 6, incidence: 0, fill: 0.0 }
        );
        assert_eq!(found(&mesh, DeltaFormat::Float32), Blocks::default());
    }
}
