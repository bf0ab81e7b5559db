//! One configuration: verified, then timed in one stretch or in several, then verified again.

use super::cache::Cache;
use super::record::Bandwidth;
use super::run::{Round, RunRecord};
use super::setting::{Config, Setting};
use super::stats::Stats;
use crate::args::bench::BenchArgs;
use crate::input::Input;
use crate::runner::{Frame, Runner};
use crate::verify::{Found, Promise};
use deltamorph::reference::compare;
use deltamorph::{PackedMesh, Result, UpdateStats};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Draws that are timed for `draw_ms` where the frames themselves have none.
const DRAWS: usize = 9;

/// Frames before the first comparison of a brief setting: each of two slots has been source and destination.
const BRIEF_CHECK: usize = 2;

/// What all configurations of a mesh share.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    pub args: &'a BenchArgs,
    pub input: &'a Input,
    pub bandwidth: Bandwidth,
}

/// A configuration under measurement.
pub struct Trial<'a> {
    context: Context<'a>,
    setting: &'a Setting<'a>,
    mesh: Arc<PackedMesh>,
    runner: Runner<'a>,
    promise: Promise,
    found: Found,
    record: RunRecord,
    /// Bytes are those of the draws, which evaluate.
    in_draws: bool,
    /// The last frame that ran.
    frame: usize,
    /// What the timed frames took, and their weights that changed or are not 0.
    timed: Vec<Frame>,
    changed: usize,
    active: usize,
    /// What the timed rounds took, all in all.
    spent: Duration,
    /// What a timed frame takes at least, waiting included.
    least: Duration,
}

impl<'a> Trial<'a> {
    /// Run to the checkpoints, and compare with the reference there.
    pub fn begin(
        context: Context<'a>,
        runner: Runner<'a>,
        setting: &'a Setting<'a>,
        config: &Config,
        mesh: &Arc<PackedMesh>,
        cache: &mut Cache,
    ) -> Result<Self> {
        let mut trial = Self {
            context,
            setting,
            mesh: mesh.clone(),
            runner,
            promise: Promise::new(&config.desc, mesh.layout()),
            found: Found::default(),
            record: blank(config, setting, context.input),
            in_draws: config.desc.path.evaluates_in_draws(),
            frame: 0,
            timed: vec![],
            changed: 0,
            active: 0,
            spent: Duration::ZERO,
            least: Duration::ZERO,
        };
        trial.step(0, 0)?;
        for &checkpoint in if setting.brief { &[BRIEF_CHECK] } else { &setting.workload.checkpoints[..] } {
            for frame in trial.frame + 1..=checkpoint {
                trial.step(frame, 0)?;
            }
            trial.verify(cache)?;
        }
        trial.frame %= setting.workload.period();
        Ok(trial)
    }

    /// Whether the result was right so far: what is wrong is not worth timing.
    pub fn is_right(&self) -> bool {
        self.promise.kept(&self.found)
    }

    /// Timed frames, and what they took.
    pub fn timed(&self) -> (usize, Duration) {
        (self.timed.len(), self.spent)
    }

    /// Run frames as they will be timed, up to `limit` (but one at least); returns what the last of them took.
    pub fn warm_up(&mut self, limit: Option<Duration>) -> Result<Duration> {
        let (begun, mut last) = (Instant::now(), Duration::ZERO);
        for i in 0..self.context.args.warmup {
            if i > 0 && limit.is_some_and(|limit| begun.elapsed() >= limit) {
                break;
            }
            let start = Instant::now();
            self.step(self.frame + 1, self.draws())?;
            last = start.elapsed();
        }
        Ok(last)
    }

    /// From now on, wait after a timed frame until it took `least`.
    pub fn take_at_least(&mut self, least: Duration) {
        self.least = least;
    }

    /// Go on from this part of the workload: the frames to there are not timed, and enough of them that no slot is from
    /// before.
    pub fn jump(&mut self, part: usize, parts: usize) -> Result<()> {
        let frame = self.setting.workload.period() * part / parts;
        (0..self.record.slots as usize).try_for_each(|i| self.step(frame + i, 0).map(drop))
    }

    /// Time `frames` more, up to `limit` (but one at least).
    pub fn round(&mut self, frames: usize, limit: Option<Duration>) -> Result<()> {
        let (begun, first) = (Instant::now(), self.timed.len());
        let mut before = self.setting.weights(self.frame);
        for i in 0..frames {
            if i > 0 && limit.is_some_and(|limit| begun.elapsed() >= limit) {
                break;
            }
            let start = Instant::now();
            let (now, frame) = self.step(self.frame + 1, self.draws())?;
            std::thread::sleep(self.least.saturating_sub(start.elapsed()));
            self.timed.push(frame);
            for (a, b) in before.iter().flatten().zip(now.iter().flatten()) {
                self.changed += usize::from(a != b);
                self.active += usize::from(*b != 0.0);
            }
            before = now;
        }
        self.spent += begun.elapsed();
        let update = |frame: &Frame| frame.gpu_ms.or(Some(frame.cpu_ms));
        let judged = times(&self.timed[first..], |frame| both(frame).or(update(frame)));
        let rounds = judged.zip(times(&self.timed[first..], update));
        self.record.rounds.extend(rounds.map(|(a, b)| Round { ms: a.median, update_ms: b.median }));
        Ok(())
    }

    fn draws(&self) -> u32 {
        if self.setting.drawn { self.setting.copies() } else { 0 }
    }

