//! What is measured: how to update, and on what.

use super::workload::Workload;
use deltamorph::{DeltaFormat, UpdateDesc};

/// Everything but the update path.
#[derive(Clone, Copy)]
pub struct Setting<'a> {
    pub workload: &'a Workload,
    /// Heads: each with weights of its own, unless `shared`.
    pub heads: u32,
    /// One animation: one head is updated, and its pose drawn for each.
    pub shared: bool,
    /// Every frame draws each head once, without rasterizing, after the update.
    pub drawn: bool,
    /// Compare with the reference after a few frames, not at all checkpoints of the workload: where frames take long.
    pub brief: bool,
}

impl<'a> Setting<'a> {
    /// What suites measure: heads each with weights of their own, drawn, checked after a few frames.
    pub fn of_suite(workload: &'a Workload, heads: u32) -> Self {
        Self { workload, heads, shared: false, drawn: true, brief: true }
    }

    /// Heads that are updated.
    pub fn updated(&self) -> u32 {
        if self.shared { 1 } else { self.heads }
    }

    /// Draws of each head that is updated.
    pub fn copies(&self) -> u32 {
        if self.shared { self.heads } else { 1 }
    }

    /// The weights of each of them.
    pub fn weights(&self, frame: usize) -> Vec<Vec<f32>> {
        (0..self.updated()).map(|h| self.workload.weights(h, frame)).collect()
    }
}

/// How to update, and in which format.
#[derive(Clone, Debug)]
pub struct Config {
    /// Path, batch size, mode, slots.
    pub desc: UpdateDesc,
    /// Storage of deltas.
    pub format: DeltaFormat,
    /// The largest batch that path and format allow.
    pub batch_max: Option<u32>,
    /// A crowd for each head, all of them in one submission.
    pub separate: bool,
}
