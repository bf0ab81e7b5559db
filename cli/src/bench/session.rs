//! The common part of the ordinary run and the suites: the machine, and the results.

use super::configs::{Config, Wanted, configurations};
use super::interleave::{Outcome, Schedule, interleave};
use super::machine::Machine;
use super::record::{ROUNDS, Report, RunRecord, Skipped, SuiteRecord};
use super::subject::Subject;
use super::tables;
use super::workload::Setting;
use crate::args::bench::BenchArgs;
use crate::input::Input;
use crate::output::{Output, Result};
use crate::table::sig3;
use deltamorph_headless::DeviceChoice;
use std::time::Duration;

/// The machine, and the results on it so far.
pub struct Session<'a> {
    pub args: &'a BenchArgs,
    machine: Machine<'a>,
    pub out: &'a Output,
    /// Groups of configurations to measure, of the running suite or in all, and how many of them have begun.
    pub planned: usize,
    begun: usize,
    /// How long a configuration is timed.
    limit: Duration,
    report: Report,
}

impl<'a> Session<'a> {
    /// Opens the machine for `input`, without results. Each configuration is timed for `seconds` by default.
    pub fn open(
        args: &'a BenchArgs,
        device: Option<&DeviceChoice>,
        input: &Input,
        seconds: f32,
        out: &'a Output,
    ) -> Result<Self> {
        let machine = Machine::open(args, device, input, out)?;
        let (report, limit) = (machine.report(input), args.time_limit(seconds));
        Ok(Self { args, machine, out, planned: 0, begun: 0, limit, report })
    }

    /// Begins a suite.
    pub fn suite(&mut self, name: &'static str, title: &'static str) {
        self.out.say(format_args!("{title} (suite {name})\n"));
        (self.planned, self.begun) = (0, 0);
        self.report.suites.push(SuiteRecord { name, title });
    }

    /// The meshes of a scene, at least one; adds them to the report.
    pub fn scene(&mut self, inputs: Vec<Input>) -> Subject {
        let subject = Subject::new(inputs);
        let meshes = &mut self.report.meshes;
        for mesh in std::iter::once(subject.info()).chain(subject.infos()) {
            if meshes.iter().all(|known| known.name != mesh.name) {
                meshes.push(mesh);
            }
        }
        subject
    }

    pub fn report(self) -> Report {
        let Report { runs, skipped, meshes, input, .. } = &self.report;
        let named = self.args.update.paths.iter().map(|path| path.name());
        let missing = named
            .filter(|path| runs.iter().all(|run| run.path != *path) && skipped.iter().any(|other| other.is_of(path)));
        let (unmeasured, input) = (missing.map(str::to_owned).collect(), meshes.first().unwrap_or(input).clone());
        Report { unmeasured, input, ..self.report }
    }

    /// The configurations that can run; adds those requested that cannot to the report.
    pub fn configurations(&mut self, wanted: &Wanted<'_>) -> Vec<Config> {
        let (configs, skipped) = configurations(wanted, self.args, self.machine.gpu.as_ref());
        skipped.into_iter().for_each(|skipped| self.skip(skipped));
        configs
    }

    /// The fastest of `configs` in a short run; none if all are refused.
    pub fn choose(
        &mut self,
        subject: &mut Subject,
        configs: &[Config],
        setting: &Setting<'_>,
    ) -> Result<Option<Config>> {
        if let [only] = configs {
            return Ok(Some(only.clone()));
        }
        let schedule = Schedule { frames: 6, rounds: 3, limit: self.limit / 20 };
        let outcomes = self.interleave(subject, "choosing format and batch size", configs, setting, &schedule)?;
        let (mut best, mut fastest) = (f64::INFINITY, None);
        for (outcome, config) in outcomes.into_iter().zip(configs) {
            match outcome {
                Ok(run) if run.counts() && run.median() < best => {
                    (best, fastest) = (run.median(), Some(config.clone()))
                }
                Ok(run) if run.verified => {}
                // A wrong result has to be reported, regardless of the others.
                wrong => drop(self.keep("choice", wrong)),
            }
        }
        Ok(fastest)
    }

    /// Measures `configs` on `subject` in turns, prints a row for each, and adds the runs to the report, under `cell`.
    /// Says before what it is about, and how long the rest may take.
    pub fn measure(
        &mut self,
        subject: &mut Subject,
        cell: &str,
        configs: &[Config],
        setting: &Setting<'_>,
    ) -> Result<()> {
        self.begun += 1;
        self.planned = self.planned.max(self.begun);
        let (count, frames) = (configs.len(), self.args.frames);
        let schedule = Schedule { frames, rounds: ROUNDS.min(frames), limit: self.limit };
        let left = self.limit.mul_f64(((self.planned - self.begun + 1) * count) as f64);
        self.out.progress(format_args!(
            "{} of {}: {cell}: {count} configurations in {} rounds; up to {} s left",
            self.begun,
            self.planned,
            schedule.rounds,
            sig3(left.as_secs_f64())
        ));
        let outcomes = self.interleave(subject, cell, configs, setting, &schedule)?;
        let runs: Vec<RunRecord> = outcomes.into_iter().filter_map(|outcome| self.keep(cell, outcome)).collect();
        self.out.say(format_args!("{cell}\n{}\n", tables::runs(&runs)));
        Ok(())
    }

    fn interleave(
        &self,
        subject: &mut Subject,
        what: &str,
        configs: &[Config],
        setting: &Setting<'_>,
        schedule: &Schedule,
    ) -> Result<Vec<Outcome>> {
        let bar = self.out.bar((configs.len() + schedule.rounds) as u64);
        bar.set_message(what.to_owned());
        let outcomes = interleave(&self.machine, subject, configs, setting, schedule, &bar)?;
        drop(bar);
        Ok(outcomes)
    }

    /// Adds a run to the report, or why there is none.
    fn keep(&mut self, cell: &str, outcome: Outcome) -> Option<RunRecord> {
        match outcome {
            Ok(run) => {
                let suite = self.report.suites.last().map_or("", |suite| suite.name);
                let run = RunRecord { suite, cell: cell.into(), ..run };
                self.report.runs.push(run.clone());
                Some(run)
            }
            Err(refused) => {
                self.skip(Skipped { what: format!("{}: {cell}", refused.what), ..refused });
                None
            }
        }
    }

    /// Adds a configuration that could not run to the report, once.
    pub fn skip(&mut self, skipped: Skipped) {
        if !self.report.skipped.contains(&skipped) {
            self.report.skipped.push(skipped);
        }
    }
}
