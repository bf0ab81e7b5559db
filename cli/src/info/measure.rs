//! Costs of delta formats: bytes, and errors of deltas.

use super::pose_formats::{PoseCost, pose_costs};
use crate::output::Failure;
use crate::verify::scale;
use deltamorph::{DeltaFormat, MorphMesh, PackDesc, PackedLayout, PackedMesh, PoseError};
use serde::Serialize;
use std::sync::Arc;

/// The blocks of the format `small`, with vertices in packed order.
#[derive(Debug, Default, PartialEq, Serialize)]
pub struct Blocks {
    pub size: usize,
    pub count: usize,
    /// Pairs of a block and a target that moves some of its vertices.
    pub incidence: usize,
    /// Deltas per vertex of these pairs: 1 if each target moves all vertices of the blocks it touches.
    pub fill: f64,
}

/// Bytes and errors of a packed mesh, in the JSON of `info` and `pack`.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Cost {
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
}

impl Cost {
    pub fn of(layout: &PackedLayout, error: PoseError) -> Self {
        Self {
            delta_bytes: layout.delta_bytes(),
            index_bytes: layout.index_bytes(),
            dense_f32_bytes: (layout.vertex_count * layout.targets.len() * DeltaFormat::Float32.stride()) as u64,
            position_error: error.position,
            position_error_rel: error.position / scale(layout.diagonal),
            normal_error_deg: error.normal_degrees,
        }
    }
}

/// A packed mesh and its cost: in the JSON of `info`, the row of its format.
#[derive(Serialize)]
pub struct Measured {
    pub name: &'static str,
    #[serde(flatten)]
    pub cost: Cost,
    /// Costs and errors of each pose format with these deltas.
    pub pose_formats: Vec<PoseCost>,
    #[serde(skip)]
    pub packed: Arc<PackedMesh>,
}

impl Measured {
    /// `source`: the mesh that was packed, with all of its deltas, if it is known.
    fn new(packed: Arc<PackedMesh>, error: PoseError, source: Option<&MorphMesh>) -> Self {
        let layout = packed.layout();
        let name = layout.format.name();
        Self { name, cost: Cost::of(layout, error), pose_formats: pose_costs(&packed, source), packed }
    }
}

/// Packs `mesh`, kept of `source`, in every format. `held`: the mesh of a packed file, used as it is for its own format, with the error
/// measured when it was packed. The other formats pack the deltas of the file, and their errors are relative to those.
pub fn measure_all(
    mesh: &MorphMesh,
    source: &MorphMesh,
    held: Option<&Arc<PackedMesh>>,
) -> Result<Vec<Measured>, Failure> {
    let one = |format| match held.map(|held| (held, &held.layout().blocks)) {
        Some((held, Some(blocks))) if held.layout().format == format => {
            Ok(Measured::new(held.clone(), blocks.error(), None))
        }
        _ => measure(mesh, source, format),
    };
    DeltaFormat::ALL.into_iter().map(one).collect()
}

fn measure(mesh: &MorphMesh, source: &MorphMesh, format: DeltaFormat) -> Result<Measured, Failure> {
    // One chunk, regardless of devices: chunks change neither bytes nor values.
    let desc = PackDesc::new(format).max_chunk_bytes(u64::MAX).max_chunk_vertices(u64::MAX);
    let packed = Arc::new(PackedMesh::pack(mesh, &desc)?);
    let error = packed.measure_error(mesh);
    Ok(Measured::new(packed, error, Some(source)))
}

/// Block statistics of `packed`; zeros for a dense format.
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

    #[test]
    fn blocks_count_what_is_touched() {
        let mut mesh = mesh();
        let found = |mesh: &MorphMesh, format| blocks(&measure(mesh, mesh, format).expect("packed").packed);
        let small = found(&mesh, DeltaFormat::Small);
        // Vertices that move together are adjacent: 64 of one target take two blocks, three of another at most three.
        assert_eq!((small.size, small.count), (32, 6));
        assert!((3..=5).contains(&small.incidence), "{small:?}");
        assert_eq!(small.fill, 67.0 / (small.incidence * 32) as f64);
        mesh.targets.clear();
        assert_eq!(found(&mesh, DeltaFormat::Small), Blocks { size: 32, count: 6, incidence: 0, fill: 0.0 });
        assert_eq!(found(&mesh, DeltaFormat::Float32), Blocks::default());
    }
}
