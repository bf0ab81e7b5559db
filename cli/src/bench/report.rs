//! The report folder: report.json, runs.csv and index.html.

use super::record::{Report, RunRecord};
use crate::output::{self, Failure, Result, publish, write_file};
use serde_json::Value;
use std::path::Path;

/// Writes everything into `dir`; replaces the files of an earlier run once all are complete.
pub fn write(report: &Report, dir: &Path) -> Result<()> {
    publish(
        dir,
        |_| false,
        |dir| {
            let json = output::to_json(report)?;
            write_file(&dir.join("runs.csv"), csv(&report.runs)?)?;
            write_file(&dir.join("index.html"), page(&json))?;
            write_file(&dir.join("report.json"), json)
        },
    )
}

/// The page that draws a report. In JSON "<" occurs in strings only; escaped, none of them ends the element it is in.
pub fn page(json: &str) -> String {
    include_str!("report.html").replacen("REPORT", &json.replace('<', "\\u003c"), 1)
}

/// Ensures that `dir` may be written: it is new, empty, or has an earlier report.
pub fn claim(dir: &Path) -> Result<()> {
    let complaint = "contains files that are not a report; choose another folder with --report";
    output::claim(dir, complaint, || {
        let text = std::fs::read_to_string(dir.join("report.json")).unwrap_or_default();
        serde_json::from_str(&text).is_ok_and(|value: Value| value["schema"].is_u64() && value["runs"].is_array())
    })
}

/// The columns of runs.csv: the fields of a run; `gpu_ms_median` is the field `median` of `gpu_ms`.
const COLUMNS: &str = "suite cell technique mesh targets path mode format accumulate slots batch_size batch_max \
    workload changed coefficients active heads shared draws passes bytes_moved bytes_floor floor_ms \
    floor_fraction gpu_ms_median gpu_ms_mean gpu_ms_stderr gpu_ms_min gpu_ms_max gpu_ms_n \
    cpu_ms_median cpu_ms_mean cpu_ms_stderr cpu_ms_min cpu_ms_max cpu_ms_n draw_ms \
    update_and_draw_ms_median update_and_draw_ms_mean update_and_draw_ms_stderr update_and_draw_ms_min \
    update_and_draw_ms_max update_and_draw_ms_n \
    upload_ms_median upload_ms_mean upload_ms_stderr upload_ms_min upload_ms_max upload_ms_n \
    max_error max_error_rel normal_error_deg verified problem rounds_ratio pose";

fn csv(runs: &[RunRecord]) -> Result<Vec<u8>> {
    let mut out = csv::Writer::from_writer(Vec::new());
    out.write_record(COLUMNS.split(' ')).map_err(Failure::failed)?;
    for run in runs {
        let run = serde_json::to_value(run).map_err(Failure::failed)?;
        out.write_record(COLUMNS.split(' ').map(|column| cell(&run, column))).map_err(Failure::failed)?;
    }
    out.into_inner().map_err(Failure::failed)
}

fn cell(run: &Value, column: &str) -> String {
    let nested = || column.rsplit_once('_').and_then(|(field, part)| run.get(field)?.get(part));
    match run.get(column).or_else(nested) {
        None | Some(Value::Null) => String::new(),
        Some(Value::String(text)) => text.clone(),
        // JSON writes small numbers with exponents, which not every reader of CSV accepts.
        Some(Value::Number(number)) => number.as_f64().unwrap_or(f64::NAN).to_string(),
        Some(other) => other.to_string(),
    }
}
