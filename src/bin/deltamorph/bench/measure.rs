//! One configuration: verified, then timed, then verified again.

use super::record::{Bandwidth, RunRecord};
use super::stats::Stats;
use super::workload::Workload;
use crate::args::BenchArgs;
use crate::input::Input;
use crate::output::Failure;
use crate::runner::Runner;
use crate::verify::{Found, Promise};
use deltamorph::mesh::packed::{DeltaFormat, POSE_STRIDE, PackedMesh};
use deltamorph::plan::{UpdateDesc, UpdateStats};
use deltamorph::reference::{compare, evaluate, evaluate_unpacked};
use std::collections::HashMap;
use std::sync::Arc;

/// Draws that are timed for `draw_ms`.
const DRAWS: usize = 9;

/// Everything but the update path.
pub struct Setting<'a> {
    /// The weights.
    pub workload: &'a dyn Workload,
    /// Targets changed per frame and head, as asked for; `None` for clips.
    pub changed: Option<usize>,
    /// Heads, each with weights of its own.
    pub heads: u32,
}

/// How to update, and in which format.
pub struct Config {
    /// Path, batch size, mode, slots.
    pub desc: UpdateDesc,
    /// Storage of deltas.
    pub format: DeltaFormat,
    /// The largest batch that path and format allow.
    pub batch_max: Option<u32>,
}

/// The float64 references of a workload's checkpoints: on the packed deltas, and on the raw files.
#[derive(Default)]
pub struct References {
    /// By format and the bits of the weights.
    known: HashMap<(DeltaFormat, Vec<u32>), Arc<Reference>>,
}

struct Reference {
    packed: Vec<f64>,
    raw: Vec<f64>,
}

/// Enough for one workload at its checkpoints in every format; more would only take memory.
const REFERENCES_MAX: usize = 64;

impl References {
    fn get(&mut self, mesh: &PackedMesh, input: &Input, weights: &[f32]) -> Arc<Reference> {
        let key = (mesh.layout().format, weights.iter().map(|w| w.to_bits()).collect());
        if self.known.len() >= REFERENCES_MAX && !self.known.contains_key(&key) {
            self.known.clear();
        }
        let make = || {
            let (packed, raw) = (evaluate(mesh, weights), evaluate_unpacked(&input.raw, weights));
            Arc::new(Reference { packed, raw })
        };
        self.known.entry(key).or_insert_with(make).clone()
    }
}

/// What all configurations share.
pub struct Context<'a> {
    /// The command line.
    pub args: &'a BenchArgs,
    /// The mesh.
    pub input: &'a Input,
    /// The ceilings.
    pub bandwidth: Bandwidth,
}

