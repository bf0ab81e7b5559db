//! One configuration: verified, timed in one or several rounds, then verified again.

use super::configs::Config;
use super::machine::Machine;
use super::record::RunRecord;
use super::stats::Stats;
use super::subject::Subject;
use super::workload::Setting;
use crate::runner::{Frame, Runner, accumulate};
use crate::verify::{Found, Promise};
use deltamorph::{PackedMesh, Result, UpdateDesc, UpdateStats};
use deltamorph_headless::Draws;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Draws that are timed for `draw_ms` if frames have none.
const DRAWS: usize = 9;
/// Frames before the first comparison of a brief setting: each of two slots has been source and destination.
const BRIEF_CHECK: usize = 2;

/// A configuration under measurement.
pub struct Trial<'a> {
    machine: &'a Machine<'a>,
    config: &'a Config,
    setting: &'a Setting<'a>,
    /// The meshes, each with what its path promises.
    parts: Vec<(Arc<PackedMesh>, Promise)>,
    runner: Runner<'a>,
    /// That of the first mesh: those of a scene are of one size.
    promise: Promise,
    found: Found,
    additions: usize,
    record: RunRecord,
    /// The last frame that ran.
    frame: usize,
    timed: Vec<Timed>,
    /// Total duration of the timed rounds.
    spent: Duration,
}

/// Number and measurements of a timed frame.
type Timed = (usize, Frame);

/// The record of a configuration before its measurement.
fn record(config: &Config, setting: &Setting<'_>, subject: &Subject) -> RunRecord {
    let (mesh, desc, workload) = (subject.info(), &config.desc, setting.first());
    RunRecord {
        technique: config.technique(),
        mesh: mesh.name,
        targets: mesh.targets,
        path: desc.path.name(),
        mode: desc.mode.name(),
        batch_size: desc.batch,
        batch_max: config.batch_max,
        workload: workload.name.clone(),
        changed: workload.changed.unwrap_or(0) as f64,
        heads: setting.heads,
        shared: setting.shared,
        draws: setting.passes,
        accumulate: accumulate(desc),
        pose: desc.pose.name(),
        error_budget: desc.error_budget,
        format: config.format.name(),
        slots: desc.slots,
        ..RunRecord::default()
    }
}

impl<'a> Trial<'a> {
    /// Runs to the checkpoints, and compares with the reference there. `parts`: what the runner was made with.
    pub fn begin(
        machine: &'a Machine<'a>,
        (config, setting): (&'a Config, &'a Setting<'a>),
        subject: &mut Subject,
        parts: Vec<(Arc<PackedMesh>, UpdateDesc)>,
        runner: Runner<'a>,
    ) -> Result<Self> {
        let promise = |(mesh, desc): (Arc<PackedMesh>, _)| {
            let promise = Promise::new(&desc, mesh.layout());
            (mesh, promise)
        };
        let parts: Vec<_> = parts.into_iter().map(promise).collect();
        let mut trial = Self {
            machine,
            config,
            setting,
            promise: parts[0].1,
            parts,
            runner,
            found: Found::default(),
            additions: 0,
            record: record(config, setting, subject),
            frame: 0,
            timed: vec![],
            spent: Duration::ZERO,
        };
        trial.step(0, Draws::default())?;
        for &checkpoint in if setting.brief { &[BRIEF_CHECK] } else { &setting.first().checkpoints[..] } {
            for frame in trial.frame + 1..=checkpoint {
                trial.step(frame, Draws::default())?;
            }
            trial.verify(subject)?;
        }
        trial.frame %= setting.first().period();
        Ok(trial)
    }

    /// Whether all results were right so far: wrong ones are not timed.
    pub fn is_right(&self) -> bool {
        self.promise.kept(&self.found)
    }

    /// Its runner, if that has the mesh of `config` as its path needs it.
    pub fn runner_for(&self, config: &Config) -> Option<&Runner<'a>> {
        let same = (self.config.desc.path, self.config.format) == (config.desc.path, config.format);
        (same && self.parts.len() == 1).then_some(&self.runner)
    }

    /// Number of timed frames, and their total duration.
    pub fn timed(&self) -> (usize, Duration) {
        (self.timed.len(), self.spent)
    }

    /// Runs untimed frames like timed ones; returns the duration of the last.
    pub fn warm_up(&mut self, limit: Duration) -> Result<Duration> {
        Ok(self.run(self.machine.args.warmup, Some(limit))?.1)
    }

    /// Continues at this part of the workload. As many frames as there are slots to replace are not timed.
    pub fn jump(&mut self, part: usize, parts: usize) -> Result<()> {
        let frame = self.setting.first().period() * part / parts;
        (0..self.record.slots as usize).try_for_each(|i| self.step(frame + i, Draws::default()).map(drop))
    }

    /// Times `frames` more.
    pub fn round(&mut self, frames: usize, limit: Option<Duration>) -> Result<()> {
        let begun = Instant::now();
        let (timed, _) = self.run(frames, limit)?;
        self.spent += begun.elapsed();
        let time = |frame: &Frame| both(frame).or(frame.gpu_ms).or(Some(frame.cpu_ms));
        self.record.rounds.extend(times(&timed, time).map(|time| time.median));
        self.timed.extend(timed);
        Ok(())
    }

