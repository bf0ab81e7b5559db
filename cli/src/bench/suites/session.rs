//! What suites share: the machine, the meshes, and the record of what was found.

use crate::args::InputArgs;
use crate::args::bench::BenchArgs;
use crate::bench::cache::Cache;
use crate::bench::compare::{Comparison, SuiteRecord};
use crate::bench::interleave::{Candidate, Common, Outcome, Schedule, interleave};
use crate::bench::machine::Machine;
use crate::bench::record::{Report, Skipped};
use crate::bench::run::RunRecord;
use crate::bench::trial::Context;
use crate::input::{self, Input};
use crate::output::{Failure, Output};
use deltamorph::MorphMesh;
use indicatif::ProgressBar;
use std::sync::Arc;

/// Rounds that the frames of a configuration are divided into.
const ROUNDS: usize = 10;

/// What all suites share, and what they have found so far.
pub struct Session<'a> {
    pub args: &'a BenchArgs,
    pub machine: &'a Machine,
    pub out: &'a Output,
    /// Progress: a step for each cell.
    pub bar: ProgressBar,
    /// What the suite that is running has found.
    pub suite: SuiteRecord,
    /// What was found before it, and every run.
    report: Report,
}

impl<'a> Session<'a> {
    /// What is found is added to `report`.
    pub fn new(args: &'a BenchArgs, machine: &'a Machine, out: &'a Output, report: Report) -> Self {
        Self { args, machine, out, bar: out.bar(0), suite: SuiteRecord::default(), report }
    }

    /// Run the suite called `name`.
    pub fn suite(&mut self, name: &str, run: impl FnOnce(&mut Self) -> Result<(), Failure>) -> Result<(), Failure> {
        self.suite.name = name.into();
        run(self)?;
        self.report.suites.push(std::mem::take(&mut self.suite));
        Ok(())
    }

    /// The report, with all that was found.
    pub fn report(self) -> Report {
        self.bar.finish_and_clear();
        let input = self.report.meshes.first().unwrap_or(&self.report.input).clone();
        Report { input, ..self.report }
    }

    /// The frames of a configuration, in rounds.
    pub fn schedule(&self, common: Common) -> Schedule {
        let frames = self.args.frames;
        Schedule { frames, rounds: ROUNDS.min(frames), limit: Some(self.args.time_limit()), common }
    }

    /// Measure `candidates` on `subject`, interleaved.
    pub fn interleave(
        &mut self,
        subject: &mut Subject,
        candidates: &[Candidate<'_>],
        schedule: &Schedule,
    ) -> Result<Vec<Outcome>, Failure> {
        let Subject { input, cache, .. } = subject;
        let context = Context { args: self.args, input, bandwidth: self.machine.bandwidth };
        interleave(context, self.machine.gpu.as_ref(), cache, candidates, schedule)
    }

    /// As [`interleave`](Self::interleave); runs are added to the report under `cell` and the candidates' names.
    pub fn measure(
        &mut self,
        subject: &mut Subject,
        cell: &str,
        candidates: &[Candidate<'_>],
        schedule: &Schedule,
    ) -> Result<Vec<Option<RunRecord>>, Failure> {
        self.bar.set_message(format!("{} {cell}", self.suite.name));
        let mut runs = vec![];
        for (outcome, candidate) in self.interleave(subject, candidates, schedule)?.into_iter().zip(candidates) {
            runs.push(match outcome {
                Ok(mut run) => {
                    run.raw_error_rel = run.raw_error_rel.filter(|_| !subject.was_packed);
                    self.keep(cell, &candidate.what, run);
                    self.report.runs.last().cloned()
                }
                Err(refused) => {
                    self.skip(Skipped { what: format!("{}: {}", refused.what, cell), ..refused });
                    None
                }
            });
        }
        Ok(runs)
    }

    /// Measure two candidates, and compare the times of their updates.
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
            self.suite.comparisons.extend(Comparison::new(cell, [a, b], names, |round| round.update_ms, goal));
        }
        Ok(())
    }

    /// Put a run into the report.
    pub fn keep(&mut self, cell: &str, technique: &str, run: RunRecord) {
        let suite = self.suite.name.clone();
        self.report.runs.push(RunRecord { suite, cell: cell.into(), technique: technique.into(), ..run });
    }

    /// Put what could not run into the report, once.
    pub fn skip(&mut self, skipped: Skipped) {
        let known = &mut self.report.skipped;
        if known.iter().all(|s| (&s.what, &s.reason) != (&skipped.what, &skipped.reason)) {
            known.push(skipped);
        }
    }
}

/// Mean fraction of the vertices that a target of the sparse head moves, where none is given.
const SPARSE: f32 = 0.08;

/// A mesh with all that was packed from it and computed for it.
pub struct Subject {
    pub input: Input,
    /// See there.
    pub cache: Cache,
    /// It comes from a packed file, which does not say what it was packed from.
    pub was_packed: bool,
}

impl Subject {
    /// The report will describe it.
    pub fn new(session: &mut Session<'_>, input: Input) -> Self {
        let meshes = &mut session.report.meshes;
        if meshes.iter().all(|mesh| mesh.name != input.name) {
            meshes.push(input.info());
        }
        let was_packed = input.packed.is_some();
        Self { input, cache: Cache::default(), was_packed }
    }

    /// The first `targets` of the mesh.
    pub fn first_targets(&self, targets: usize) -> Self {
        let first = |mesh: &MorphMesh| {
            let mut mesh = mesh.clone();
            mesh.targets.truncate(targets);
            Arc::new(mesh)
        };
        let (name, origin) = (self.input.name.clone(), self.input.origin.clone());
        let (raw, kept) = (first(&self.input.raw), first(&self.input.kept));
        let input = Input { name, raw, kept, packed: None, clips: vec![], origin };
        Self { input, cache: Cache::default(), was_packed: self.was_packed }
    }

    pub fn targets(&self) -> usize {
        self.input.kept.targets.len()
    }
}

/// The built-in head, dense and sparse; or INPUT alone.
pub fn dense_and_sparse(session: &Session<'_>) -> Result<Vec<Input>, Failure> {
    let args = &session.args.input;
    if args.input.is_some() {
        return Ok(vec![input::load(args, true, session.out)?]);
    }
    let sparse = args.head.sparsity.unwrap_or(SPARSE);
    let heads = [("dense".to_owned(), 1.0), (format!("{}% sparse", sparse * 100.0), sparse)];
    let load = |(name, sparsity)| -> Result<Input, Failure> {
        let mut args: InputArgs = args.clone();
        args.head.sparsity = Some(sparsity);
        Ok(Input { name, ..input::load(&args, true, session.out)? })
    };
    heads.into_iter().map(load).collect()
}