impl Context<'_> {
    /// Verify, time, verify what `runner` makes of `config`.
    ///
    /// # Errors
    /// A device that fails. A wrong result is no error: the record says so.
    pub fn measure(
        &self,
        mut runner: Runner<'_>,
        setting: &Setting<'_>,
        config: &Config,
        mesh: &Arc<PackedMesh>,
        references: &mut References,
    ) -> Result<RunRecord, Failure> {
        let weights = |frame: usize| -> Vec<Vec<f32>> {
            (0..setting.heads).map(|h| setting.workload.weights(h, frame)).collect()
        };
        let promise = Promise::new(&config.desc, mesh.layout());
        let mut found = Found::default();
        let checkpoints = setting.workload.checkpoints();
        let mut frame = 0;
        for &checkpoint in &checkpoints {
            while frame <= checkpoint {
                let bound = runner.step(&weights(frame))?.stats.bound;
                found.bound = found.bound.max(f64::from(bound));
                frame += 1;
            }
            self.verify(&mut runner, mesh, &promise, &weights(checkpoint), references, &mut found)?;
        }

        let mut record = self.blank(setting, config);
        if promise.kept(&found) {
            frame %= setting.workload.period();
            for _ in 0..self.args.warmup {
                runner.step(&weights(frame))?;
                frame += 1;
            }
            found.bound = found.bound.max(self.time(&mut runner, setting, frame, &weights, &mut record)?);
            let last = frame + self.args.frames - 1;
            self.verify(&mut runner, mesh, &promise, &weights(last), references, &mut found)?;
            let mut draws = vec![];
            for _ in 0..DRAWS {
                draws.extend(runner.draw_ms()?);
            }
            record.draw_ms = Stats::of(&draws).map(|s| s.median);
        }
        let diagonal = promise.scale();
        record.max_error = Some(found.error.position);
        record.max_error_rel = Some(found.error.position / diagonal);
        record.normal_error_deg = Some(found.error.normal_degrees);
        // A packed file does not say what it was packed from.
        record.raw_error_rel = self.input.packed.is_none().then_some(found.raw.position / diagonal);
        record.verified = promise.kept(&found);
        if !record.verified {
            (record.gpu_ms, record.cpu_ms, record.floor_fraction) = (None, None, None);
            record.problem = Some(promise.complaint(&found));
        }
        Ok(record)
    }

    /// Compare the first and the last head with the reference.
    fn verify(
        &self,
        runner: &mut Runner<'_>,
        mesh: &PackedMesh,
        promise: &Promise,
        weights: &[Vec<f32>],
        references: &mut References,
        found: &mut Found,
    ) -> Result<(), Failure> {
        let last = weights.len() - 1;
        for head in if last == 0 { vec![0] } else { vec![0, last] } {
            let pose = runner.pose(head as u32)?;
            let reference = references.get(mesh, self.input, &promise.applied(&weights[head]));
            found.error = found.error.max(compare(&pose, &reference.packed));
            found.raw = found.raw.max(compare(&pose, &reference.raw));
        }
        Ok(())
    }

    fn time(
        &self,
        runner: &mut Runner<'_>,
        setting: &Setting<'_>,
        start: usize,
        weights: &dyn Fn(usize) -> Vec<Vec<f32>>,
        record: &mut RunRecord,
    ) -> Result<f64, Failure> {
        let frames = self.args.frames;
        let mut bound = 0.0f64;
        let (mut gpu, mut cpu, mut sum) = (vec![], vec![], UpdateStats::default());
        let (mut changed, mut active) = (0, 0);
        let mut before = weights((start + setting.workload.period() - 1) % setting.workload.period());
        for frame in start..start + frames {
            let now = weights(frame);
            let step = runner.step(&now)?;
            gpu.extend(step.gpu_ms);
            cpu.push(step.cpu_ms);
            sum.coefficients += step.stats.coefficients;
            sum.passes += step.stats.passes;
            sum.bytes_moved += step.stats.bytes_moved;
            sum.bytes_floor += step.stats.bytes_floor;
            sum.dirty_blocks += step.stats.dirty_blocks;
            sum.rebuilt_blocks += step.stats.rebuilt_blocks;
            bound = bound.max(f64::from(step.stats.bound));
            for (a, b) in before.iter().flatten().zip(now.iter().flatten()) {
                changed += usize::from(a != b);
                active += usize::from(*b != 0.0);
            }
            before = now;
        }
        let mean = |total: f64| total / frames as f64;
        let per_head = |total: usize| mean(total as f64 / f64::from(setting.heads));
        record.changed = per_head(changed);
        record.active = per_head(active);
        record.coefficients = per_head(sum.coefficients);
        record.passes = per_head(sum.passes);
        record.bytes_moved = mean(sum.bytes_moved as f64);
        record.bytes_floor = mean(sum.bytes_floor as f64);
        record.gpu_ms = Stats::of(&gpu);
        record.cpu_ms = Stats::of(&cpu);
        let b = self.bandwidth;
        let ceiling = match record.path.as_str() {
            "cpu" => b.cpu_read_gb_s,
            _ => b.device_read_gb_s.into_iter().chain(b.device_copy_gb_s).reduce(f64::max),
        };
        // Means: in a clip the frames differ, and the bytes are their mean.
        let seconds = record.time().map(|t| t.mean * 1e-3).filter(|t| *t > 0.0);
        let pose = (self.input.kept.vertex_count() * POSE_STRIDE) as f64;
        let written = pose * f64::from(setting.heads) * if record.passes > 0.0 { 1.0 } else { 0.0 };
        let to_read = (record.bytes_floor - written).max(0.0);
        record.floor_fraction = ceiling.zip(seconds).map(|(gb_s, s)| to_read / (gb_s * 1e9) / s);
        record.dirty_blocks = per_head(sum.dirty_blocks);
        record.rebuilt_blocks = per_head(sum.rebuilt_blocks);
        Ok(bound)
    }

    fn blank(&self, setting: &Setting<'_>, config: &Config) -> RunRecord {
        RunRecord {
            path: config.desc.path.name().into(),
            mode: config.desc.mode.name().into(),
            batch_size: config.desc.batch,
            batch_max: config.batch_max,
            workload: setting.workload.name().into(),
            changed: setting.changed.unwrap_or(0) as f64,
            coefficients: 0.0,
            active: 0.0,
            heads: setting.heads,
            shared: false,
            accumulate: config.desc.accumulate.name().into(),
            error_budget: config.desc.error_budget,
            dirty_blocks: 0.0,
            rebuilt_blocks: 0.0,
            format: config.format.name().into(),
            slots: config.desc.slots,
            passes: 0.0,
            bytes_moved: 0.0,
            bytes_floor: 0.0,
            gpu_ms: None,
            cpu_ms: None,
            draw_ms: None,
            floor_fraction: None,
            max_error: None,
            max_error_rel: None,
            normal_error_deg: None,
            raw_error_rel: None,
            verified: false,
            problem: None,
        }
    }
}
