//! `bench --suite`: ready-made comparisons, each with a page of its own.
//!
//! Configurations of a suite are measured in turns ([`race`](super::race)), and each frame draws every head once behind
//! the update where techniques are compared: what they save in one they may pay for in the other.

mod cells;
mod chapter;
mod crowd;
mod subject;
mod technique;

use super::compare::SuiteRecord;
use super::machine::Machine;
use super::race::{Entrant, Outcome, Pace, Tempo, contest};
use super::record::{Report, Skipped};
use super::run::RunRecord;
use super::trial::Context;
use crate::args::bench::{BenchArgs, SuiteChoice};
use crate::input::{self, MeshInfo};
use crate::output::{Failure, Output};
use deltamorph::headless::DeviceChoice;
use indicatif::ProgressBar;
use subject::Subject;

/// Turns that the frames of a configuration are divided into.
const ROUNDS: usize = 10;

/// What all suites share, and what they have found so far.
pub struct Lab<'a> {
    pub args: &'a BenchArgs,
    pub machine: &'a Machine,
    pub out: &'a Output,
    /// Progress: a step for each cell.
    pub bar: ProgressBar,
    /// What the suite that is running has found.
    suite: SuiteRecord,
    /// Those that have run.
    suites: Vec<SuiteRecord>,
    runs: Vec<RunRecord>,
    skipped: Vec<Skipped>,
    meshes: Vec<MeshInfo>,
}

impl Lab<'_> {
    fn suite(&mut self, name: &str, run: impl FnOnce(&mut Self) -> Result<(), Failure>) -> Result<(), Failure> {
        self.suite.name = name.into();
        run(self)?;
        self.suites.push(std::mem::take(&mut self.suite));
        Ok(())
    }

    /// The frames of a configuration, in turns.
    pub fn pace(&self, tempo: Tempo) -> Pace {
        let frames = self.args.frames;
        Pace { frames, rounds: ROUNDS.min(frames), limit: Some(self.args.time_limit()), tempo }
    }

    /// Measure `entrants` on `subject`, in turns.
    pub fn contest(
        &mut self,
        subject: &mut Subject,
        entrants: &[Entrant<'_>],
        pace: &Pace,
    ) -> Result<Vec<Outcome>, Failure> {
        let Subject { input, cache, .. } = subject;
        let context = Context { args: self.args, input, bandwidth: self.machine.bandwidth };
        contest(context, self.machine.gpu.as_ref(), cache, entrants, pace)
    }

    /// As [`contest`](Self::contest); what was measured goes into the report under `cell` and the entrants' names.
    pub fn measure(
        &mut self,
        subject: &mut Subject,
        cell: &str,
        entrants: &[Entrant<'_>],
        pace: &Pace,
    ) -> Result<Vec<Option<RunRecord>>, Failure> {
        self.bar.set_message(format!("{} {cell}", self.suite.name));
        let mut runs = vec![];
        for (outcome, entrant) in self.contest(subject, entrants, pace)?.into_iter().zip(entrants) {
            runs.push(match outcome {
                Ok(mut run) => {
                    run.raw_error_rel = run.raw_error_rel.filter(|_| !subject.was_packed);
                    self.keep(cell, &entrant.what, run);
                    self.runs.last().cloned()
                }
                Err(refused) => {
                    self.skip(Skipped { what: format!("{}: {}", refused.what, cell), ..refused });
                    None
                }
            });
        }
        Ok(runs)
    }

    /// Put a run into the report.
    pub fn keep(&mut self, cell: &str, technique: &str, run: RunRecord) {
        let suite = self.suite.name.clone();
        self.runs.push(RunRecord { suite, cell: cell.into(), technique: technique.into(), ..run });
    }

    /// Put what could not run into the report, once.
    pub fn skip(&mut self, skipped: Skipped) {
        if self.skipped.iter().all(|s| (&s.what, &s.reason) != (&skipped.what, &skipped.reason)) {
            self.skipped.push(skipped);
        }
    }
}

/// Run the suites that `args` ask for.
pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report, Failure> {
    let input = input::load(&args.input, true, out)?;
    let machine = Machine::open(args, device, &input, out)?;
    let empty = machine.report(&input);
    let mut lab = Lab {
        args,
        machine: &machine,
        out,
        bar: out.bar(0),
        suite: SuiteRecord::default(),
        suites: vec![],
        runs: vec![],
        skipped: vec![],
        meshes: vec![],
    };
    let asked = |suite| args.suites.contains(&suite) || args.suites.contains(&SuiteChoice::All);
    // Before anything is measured: a set that cannot be used is not to cost what was measured before it.
    let clips = if asked(SuiteChoice::Clips) { cells::captured(&mut lab)? } else { vec![] };
    if asked(SuiteChoice::Chapter) {
        lab.suite("chapter", |lab| chapter::run(lab, input))?;
    }
    if asked(SuiteChoice::Crowd) {
        lab.suite("crowd", crowd::run)?;
    }
    if asked(SuiteChoice::Techniques) {
        lab.suite("techniques", |lab| cells::run(lab, cells::made_up(lab)?, &[1, 10, 100]))?;
    }
    if asked(SuiteChoice::Clips) {
        lab.suite("clips", |lab| cells::run(lab, clips, &[1]))?;
    }
    lab.bar.finish_and_clear();
    let Lab { suites, runs, skipped, meshes, .. } = lab;
    let input = meshes.first().cloned().unwrap_or_else(|| empty.input.clone());
    Ok(Report { runs, skipped, suites, meshes, input, ..empty })
}
