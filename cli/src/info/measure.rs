//! Costs of delta formats: bytes, errors of deltas, and errors of whole poses.

use super::pose_formats::{PoseCost, pose_costs};
use crate::input::Input;
use crate::output::{Failure, Output};
use crate::verify::scale;
use deltamorph::packed::BLOCK_SIZES;
use deltamorph::reference::{SHORTEST_NORMAL, angle_degrees, compare, evaluate, evaluate_unpacked};
use deltamorph::{
    BlockDesc, BoundClip, DeltaFormat, MorphMesh, POSE_FLOATS, PackDesc, PackedLayout, PackedMesh, PoseError,
};
use glam::DVec3;
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
    fn new(packed: Arc<PackedMesh>, error: PoseError) -> Self {
        let layout = packed.layout();
        Self { name: layout.format.name(), cost: Cost::of(layout, error), pose_formats: pose_costs(layout), packed }
    }
}

/// Packs `mesh` in every format. `held`: the mesh of a packed file, used as it is for its own format, with the error
/// measured when it was packed. The other formats pack the deltas of the file, and their errors are relative to those.
pub fn measure_all(mesh: &MorphMesh, held: Option<&Arc<PackedMesh>>) -> Result<Vec<Measured>, Failure> {
    let one = |format| match held.map(|held| (held, &held.layout().blocks)) {
        Some((held, Some(blocks))) if held.layout().format == format => Ok(Measured::new(held.clone(), blocks.error())),
        _ => measure(mesh, format, BlockDesc::default()),
    };
    DeltaFormat::ALL.into_iter().map(one).collect()
}

