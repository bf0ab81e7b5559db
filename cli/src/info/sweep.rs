//! Error against bytes, and the errors of whole poses: what `--report` measures.

use super::formats::{Cost, Measured, measure};
use crate::input::Input;
use crate::output::{Failure, Output};
use crate::verify::scale;
use deltamorph::reference::{SHORTEST_NORMAL, angle_degrees, compare, evaluate, evaluate_unpacked};
use deltamorph::{BLOCK_SIZES, BlockDesc, BoundClip, DeltaFormat, MorphMesh, POSE_FLOATS, PoseError};
use glam::DVec3;
use serde::Serialize;

/// A way to pack, and what it costs.
#[derive(Debug, Serialize)]
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
    #[serde(flatten)]
    pub cost: Cost,
}

/// The largest errors of whole poses of a clip against the raw files: dropped deltas and packing together.
#[derive(Debug, Serialize)]
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

/// Steps of √10 from 1e-3 to 1e-6 of the diagonal.
const STEPS: i32 = 7;
/// Frames of a clip that are looked at.
const FRAMES: usize = 32;

/// The format `small` over the errors allowed and the block sizes, then every format as it is by default.
pub fn sweep(mesh: &MorphMesh, formats: &[Measured], out: &Output) -> Result<Vec<SweepRow>, Failure> {
    let bar = out.bar(STEPS as u64 * BLOCK_SIZES.len() as u64);
    let default = BlockDesc::default();
    let mut rows = vec![];
    for size in BLOCK_SIZES {
        for step in 0..STEPS {
            let position_error = 10f32.powf(-3.0 - 0.5 * step as f32);
            // In the proportion of the defaults.
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

/// The largest error of poses of each clip in each format, against the raw files.
pub fn poses(input: &Input, formats: &[Measured], clips: &[BoundClip], out: &Output) -> Vec<PoseRow> {
    let bar = out.bar(clips.iter().map(|c| c.frame_count().min(FRAMES) as u64).sum());
    let mut rows = vec![];
    for clip in clips {
        let frames = spread(clip.frame_count());
        let mut errors = vec![Errors::default(); formats.len()];
        bar.set_message(format!("poses of {}", clip.name));
        for &frame in &frames {
            let weights = &clip.frame(frame);
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
    /// Of every normal that has a direction.
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

    /// The angle that 999 of 1000 do not exceed.
    fn usual_angle(mut self) -> f32 {
        let at = self.angles.len() * 999 / 1000;
        if at == self.angles.len() { 0.0 } else { *self.angles.select_nth_unstable_by(at, f32::total_cmp).1 }
    }
}

/// Up to [`FRAMES`] of `count` frames, the last one among them.
fn spread(count: usize) -> Vec<usize> {
    let n = count.min(FRAMES);
    (1..=n).map(|i| count * i / n - 1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
