//! `bench`: the time per frame of the update paths, verified, with a report.
//!
//! The sweep that runs configurations makes a [`Report`]; [`finish`] prints it, writes it and decides whether
//! the command succeeded. Everything here works without a GPU.

mod bandwidth;
mod cache;
mod compare;
mod configs;
mod interleave;
mod machine;
mod record;
mod report;
mod run;
mod setting;
mod stamp;
pub mod stats;
mod suites;
mod sweep;
#[cfg(test)]
mod synthetic;
mod trial;
mod workload;

use crate::args::bench::BenchArgs;
use crate::input;
use crate::output::{Failure, Output};
use crate::table::count;
use deltamorph::headless::DeviceChoice;
use record::Report;
use report::{sentences, tables};
use run::RunRecord;

pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    // Before minutes are spent on what then cannot be written.
    let folder = (!args.no_report).then_some(args.report.as_path());
    out.check(&input::files_of(&args.input, &args.weights), &[], folder)?;
    folder.map_or(Ok(()), report::claim)?;
    match &args.redraw {
        Some(path) => finish(&report::read(path)?, args, out),
        None if args.suites.is_empty() => finish(&sweep::run(args, device, out)?, args, out),
        None => finish(&suites::run(args, device, out)?, args, out),
    }
}

/// Print the result, write the JSON and the report folder.
pub fn finish(report: &Report, args: &BenchArgs, out: &Output) -> Result<(), Failure> {
    if report.suites.is_empty() {
        out.say(tables::runs(&report.runs, true));
    }
    for suite in &report.suites {
        out.say(format_args!("{} (suite {})\n", sentences::title(suite), suite.name));
        for (_, table) in tables::of_suite(suite, report) {
            out.say(format_args!("{table}\n"));
        }
    }
    for skipped in &report.skipped {
        out.note(format_args!("{}: {}", skipped.what, skipped.reason));
    }
    if report.runs.is_empty() {
        // Nothing is no reason to replace an earlier file.
        if out.json_to_stdout() {
            out.json(report)?;
        }
        return Err(nothing_ran(report));
    }
    out.say(format_args!("\n{}", sentences::sentences(report).join("\n")));
    let json = out.json(report);
    if !args.no_report {
        let spinner = out.spinner("drawing the report");
        let written = report::write(report, &args.report);
        spinner.finish_and_clear();
        written?;
        out.say(format_args!("report: {}", args.report.join("index.html").display()));
    }
    json?;
    verdict(&report.runs)?;
    match report.unplayed.first() {
        None => Ok(()),
        Some(clip) => {
            let why = report.skipped.iter().find(|s| s.what.contains(clip)).map_or("no reason given", |s| &s.reason);
            Err(Failure::Failed(format!("clip '{clip}': no configuration could play it: {why}")))
        }
    }
}

fn nothing_ran(report: &Report) -> Failure {
    let why: Vec<String> = report.skipped.iter().map(|s| format!("{}: {}", s.what, s.reason)).collect();
    Failure::Failed(match why.is_empty() {
        true => "no configuration could run; `deltamorph devices` says what each device can do".into(),
        false => format!("no configuration could run; {}", why.join("; ")),
    })
}

fn verdict(runs: &[RunRecord]) -> Result<(), Failure> {
    let wrong: Vec<&RunRecord> = runs.iter().filter(|r| !r.verified).collect();
    match wrong.first() {
        None => Ok(()),
        Some(first) => Err(Failure::Failed(format!(
            "{} of {} configurations are wrong, the first: {} {} batch {}, {} changed: {}; the report marks them",
            wrong.len(),
            runs.len(),
            first.path,
            first.format,
            first.batch_size,
            count(first.changed),
            first.problem.as_deref().unwrap_or("no reason given")
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_runs_fail_the_command() {
        let mut report = synthetic::report();
        let message = verdict(&report.runs).expect_err("two are wrong").to_string();
        assert!(message.starts_with("2 of ") && message.contains("feedback float32 batch 8"), "{message}");
        report.runs.retain(|r| r.verified);
        assert!(verdict(&report.runs).is_ok());
        assert!(nothing_ran(&report).to_string().contains("no configuration could run; "));
    }
}