    /// Runs frames up to `limit`, at least one; also returns the last one's duration.
    fn run(&mut self, frames: usize, limit: Option<Duration>) -> Result<(Vec<Timed>, Duration)> {
        let draws = self.setting.draws(self.setting.passes);
        let (begun, mut done, mut last) = (Instant::now(), vec![], Duration::ZERO);
        for i in 0..frames {
            if i > 0 && limit.is_some_and(|limit| begun.elapsed() >= limit) {
                break;
            }
            let start = Instant::now();
            let frame = self.step(self.frame + 1, draws)?;
            last = start.elapsed();
            done.push((self.frame, frame));
        }
        Ok((done, last))
    }

    fn step(&mut self, frame: usize, draws: Draws) -> Result<Frame> {
        self.runner.seek(frame);
        let step = self.runner.step(&self.setting.weights(frame), draws)?;
        self.frame = frame;
        self.found.bound = self.found.bound.max(f64::from(step.stats.bound));
        self.additions = self.promise.additions(self.additions, &step.stats, self.setting.updated());
        Ok(step)
    }

    /// Compares the first and the last instance of each mesh with the reference.
    fn verify(&mut self, subject: &mut Subject) -> Result<()> {
        let (each, all) = (self.setting.each(), self.setting.weights(self.frame));
        for (part, (mesh, promise)) in self.parts.iter().enumerate() {
            let first = part as u32 * each;
            let last = first + each - 1;
            for head in if first == last { vec![first] } else { vec![first, last] } {
                let pose = self.runner.pose(head, 0)?;
                let weights = promise.applied(&all[head as usize]);
                let found = promise.find(&pose, subject.reference(part, mesh, &weights), &weights);
                // If the device plans, the number of active targets in each block is unknown.
                let bound = if self.config.animated { promise.rounding(&weights)[0] } else { 0.0 };
                self.found = self.found.max(Found { bound, additions: self.additions, ..found });
            }
        }
        Ok(())
    }

    /// Verifies once more, and completes the record.
    pub fn finish(mut self, subject: &mut Subject) -> Result<RunRecord> {
        if !self.timed.is_empty() {
            self.verify(subject)?;
            // Wrong results have no times.
            if self.is_right() {
                self.sum_up()?;
            }
        }
        let (found, diagonal) = (&self.found, self.promise.scale);
        let mut record = self.record;
        record.max_error = Some(found.error.position);
        record.max_error_rel = Some(found.error.position / diagonal);
        record.normal_error_deg = Some(found.error.normal_degrees);
        record.verified = self.promise.kept(found);
        record.rounds_ratio = record.spread().filter(|_| record.verified);
        if !record.verified {
            record.rounds.clear();
            record.problem = Some(self.promise.complaint(found));
        }
        Ok(record)
    }

    fn sum_up(&mut self) -> Result<()> {
        let (record, timed, setting) = (&mut self.record, &self.timed, self.setting);
        let (mut sum, mut changed, mut active) = (UpdateStats::default(), 0, 0);
        for (frame, step) in timed {
            sum += step.stats;
            let [before, now] = [frame - 1, *frame].map(|frame| setting.weights(frame));
            changed += before.iter().flatten().zip(now.iter().flatten()).filter(|(a, b)| a != b).count();
            active += now.iter().flatten().filter(|weight| **weight != 0.0).count();
        }
        let mean = |total: f64| total / timed.len() as f64;
        let per_head = |total: usize| mean(total as f64 / f64::from(setting.updated()));
        record.changed = per_head(changed);
        record.active = per_head(active);
        record.coefficients = per_head(sum.coefficients);
        record.passes = per_head(sum.passes);
        record.bytes_moved = mean(sum.bytes_moved as f64);
        record.bytes_floor = mean(sum.bytes_floor as f64);
        record.gpu_ms = times(timed, |frame| frame.gpu_ms);
        record.cpu_ms = times(timed, |frame| Some(frame.cpu_ms));
        record.update_and_draw_ms = times(timed, both);
        record.upload_ms = times(timed, |frame| frame.upload_ms);
        record.draw_ms = match setting.passes > 0 {
            true => times(timed, |frame| frame.draw_ms),
            false => {
                let draws = (0..DRAWS).map(|_| self.runner.draw_ms(setting.draws(1)));
                Stats::of(&draws.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect::<Vec<_>>())
            }
        }
        .map(|s| s.median);
        let b = self.machine.bandwidth;
        let rates = match record.gpu_ms {
            None => [b.cpu_read_gb_s, b.cpu_copy_gb_s],
            Some(_) => [b.device_read_gb_s, b.device_copy_gb_s],
        };
        let best = rates.into_iter().flatten().reduce(f64::max);
        // Medians, like the time shown beside it. No share if most frames of a clip change nothing.
        let best = best.filter(|_| !self.config.desc.path.evaluates_in_draws());
        let bytes = times(timed, |frame| Some(frame.stats.bytes_floor as f64)).map(|bytes| bytes.median);
        record.floor_ms = bytes.filter(|bytes| *bytes > 0.0).zip(best).map(|(bytes, gb_s)| bytes / (gb_s * 1e6));
        let update = record.gpu_ms.or(record.cpu_ms).map(|t| t.median).filter(|t| *t > 0.0);
        record.floor_fraction = record.floor_ms.zip(update).map(|(floor, update)| floor / update);
        Ok(())
    }
}

/// Time of update and draws, on the device.
fn both(frame: &Frame) -> Option<f64> {
    frame.gpu_ms.zip(frame.draw_ms).map(|(update, draw)| update + draw)
}

/// Statistics of the frames for which `of` returns a value.
fn times(frames: &[Timed], of: impl Fn(&Frame) -> Option<f64>) -> Option<Stats> {
    Stats::of(&frames.iter().filter_map(|(_, frame)| of(frame)).collect::<Vec<_>>())
}
