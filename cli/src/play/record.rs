//! The JSON of `play`. Fields may be added, never renamed.

use crate::stage::Setup;
use crate::verify::Checked;
use serde::Serialize;

/// What a clip took.
#[derive(Debug, Serialize)]
pub struct Played {
    pub schema: u32,
    /// The Vulkan device's name, or "none".
    pub device: String,
    /// Where the mesh came from: a folder, or "built-in head".
    pub input: String,
    pub clip: String,
    pub frames: Vec<FrameRow>,
    pub summary: Summary,
}

/// What a frame took.
#[derive(Debug, Serialize)]
pub struct FrameRow {
    /// Its number, from 0.
    pub frame: usize,
    /// Targets whose weight differs from the frame before; in the first one, from 0.
    pub changed: usize,
    /// Targets with a weight other than 0.
    pub active: usize,
    /// Blocks written (block formats); this and the next three are `None` where the device plans.
    pub dirty_blocks: Option<usize>,
    /// Of these, the ones that started from the base pose.
    pub rebuilt_blocks: Option<usize>,
    pub passes: Option<usize>,
    /// Bytes loaded and stored.
    pub bytes_moved: Option<u64>,
    /// Time on the device; `None` without one.
    pub gpu_ms: Option<f64>,
    /// Round trip from weights to result, in microseconds.
    pub cpu_us: f64,
    /// Largest position error against the float64 reference, in input units; `None` where it was not measured.
    pub max_error: Option<f64>,
}

#[derive(Debug, Serialize)]
pub struct Summary {
    pub frames: usize,
    #[serde(flatten)]
    pub setup: Setup,
    /// Animated and planned on the device.
    pub animated: bool,
    /// Amplitude of the noise that was added to the weights.
    pub noise: f32,
    /// Targets changed, per frame.
    pub changed_mean: f64,
    /// Bytes loaded and stored, per frame.
    pub bytes_moved_mean: Option<f64>,
    /// What incremental updates of whole float32 poses would move: per frame with a change, each vertex's pose in and
    /// out, and its delta for each changed target.
    pub dense_bytes_mean: f64,
    /// `bytes_moved_mean` as a share of `dense_bytes_mean`; `None` where nothing moved.
    pub bytes_share: Option<f64>,
    /// Median of the time on the device.
    pub gpu_ms_median: Option<f64>,
    pub gpu_ms_mean: Option<f64>,
    /// Median of the round trips, in microseconds.
    pub cpu_us_median: Option<f64>,
    #[serde(flatten)]
    pub checked: Checked,
    /// Largest angle between normals, in degrees.
    pub normal_error_deg: f64,
    /// Against the weights as asked for, as a fraction of the diagonal.
    pub request_error_rel: f64,
    /// Against the raw files: dropped deltas, packing, sums and what waits, as a fraction of the diagonal. `None` where
    /// INPUT is a packed file, which does not say what it was packed from.
    pub raw_error_rel: Option<f64>,
}
