//! The common part of the ordinary run and the suites: the machine, and the results.

use super::interleave::{Common, Schedule, interleave};
use super::machine::Machine;
use super::record::{Comparison, ROUNDS, Report, RunRecord, Skipped, SuiteRecord};
use super::subject::Subject;
use super::trial::Candidate;
use crate::args::bench::BenchArgs;
use crate::input::Input;
use crate::output::{Failure, Output};
use deltamorph_headless::DeviceChoice;
use indicatif::ProgressBar;
use std::time::Duration;

/// The machine, and the results on it so far.
pub struct Session<'a> {
    pub args: &'a BenchArgs,
    pub machine: Machine<'a>,
    pub out: &'a Output,
    /// Progress: a step for each cell.
    pub bar: ProgressBar,
    /// The results of the running suite.
    pub suite: SuiteRecord,
    /// How long it times a configuration.
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
        Ok(Self { args, machine, out, bar: out.bar(0), suite: SuiteRecord::default(), limit: Duration::MAX, report })
    }

    /// Runs a suite, which times each configuration for `seconds` by default.
    pub fn suite(
        &mut self,
        name: &str,
        seconds: f32,
        run: impl FnOnce(&mut Self) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        self.suite.name = name.into();
        self.limit = self.args.time_limit(seconds);
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
        self.bar.finish_and_clear();
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
        Schedule { frames, rounds: ROUNDS.min(frames), limit: Some(self.limit), common }
    }

    /// Measures `candidates` on `subject`, interleaved, and adds the runs to the report under `cell` and their names.
    pub fn measure(
        &mut self,
        subject: &mut Subject,
        cell: &str,
        candidates: &[Candidate<'_>],
        schedule: &Schedule,
    ) -> Result<Vec<Option<RunRecord>>, Failure> {
        self.bar.set_message(format!("{} {cell}", self.suite.name));
        let outcomes = interleave(&self.machine, subject, candidates, schedule)?;
        let runs = outcomes.into_iter().zip(candidates).map(|(outcome, candidate)| match outcome {
            Ok(run) => Some(self.keep(cell, &candidate.what, run)),
            Err(refused) => {
                self.skip(Skipped { what: format!("{}: {cell}", refused.what), ..refused });
                None
            }
        });
        Ok(runs.collect())
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
        let suite = self.suite.name.clone();
        let run = RunRecord { suite, cell: cell.into(), technique: technique.into(), ..run };
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
