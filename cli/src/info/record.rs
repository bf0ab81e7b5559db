//! The JSON of `info`. Fields may be added, never renamed.

use crate::input::MeshInfo;
use crate::verify::scale;
use deltamorph::{DeltaFormat, PackedLayout, PoseError};
use serde::Serialize;

#[derive(Debug, Serialize)]
pub struct Info {
    pub schema: u32,
    pub input: MeshInfo,
    /// The targets, in the order of the input.
    pub targets: Vec<TargetRow>,
    pub overlap: Overlap,
    /// How tightly they fill the blocks of the format `small`.
    pub blocks: Blocks,
    /// What each delta format costs.
    pub formats: Vec<FormatRow>,
    /// The weight clips that lie beside the mesh.
    pub clips: Vec<ClipRow>,
    /// With `--report`: bytes against error, of `small` over a range of errors allowed and of the other formats.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sweep: Option<Vec<SweepRow>>,
    /// With `--report`: errors of whole poses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses: Option<Vec<PoseRow>>,
}

#[derive(Debug, Serialize)]
pub struct TargetRow {
    pub name: String,
    /// Fraction of the vertices with a delta that was kept.
    pub moved: f64,
    /// Fraction of the vertices with a delta, of position or normal, that is not exactly zero.
    pub moved_raw: f64,
    /// Fraction of the vertices whose position in the file differs at all.
    pub moved_raw_positions: f64,
    /// Length of the longest position delta, in input units.
    pub max_delta: f32,
    /// Length of the longest normal delta.
    pub max_normal_delta: f32,
}

#[derive(Debug, Serialize)]
pub struct Overlap {
    /// Fraction of the vertices that some target moves.
    pub union: f64,
    /// Targets that move such a vertex, on average.
    pub mean: f64,
    /// And at most.
    pub max: u32,
}

/// The blocks of the format `small`, in the order in which packing lays the vertices out.
#[derive(Debug, Default, PartialEq, Serialize)]
pub struct Blocks {
    pub size: usize,
    pub count: usize,
    /// Pairs of a block and a target that moves some of its vertices.
    pub incidence: usize,
    /// Deltas per vertex of these pairs: 1 when a target moves all of each block that it touches.
    pub fill: f64,
}

#[derive(Debug, Serialize)]
pub struct FormatRow {
    pub name: &'static str,
    #[serde(flatten)]
    pub cost: Cost,
}

/// Bytes and errors of a packed mesh, in the JSON of `info` and `pack`.
#[derive(Debug, Serialize)]
pub struct Cost {
    /// Bytes of the deltas.
    pub delta_bytes: u64,
    /// Bytes that say which vertices they belong to (dense formats have none).
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

#[derive(Debug, Serialize)]
pub struct ClipRow {
    pub name: String,
    pub frames: usize,
    pub fps: f32,
    pub columns: usize,
    /// Targets whose weight differs from the frame before, on average.
    pub changed_mean: f64,
    /// And at most.
    pub changed_max: usize,
    /// Targets with a weight other than 0, on average.
    pub active_mean: f64,
    /// Fraction of the frames that change nothing.
    pub still: f64,
}

/// A way to pack, and what it costs.
#[derive(Clone, Debug, Serialize)]
pub struct SweepRow {
    pub format: &'static str,
    /// Vertices per block; `None` for dense formats.
    pub block_size: Option<usize>,
    /// Position error allowed, as a fraction of the diagonal; `None` where it is not chosen.
    pub position_allowed_rel: Option<f32>,
    /// Normal error allowed, in degrees.
    pub normal_allowed_deg: Option<f32>,
    /// Bytes of deltas and of what says where they belong.
    pub bytes: u64,
    /// The same as a share of all vertices' deltas as six floats.
    pub share: f64,
    /// Largest error of a position delta, as a fraction of the diagonal.
    pub position_error_rel: f64,
    /// Largest error of a normal at weight 1, in degrees.
    pub normal_error_deg: f64,
}

/// The largest errors of whole poses of a clip against the raw files: dropped deltas and packing together.
#[derive(Clone, Debug, Serialize)]
pub struct PoseRow {
    pub clip: String,
    /// Frames that were looked at.
    pub frames: usize,
    pub format: &'static str,
    /// Largest position error, as a fraction of the diagonal.
    pub position_error_rel: f64,
    /// Largest angle between normals, in degrees: where targets fold a normal to almost nothing, a small error turns it
    /// far.
    pub normal_error_deg: f64,
    /// The angle that 999 of 1000 normals do not exceed, in degrees.
    pub normal_error_p999_deg: f64,
}
