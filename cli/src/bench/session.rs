//! The common part of the ordinary run and the suites: the machine, and the results.

use super::interleave::{Common, Schedule, interleave};
use super::machine::Machine;
use super::record::{Comparison, ROUNDS, Report, RunRecord, Skipped, SuiteRecord};
use super::subject::Subject;
use super::tables;
use super::trial::Candidate;
use crate::args::bench::BenchArgs;
use crate::input::Input;
use crate::output::{Failure, Output};
use crate::table::sig3;
use deltamorph_headless::DeviceChoice;
use std::time::Duration;

/// Seconds to time a configuration of an ordinary run for, by default.
const LIMIT: f32 = 0.4;

/// The machine, and the results on it so far.
pub struct Session<'a> {
    pub args: &'a BenchArgs,
    pub machine: Machine<'a>,
    pub out: &'a Output,
    /// Groups of configurations to measure, of the running suite or in all, and how many of them have begun.
    pub planned: usize,
    begun: usize,
    /// The results of the running suite.
    pub suite: SuiteRecord,
    /// How long a configuration is timed.
    pub limit: Duration,
    /// Earlier results, and every run.
    report: Report,
}

impl<'a> Session<'a> {
    /// Opens the machine for `input`, without results.
    pub fn open(
        args: &'a BenchArgs,
        device: Option<&DeviceChoice>,
        input: &Input,
        out: &'a Output,
    ) -> Result<Self, Failure> {
        let machine = Machine::open(args, device, input, out)?;
        let report = machine.report(input);
        let (suite, limit) = (SuiteRecord::default(), args.time_limit(LIMIT));
        Ok(Self { args, machine, out, planned: 0, begun: 0, suite, limit, report })
    }

    /// Runs a suite, which times each configuration for `seconds` by default.
    pub fn suite(
        &mut self,
        [name, title]: [&str; 2],
        seconds: f32,
        run: impl FnOnce(&mut Self) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        self.suite.name = name.into();
        self.suite.title = title.into();
        self.limit = self.args.time_limit(seconds);
        self.planned = 0;
        self.begun = 0;
        run(self)?;
        self.report.suites.push(std::mem::take(&mut self.suite));
        Ok(())
    }

    /// The mesh of a suite; adds it to the report.
    pub fn subject(&mut self, input: Input) -> Subject {
        self.scene(vec![input])
    }

    /// The meshes of a scene, at least one; adds them to the report.
    pub fn scene(&mut self, mut inputs: Vec<Input>) -> Subject {
        let own: Vec<_> = inputs.iter().map(Input::info).collect();
        let mut subject = Subject::new(inputs.remove(0));
        subject.others = inputs.into_iter().map(Subject::new).collect();
        let meshes = &mut self.report.meshes;
        for mesh in std::iter::once(subject.info()).chain(own) {
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

    /// Frames and rounds of a configuration.
    pub fn schedule(&self, common: Common) -> Schedule {
        let frames = self.args.frames;
        Schedule { frames, rounds: ROUNDS.min(frames), limit: self.limit, common }
    }

    /// Measures `candidates` on `subject`, interleaved, prints a row for each, and adds the runs to the report, those
    /// of suites under `cell` and their names. Says before what it is about, and how long the rest may take.
    pub fn measure(
        &mut self,
        subject: &mut Subject,
        cell: &str,
        candidates: &[Candidate<'_>],
        schedule: &Schedule,
    ) -> Result<Vec<Option<RunRecord>>, Failure> {
        self.begun += 1;
        self.planned = self.planned.max(self.begun);
        let (count, rounds) = (candidates.len(), schedule.rounds);
        let left = self.limit.mul_f64(((self.planned - self.begun + 1) * count) as f64);
        self.out.note(format_args!(
            "{} of {}: {cell}: {count} configurations in turns, {rounds} rounds; up to {} s of timing left",
            self.begun,
            self.planned,
            sig3(left.as_secs_f64())
        ));
        let bar = self.out.bar((count + rounds) as u64);
        bar.set_message(cell.to_owned());
        let outcomes = interleave(&self.machine, subject, candidates, schedule, &bar)?;
        bar.finish_and_clear();
        let runs = outcomes.into_iter().zip(candidates).map(|(outcome, candidate)| match outcome {
            Ok(run) => Some(self.keep(cell, &candidate.what, run)),
            Err(refused) => {
                self.skip(Skipped { what: format!("{}: {cell}", refused.what), ..refused });
                None
            }
        });
        let runs: Vec<Option<RunRecord>> = runs.collect();
        self.out.say(format_args!("{cell}\n{}\n", tables::runs(runs.iter().flatten())));
        Ok(runs)
    }

    /// Measures two candidates, and compares the times of their updates.
    pub fn compare_updates(
        &mut self,
        subject: &mut Subject,
        cell: &str,
        pair: [Candidate<'_>; 2],
        schedule: &Schedule,
        goal: &str,
    ) -> Result<(), Failure> {
        if let [Some(a), Some(b)] = &self.measure(subject, cell, &pair, schedule)?[..] {
            let names = pair.map(|candidate| candidate.what);
            self.suite.comparisons.extend(Comparison::new(cell, [a, b], names, goal));
        }
        Ok(())
    }

    /// Adds a run to the report.
    pub fn keep(&mut self, cell: &str, technique: &str, run: RunRecord) -> RunRecord {
        let run = match self.suite.name.clone() {
            suite if suite.is_empty() => run,
            suite => RunRecord { suite, cell: cell.into(), technique: technique.into(), ..run },
        };
        self.report.runs.push(run.clone());
        run
    }

    /// Adds a configuration that could not run to the report, once.
    pub fn skip(&mut self, skipped: Skipped) {
        if !self.report.skipped.contains(&skipped) {
            self.report.skipped.push(skipped);
        }
    }
}
