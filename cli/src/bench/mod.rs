//! `bench`: the time per frame of the update paths, verified, with a report.

mod configs;
mod interleave;
mod machine;
mod record;
mod report;
mod sentences;
mod session;
pub mod stats;
mod subject;
mod suites;
mod sweep;
mod tables;
mod trial;
mod workload;

use crate::args::bench::BenchArgs;
use crate::input;
use crate::output::{Failure, Output, Result};
use deltamorph_headless::DeviceChoice;
use record::Report;

pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<()> {
    // Checked before minutes are spent on results that could not be written.
    let folder = args.folder();
    out.check(&input::files_of(&args.input, &args.weights), &[], folder)?;
    folder.map_or(Ok(()), report::claim)?;
    let mut report =
        if args.suites.is_empty() { sweep::run(args, device, out)? } else { suites::run(args, device, out)? };
    report.findings = sentences::sentences(&report);
    finish(&report, args, out)
}

/// Prints the result, and writes the JSON and the report folder.
fn finish(report: &Report, args: &BenchArgs, out: &Output) -> Result<()> {
    for skipped in &report.skipped {
        out.warn(format_args!("{}: {}", skipped.what, skipped.reason));
    }
    if report.runs.is_empty() {
        // An empty result does not replace an earlier file.
        if out.json_to_stdout() {
            out.json(report)?;
        }
        return verdict(report);
    }
    out.say(report.findings.join("\n"));
    let json = out.json(report);
    if let Some(folder) = args.folder() {
        let spinner = out.spinner("writing the report");
        let written = report::write(report, folder);
        drop(spinner);
        written?;
        out.say(format_args!("report: {}", folder.join("index.html").display()));
    }
    json?;
    verdict(report)
}

/// A failure if runs were wrong, if there were none, or if a clip or a path that was requested by name could not run.
fn verdict(report: &Report) -> Result<()> {
    let (runs, skipped) = (&report.runs, &report.skipped);
    let wrong = || runs.iter().filter(|r| !r.verified);
    Err(Failure::Failed(if let Some(first) = wrong().next() {
        format!(
            "{} of {} configurations are wrong (the first: {}, {} batch {}: {}); the report marks them",
            wrong().count(),
            runs.len(),
            first.cell,
            first.label(),
            first.batch_size,
            first.problem.as_deref().unwrap_or("no reason given")
        )
    } else if runs.is_empty() && skipped.is_empty() {
        "no configuration could run; `deltamorph devices` says what each device can do".into()
    } else if runs.is_empty() {
        let why: Vec<String> = skipped.iter().map(|s| format!("{}: {}", s.what, s.reason)).collect();
        format!("no configuration could run; {}", why.join("; "))
    } else if let Some(name) = report.unmeasured.first() {
        let why = skipped.iter().find(|s| s.what.contains(name)).map_or("no reason given", |s| &s.reason);
        format!("{}: no configuration of it could run: {why}", report.unmeasured.join(", "))
    } else {
        return Ok(());
    }))
}

#[cfg(test)]
mod tests;
