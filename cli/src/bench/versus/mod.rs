//! `bench --compare`: reports of earlier runs, configuration by configuration.

mod comparison;
mod page;
mod pairs;
mod significance;
#[cfg(test)]
mod tests;

use super::record::Report;
use super::report;
use crate::args::bench::BenchArgs;
use crate::output::{self, Failure, Output, publish, to_json, write_file};
use comparison::Comparison;
use pairs::Against;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Compare the reports that `args` name; write what was found into `folder`, where there is one.
pub fn run(args: &BenchArgs, folder: Option<&Path>, out: &Output) -> Result<(), Failure> {
    let read = |path: &PathBuf| Ok((path.display().to_string(), report::read(path)?));
    let reports: Vec<(String, Report)> = args.compare.iter().map(read).collect::<Result<_, Failure>>()?;
    let found = Comparison::new(&reports)?;
    out.say(page::text(&found));
    found.warnings.iter().for_each(|warning| out.note(warning));
    let json = out.json(&found);
    if let Some(dir) = folder {
        write(&found, &args.compare, dir)?;
        out.say(format_args!("report: {}", dir.join("index.html").display()));
    }
    json
}

/// Make sure that `dir` is ours to write to: new, empty, or with an earlier comparison.
pub fn claim(dir: &Path) -> Result<(), Failure> {
    let complaint = "holds something else than a comparison; name another one with --report";
    let is_ours = |text: String| Some(serde_json::from_str::<Value>(&text).ok()?.get("comparisons")?.is_array());
    output::claim(dir, complaint, || {
        std::fs::read_to_string(dir.join("comparison.json")).ok().and_then(is_ours) == Some(true)
    })
}

fn write(found: &Comparison, files: &[PathBuf], dir: &Path) -> Result<(), Failure> {
    let is_drawn = |name: &str| name.starts_with("ratios-");
    publish(dir, is_drawn, |new| {
        write_file(&new.join("comparison.json"), to_json(found)?)?;
        let draw = |against: &Against| page::figure(against).map(|figure| figure.write(new)).transpose();
        let drawn = found.comparisons.iter().map(draw).collect::<Result<Vec<_>, _>>()?;
        write_file(&new.join("index.html"), page::page(found, &page::links(files, dir), &drawn))
    })
}
