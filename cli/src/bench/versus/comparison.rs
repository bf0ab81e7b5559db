//! What a comparison finds: in which configurations reports differ, and in what besides.

use super::pairs::{Against, KEY, Keyed, keyed, plain};
use crate::bench::record::{DeviceInfo, Report};
use crate::input::MeshInfo;
use crate::output::Failure;
use crate::table::listed;
use serde::Serialize;

/// The JSON of `bench --compare`. Fields may be added, never renamed.
#[derive(Debug, Serialize)]
pub struct Comparison {
    pub schema: u32,
    pub version: &'static str,
    /// The first is what the others are compared with.
    pub reports: Vec<Source>,
    /// What differs besides the program.
    pub warnings: Vec<String>,
    pub comparisons: Vec<Against>,
}

/// A report that is compared.
#[derive(Debug, Serialize)]
pub struct Source {
    /// "A", "B", …: in the order given.
    pub name: String,
    pub file: String,
    pub version: String,
    pub created: String,
    pub command: String,
    pub device: DeviceInfo,
    pub input: MeshInfo,
    pub runs: usize,
}

impl Comparison {
    /// Of the first of `reports`, which come with their files, with each of the others.
    pub fn new(reports: &[(String, Report)]) -> Result<Self, Failure> {
        let names: Vec<String> = (0..reports.len()).map(name).collect();
        let keyed: Vec<Vec<Keyed<'_>>> = reports.iter().map(|(_, report)| keyed(report)).collect();
        let others = || keyed.iter().zip(&names).skip(1);
        let comparisons: Vec<Against> =
            others().map(|(runs, name)| Against::new(&keyed[0], runs, [&names[0], name])).collect();
        let foreign = comparisons.iter().find(|found| found.configurations.is_empty());
        if let Some(foreign) = foreign.filter(|_| comparisons.iter().all(|found| found.configurations.is_empty())) {
            let at = names.iter().position(|name| *name == foreign.name).unwrap_or(0);
            return Err(Failure::Failed(format!(
                "{} and {}: no configuration is in both{}; measure both with the same INPUT and options",
                reports[0].0,
                reports[at].0,
                difference(&keyed[0], &keyed[at]).map_or(String::new(), |why| format!(" ({why})")),
            )));
        }
        let mut warnings: Vec<String> = vec![];
        for ((file, report), name) in reports.iter().zip(&names).skip(1) {
            warnings.extend(differences(&reports[0].1, report, [&names[0], name]));
            if comparisons.iter().any(|found| found.name == *name && found.configurations.is_empty()) {
                warnings.push(format!("{name} ({file}) has no configuration in common with {}.", names[0]));
            }
        }
        let source = |((file, report), name): (&(String, Report), &String)| Source {
            name: name.clone(),
            file: file.clone(),
            version: report.version.clone(),
            created: report.created.clone(),
            command: report.command.clone(),
            device: report.device.clone(),
            input: report.input.clone(),
            runs: report.runs.len(),
        };
        let reports = reports.iter().zip(&names).map(source).collect();
        Ok(Self { schema: 1, version: env!("CARGO_PKG_VERSION"), reports, warnings, comparisons })
    }
}

/// A, B, … Z, A2, B2, …
fn name(i: usize) -> String {
    let letter = char::from(b'A' + (i % 26) as u8);
    if i < 26 { letter.into() } else { format!("{letter}{}", i / 26 + 1) }
}

/// Where runs of two reports that have nothing in common differ throughout.
fn difference(a: &[Keyed<'_>], b: &[Keyed<'_>]) -> Option<String> {
    let values = |runs: &[Keyed<'_>], field: &str| {
        let mut values: Vec<String> = runs.iter().map(|(key, _)| plain(&key[field])).collect();
        values.dedup();
        values.sort();
        values.dedup();
        values
    };
    let field = KEY.iter().find(|field| {
        let (a, b) = (values(a, field), values(b, field));
        !a.is_empty() && !b.is_empty() && a.iter().all(|value| !b.contains(value))
    })?;
    let [a, b] = [a, b].map(|runs| listed(values(runs, field).into_iter().take(4)));
    Some(format!("{field}: {a} in the one, {b} in the other"))
}

/// What differs besides the program.
fn differences(a: &Report, b: &Report, [first, second]: [&str; 2]) -> Vec<String> {
    let mut out = vec![];
    let device = |d: &DeviceInfo| {
        [&d.name, &d.driver, &d.driver_info, &d.api_version].map(|part| part.trim()).join(" ").trim().to_owned()
    };
    let cpu = |d: &DeviceInfo| format!("{}, {} threads", d.cpu, d.threads);
    for (what, of) in [("device", &device as &dyn Fn(&DeviceInfo) -> String), ("processor", &cpu)] {
        let [of_a, of_b] = [of(&a.device), of(&b.device)];
        if of_a != of_b {
            out.push(format!(
                "The {what} differs: {of_a} in {first}, {of_b} in {second}. Ratios compare the machines as well."
            ));
        }
    }
    let meshes =
        |report: &'_ Report| if report.meshes.is_empty() { vec![report.input.clone()] } else { report.meshes.clone() };
    let size = |m: &MeshInfo| {
        let MeshInfo { vertices, targets, triangles, diagonal, tolerance, .. } = m;
        let moved = 100.0 * m.moved_mean;
        format!(
            "{vertices} vertices, {triangles} triangles, {targets} targets, each moving {moved:.2} %, diagonal \
             {diagonal}, tolerance {tolerance}"
        )
    };
    let others = meshes(b);
    for mesh in meshes(a) {
        if let Some(other) = others.iter().find(|other| other.name == mesh.name)
            && size(other) != size(&mesh)
        {
            let (name, mesh, other) = (&mesh.name, size(&mesh), size(other));
            out.push(format!(
                "The mesh “{name}” differs: {mesh} in {first}; {other} in {second}. Ratios are not of one work."
            ));
        }
    }
    out
}