    /// Run a frame; returns the weights that it ran with, too.
    fn step(&mut self, frame: usize, copies: u32) -> Result<(Vec<Vec<f32>>, Frame)> {
        let weights = self.setting.weights(frame);
        let step = self.runner.step(&weights, copies)?;
        self.frame = frame;
        self.found.bound = self.found.bound.max(f64::from(step.stats.bound));
        Ok((weights, step))
    }

    /// Compare the first and the last head with the reference.
    fn verify(&mut self, cache: &mut Cache) -> Result<()> {
        let last = self.setting.updated() - 1;
        for head in if last == 0 { vec![0] } else { vec![0, last] } {
            let pose = self.runner.pose(head)?;
            let weights = self.promise.applied(&self.setting.workload.weights(head, self.frame));
            let reference = cache.reference(&self.mesh, self.context.input, &weights);
            self.found.error = self.found.error.max(compare(&pose, &reference.packed));
            self.found.raw = self.found.raw.max(compare(&pose, &reference.raw));
        }
        Ok(())
    }

    /// Verify once more, and sum up.
    pub fn finish(mut self, cache: &mut Cache) -> Result<RunRecord> {
        if !self.timed.is_empty() {
            self.verify(cache)?;
            // What is wrong has no times worth telling.
            if self.is_right() {
                self.sum_up()?;
            }
        }
        let (found, diagonal) = (&self.found, self.promise.scale);
        let mut record = self.record;
        record.max_error = Some(found.error.position);
        record.max_error_rel = Some(found.error.position / diagonal);
        record.normal_error_deg = Some(found.error.normal_degrees);
        // A packed file does not say what it was packed from.
        record.raw_error_rel = self.context.input.packed.is_none().then_some(found.raw.position / diagonal);
        record.verified = self.promise.kept(found);
        if !record.verified {
            record.rounds.clear();
            record.problem = Some(self.promise.complaint(found));
        }
        Ok(record)
    }

    fn sum_up(&mut self) -> Result<()> {
        let (record, timed) = (&mut self.record, &self.timed);
        let mut sum = UpdateStats::default();
        timed.iter().for_each(|frame| sum += frame.stats);
        let mean = |total: f64| total / timed.len() as f64;
        let per_head = |total: usize| mean(total as f64 / f64::from(self.setting.updated()));
        record.changed = per_head(self.changed);
        record.active = per_head(self.active);
        record.coefficients = per_head(sum.coefficients);
        record.passes = per_head(sum.passes);
        record.bytes_moved = mean(sum.bytes_moved as f64);
        record.bytes_floor = mean(sum.bytes_floor as f64);
        record.dirty_blocks = per_head(sum.dirty_blocks);
        record.rebuilt_blocks = per_head(sum.rebuilt_blocks);
        record.gpu_ms = times(timed, |frame| frame.gpu_ms);
        record.cpu_ms = times(timed, |frame| Some(frame.cpu_ms));
        record.update_and_draw_ms = times(timed, both);
        record.upload_ms = times(timed, |frame| frame.upload_ms);
        record.draw_ms = match self.setting.drawn {
            true => times(timed, |frame| frame.draw_ms),
            false => {
                let draws = (0..DRAWS).map(|_| self.runner.draw_ms(self.setting.copies()));
                Stats::of(&draws.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect::<Vec<_>>())
            }
        }
        .map(|s| s.median);
        if record.rounds.len() == 1 {
            record.rounds.clear();
        }
        let b = self.context.bandwidth;
        let rates = match record.gpu_ms {
            None => [b.cpu_read_gb_s, b.cpu_copy_gb_s],
            Some(_) => [b.device_read_gb_s, b.device_copy_gb_s],
        };
        let best = rates.into_iter().flatten().reduce(f64::max);
        // Means: in a clip the frames differ, and the bytes are their mean.
        let seconds = record.gpu_ms.or(record.cpu_ms).map(|t| t.mean * 1e-3).filter(|t| *t > 0.0);
        let update = best.zip(seconds).filter(|_| !self.in_draws);
        record.floor_fraction = update.map(|(gb_s, s)| record.bytes_floor / (gb_s * 1e9) / s);
        Ok(())
    }
}

/// Update and draws, on the device.
fn both(frame: &Frame) -> Option<f64> {
    frame.gpu_ms.zip(frame.draw_ms).map(|(update, draw)| update + draw)
}

/// What `of` says of those frames of which it says something.
fn times(frames: &[Frame], of: impl Fn(&Frame) -> Option<f64>) -> Option<Stats> {
    Stats::of(&frames.iter().filter_map(of).collect::<Vec<_>>())
}

/// The record of a configuration that was not measured yet.
fn blank(config: &Config, setting: &Setting<'_>, input: &Input) -> RunRecord {
    let Config { desc, format, batch_max, separate } = config;
    RunRecord {
        mesh: input.name.clone(),
        targets: input.kept.targets.len(),
        path: desc.path.name().into(),
        mode: desc.mode.name().into(),
        batch_size: desc.batch,
        batch_max: *batch_max,
        workload: setting.workload.name.clone(),
        changed: setting.workload.changed.unwrap_or(0) as f64,
        heads: setting.heads,
        shared: setting.shared,
        crowds: if *separate { setting.updated() } else { 1 },
        accumulate: desc.accumulate.name().into(),
        error_budget: desc.error_budget,
        format: format.name().into(),
        slots: desc.slots,
        ..RunRecord::default()
    }
}