pub fn measure(mesh: &MorphMesh, format: DeltaFormat, blocks: BlockDesc) -> Result<Measured, Failure> {
    // One chunk, regardless of devices: chunks change neither bytes nor values.
    let desc = PackDesc::new(format).max_chunk_bytes(u64::MAX).max_chunk_vertices(u64::MAX).blocks(blocks);
    let packed = Arc::new(PackedMesh::pack(mesh, &desc)?);
    let error = packed.measure_error(mesh);
    Ok(Measured::new(packed, error))
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

/// Options of packing, and their cost.
#[derive(Debug, Serialize)]
pub struct SweepRow {
    pub format: &'static str,
    /// Vertices per block; `None` for dense formats.
    pub block_size: Option<usize>,
    /// Position error allowed, as a fraction of the diagonal; `None` if the format has no such choice.
    pub position_allowed_rel: Option<f32>,
    /// Normal error allowed, in degrees.
    pub normal_allowed_deg: Option<f32>,
    /// Bytes of deltas and indices.
    pub bytes: u64,
    /// The same as a share of all vertices' deltas as six floats.
    pub share: f64,
    #[serde(flatten)]
    pub cost: Cost,
}

/// The largest errors of whole poses of a clip against the raw files: dropped deltas and packing together.
#[derive(Debug, Serialize)]
pub struct PoseRow {
    pub clip: String,
    pub frames: usize,
    pub format: &'static str,
    /// Largest position error, as a fraction of the diagonal.
    pub position_error_rel: f64,
    /// Largest angle between normals, in degrees. If targets fold a normal to almost nothing, a small error turns it
    /// far.
    pub normal_error_deg: f64,
    /// The angle that 999 of 1000 normals do not exceed, in degrees.
    pub normal_error_p999_deg: f64,
}

/// Steps of √10 from 1e-3 to 1e-6 of the diagonal.
const STEPS: i32 = 7;
/// Most frames of a clip to evaluate.
const FRAMES: usize = 32;

/// The format `small` over a range of allowed errors and block sizes, then every format with its defaults.
pub fn sweep(mesh: &MorphMesh, formats: &[Measured], out: &Output) -> Result<Vec<SweepRow>, Failure> {
    let bar = out.bar(STEPS as u64 * BLOCK_SIZES.len() as u64);
    let default = BlockDesc::default();
    let mut rows = vec![];
    for size in BLOCK_SIZES {
        for step in 0..STEPS {
            let position_error = 10f32.powf(-3.0 - 0.5 * step as f32);
            // Proportional to the defaults.
            let normal_error_degrees = default.normal_error_degrees * position_error / default.position_error;
            let desc =
                default.size(Some(size)).position_error(position_error).normal_error_degrees(normal_error_degrees);
            bar.set_message(format!("small, {position_error:.1e} of the diagonal, blocks of {size}"));
            rows.push(row(&measure(mesh, DeltaFormat::Small, desc)?, Some(desc)));
            bar.inc(1);
        }
    }
    rows.extend(formats.iter().map(|measured| row(measured, None)));
    Ok(rows)
}

fn row(measured: &Measured, desc: Option<BlockDesc>) -> SweepRow {
    let cost = measured.cost;
    let bytes = cost.delta_bytes + cost.index_bytes;
    SweepRow {
        format: measured.name,
        block_size: measured.packed.layout().blocks.as_ref().map(|b| b.size()),
        position_allowed_rel: desc.map(|d| d.position_error),
        normal_allowed_deg: desc.map(|d| d.normal_error_degrees),
        bytes,
        share: bytes as f64 / cost.dense_f32_bytes.max(1) as f64,
        cost,
    }
}

/// The largest errors of poses of each clip in each format, against the raw files.
pub fn poses(input: &Input, formats: &[Measured], clips: &[BoundClip], out: &Output) -> Vec<PoseRow> {
    let bar = out.bar(clips.iter().map(|c| c.frame_count().min(FRAMES) as u64).sum());
    let mut rows = vec![];
    for clip in clips {
        let frames = spread(clip.frame_count());
        let mut errors = vec![Errors::default(); formats.len()];
        bar.set_message(format!("poses of {}", clip.name));
        for &frame in &frames {
            let Ok(weights) = &clip.frame(frame) else { continue };
            let truth = evaluate_unpacked(&input.raw, weights);
            for (format, error) in formats.iter().zip(&mut errors) {
                error.add(&evaluate(&format.packed, weights), &truth);
            }
            bar.inc(1);
        }
        rows.extend(formats.iter().zip(errors).map(|(format, error)| PoseRow {
            clip: clip.name.clone(),
            frames: frames.len(),
            format: format.name,
            position_error_rel: error.largest.position / scale(input.kept.diagonal),
            normal_error_deg: error.largest.normal_degrees,
            normal_error_p999_deg: error.usual_angle().into(),
        }));
    }
    rows
}

/// The errors of some poses.
#[derive(Clone, Default)]
struct Errors {
    largest: PoseError,
    /// Angles of all normals with a direction.
    angles: Vec<f32>,
}

impl Errors {
    fn add(&mut self, pose: &[f64], truth: &[f64]) {
        let floats: Vec<f32> = pose.iter().map(|&v| v as f32).collect();
        self.largest = self.largest.max(compare(&floats, truth));
        let normals =
            |pose: &[f64]| pose.chunks_exact(POSE_FLOATS).map(|v| DVec3::from_slice(&v[3..])).collect::<Vec<_>>();
        let pairs = normals(pose).into_iter().zip(normals(truth)).filter(|(_, b)| b.length() >= SHORTEST_NORMAL);
        self.angles.extend(pairs.map(|(a, b)| angle_degrees(a, b) as f32));
    }

    /// The angle that 999 of 1000 normals do not exceed.
    fn usual_angle(mut self) -> f32 {
        let at = self.angles.len() * 999 / 1000;
        if at == self.angles.len() { 0.0 } else { *self.angles.select_nth_unstable_by(at, f32::total_cmp).1 }
    }
}

/// Up to [`FRAMES`] of `count` frames, including the last one.
fn spread(count: usize) -> Vec<usize> {
    let n = count.min(FRAMES);
    (1..=n).map(|i| count * i / n - 1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::info::tests::mesh;

    #[test]
    fn every_format_has_a_row_with_its_bytes_and_errors() {
        let rows = measure_all(&mesh(), None).expect("packed");
        let cost = |name: &str| &rows.iter().find(|r| r.name == name).expect("a row for each format").cost;
        let (float32, snorm16) = (cost("float32"), cost("snorm16"));
        assert_eq!((float32.position_error, float32.normal_error_deg), (0.0, 0.0));
        assert_eq!(snorm16.delta_bytes * 2, float32.delta_bytes);
        assert!(snorm16.position_error > 0.0 && snorm16.position_error_rel < 1e-5, "{snorm16:?}");
        assert!(snorm16.normal_error_deg < 0.01, "{snorm16:?}");
        for (name, allowed) in [("block-float32", 0.0), ("fast", 1e-5), ("small", 1e-5), ("pair", 1e-4)] {
            let cost = cost(name);
            assert!(cost.delta_bytes > 0 && cost.position_error_rel <= allowed, "{cost:?}");
            assert!(cost.index_bytes > 0 || name == "block-float32", "{cost:?}");
        }
    }

    #[test]
    fn blocks_count_what_is_touched() {
        let mut mesh = mesh();
        let found =
            |mesh: &MorphMesh, format| blocks(&measure(mesh, format, BlockDesc::default()).expect("packed").packed);
        let small = found(&mesh, DeltaFormat::Small);
        // Vertices that move together are adjacent: 64 of one target take two blocks, three of another at most three.
        assert_eq!((small.size, small.count), (32, 6));
        assert!((3..=5).contains(&small.incidence), "{small:?}");
        assert_eq!(small.fill, 67.0 / (small.incidence * 32) as f64);
        mesh.targets.clear();
        assert_eq!(found(&mesh, DeltaFormat::Small), Blocks { size: 32, count: 6, incidence: 0, fill: 0.0 });
        assert_eq!(found(&mesh, DeltaFormat::Float32), Blocks::default());
    }

    #[test]
    fn one_normal_of_many_is_not_usual() {
        let pose =
            |normals: &[[f64; 3]]| normals.iter().flat_map(|n| [0.0, 0.0, 0.0, n[0], n[1], n[2]]).collect::<Vec<_>>();
        let truth = pose(&[[0.0, 0.0, 1.0]; 2000]);
        let mut turned = [[0.0, 0.0, 1.0]; 2000];
        turned[7] = [1.0, 0.0, 0.0];
        let mut errors = Errors::default();
        errors.add(&pose(&turned), &truth);
        assert_eq!((errors.largest.normal_degrees, errors.usual_angle()), (90.0, 0.0));
        assert_eq!(Errors::default().usual_angle(), 0.0);
    }

    #[test]
    fn frames_are_spread_over_the_clip() {
        assert_eq!(spread(3), [0, 1, 2]);
        assert!(spread(0).is_empty());
        let many = spread(3295);
        assert!(many.len() == 32 && many[0] == 101 && many[31] == 3294, "{many:?}");
    }
}
