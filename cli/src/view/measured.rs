//! Measurements of updates and frames: for the plot, the panel, and `stats`.

use super::frame::Sample;
use crate::bench::stats::Stats;
use serde::Serialize;
use std::collections::VecDeque;

/// Frames that are kept.
const KEPT: usize = 1024;

/// A frame that was drawn.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    pub sample: Sample,
    /// Milliseconds since the frame before.
    pub wall_ms: f64,
}

/// Recent frames, all updated in the same way.
#[derive(Default)]
pub struct Measured {
    pub rows: VecDeque<Row>,
    /// Frames since the measurements were cleared.
    pub frames: u64,
    /// A full evaluation: bytes, and milliseconds on the device.
    pub full: Option<(u64, Option<f64>)>,
}

/// Contents of a `stats` file. Fields may be added, never renamed.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    pub schema: u32,
    pub device: String,
    /// Path, format and poses, worded as in `render` and `play`.
    pub setup: String,
    pub width: u32,
    pub height: u32,
    /// All frames drawn, and those of the last 1,024 with changed weights, which the following fields are about.
    pub frames: u64,
    pub updates: usize,
    /// Means over updates.
    pub changed_mean: f64,
    pub bytes_moved_mean: f64,
    pub dirty_blocks_mean: f64,
    /// Medians, in milliseconds: the update on the device, and on the processor (planning and recording).
    pub update_gpu_ms: Option<f64>,
    pub update_cpu_ms: Option<f64>,
    /// Medians of the frame on the device, and of the time between frames.
    pub frame_gpu_ms: Option<f64>,
    pub frame_wall_ms: Option<f64>,
    /// The update's share of the frame on the device; on the path cpu, of the time between frames.
    pub update_share: Option<f64>,
    /// A full evaluation, on the path compute in float32.
    pub full_bytes: Option<u64>,
    pub full_gpu_ms: Option<f64>,
    /// Memory of the process; `None` if the system does not report it.
    pub resident_bytes: Option<u64>,
}

impl Measured {
    pub fn add(&mut self, sample: Sample, wall_ms: f64) {
        if self.rows.len() == KEPT {
            self.rows.pop_front();
        }
        self.rows.push_back(Row { sample, wall_ms });
        self.frames += 1;
        self.full = sample.full.or(self.full);
    }

    /// Discards the measurements, but for the full evaluation.
    pub fn clear(&mut self) {
        *self = Self { full: self.full, ..Self::default() };
    }

    /// Medians and means of the frames with changed weights. On the path `cpu` the update is on the processor.
    pub fn summary(&self, on_device: bool) -> Summary {
        let rows: Vec<&Row> = self.rows.iter().filter(|row| row.sample.stats.bytes_moved > 0).collect();
        let median = |value: &dyn Fn(&Row) -> Option<f64>| {
            Stats::of(&rows.iter().filter_map(|row| value(row)).collect::<Vec<_>>()).map(|stats| stats.median)
        };
        let mean = |value: fn(&Row) -> f64| rows.iter().map(|row| value(row)).sum::<f64>() / rows.len().max(1) as f64;
        let update_gpu_ms = median(&|row| row.sample.update_ms.filter(|_| on_device));
        let update_cpu_ms = median(&|row| Some(row.sample.cpu_ms));
        let frame_gpu_ms = median(&|row| row.sample.frame_ms);
        let frame_wall_ms = median(&|row| Some(row.wall_ms));
        let share = if on_device { update_gpu_ms.zip(frame_gpu_ms) } else { update_cpu_ms.zip(frame_wall_ms) };
        Summary {
            schema: 1,
            frames: self.frames,
            updates: rows.len(),
            changed_mean: mean(|row| row.sample.stats.coefficients as f64),
            bytes_moved_mean: mean(|row| row.sample.stats.bytes_moved as f64),
            dirty_blocks_mean: mean(|row| row.sample.stats.dirty_blocks as f64),
            update_gpu_ms,
            update_cpu_ms,
            frame_gpu_ms,
            frame_wall_ms,
            update_share: share.filter(|(_, frame)| *frame > 0.0).map(|(update, frame)| update / frame),
            full_bytes: self.full.map(|(bytes, _)| bytes),
            full_gpu_ms: self.full.and_then(|(_, ms)| ms),
            resident_bytes: resident(),
            ..Summary::default()
        }
    }
}

/// Resident memory, as reported by Linux.
fn resident() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib << 10)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::UpdateStats;

    #[test]
    fn still_frames_are_no_updates_and_memory_is_bounded() {
        let mut measured = Measured::default();
        for i in 0..5000u64 {
            let mut stats = UpdateStats::default();
            stats.bytes_moved = (i % 2) * 1000;
            let full = (i == 10).then_some((9000, Some(4.0)));
            let sample = Sample { stats, cpu_ms: 0.5, update_ms: Some(1.0), frame_ms: Some(50.0), full };
            measured.add(sample, 60.0);
        }
        assert_eq!((measured.rows.len(), measured.frames), (KEPT, 5000));
        let summary = measured.summary(true);
        assert_eq!((summary.updates, summary.bytes_moved_mean, summary.update_share), (KEPT / 2, 1000.0, Some(0.02)));
        assert_eq!((summary.full_bytes, summary.full_gpu_ms), (Some(9000), Some(4.0)));
        assert_eq!(measured.summary(false).update_share, Some(0.5 / 60.0));
        measured.clear();
        assert_eq!((measured.frames, measured.full), (0, Some((9000, Some(4.0)))));
    }
}
