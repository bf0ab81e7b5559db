//! Describes the measurement to a reader who has never seen the project.

use super::figures::partition;
use crate::bench::record::{Bandwidth, DeviceInfo, Report, RunRecord, SuiteRecord};
use crate::input::MeshInfo;
use crate::table::{listed, percent, sig3, thousands};
use std::slice::from_ref;

/// Longest list of names; above, only their number is given.
const MOST_NAMES: usize = 8;

/// Describes the measurements of `suite`, or of all: a sentence, and details with headings.
pub fn about(report: &Report, suite: Option<&SuiteRecord>) -> (String, Vec<(&'static str, Vec<String>)>) {
    let runs: Vec<&RunRecord> = report.runs_of(suite).collect();
    let sentence = format!(
        "How long does it take to give a face its next expression? Measured is the time per frame to move the points \
         (vertices) of {}, in {} configuration{}, on {}. A morph target says how far each point moves in one expression; \
         weights mix the targets.",
        meshes(report, &runs),
        thousands(runs.len()),
        if runs.len() == 1 { "" } else { "s" },
        device(&report.device),
    );
    let own = if report.meshes.is_empty() { from_ref(&report.input) } else { &report.meshes };
    let facts = vec![("Meshes", own.iter().map(mesh).collect()), ("Memory bandwidth", bandwidth(&report.bandwidth))];
    (sentence, facts)
}

/// The machine in words: device and driver if there is one, and the processor.
fn device(device: &DeviceInfo) -> String {
    let cpu = match (device.cpu.as_str(), device.threads) {
        ("", _) => String::new(),
        (cpu, 0) => format!("the processor {cpu}"),
        (cpu, 1) => format!("the processor {cpu} (1 thread)"),
        (cpu, n) => format!("the processor {cpu} ({n} threads)"),
    };
    let kind = match device.kind.as_str() {
        "none" => return format!("{cpu} alone, without a Vulkan device"),
        "cpu" => "a software driver, where the processor plays the GPU".to_owned(),
        "integrated" => "an integrated GPU".into(),
        kind => format!("a {kind} GPU"),
    };
    let api = if device.api_version.is_empty() { String::new() } else { format!("Vulkan {}", device.api_version) };
    let driver = [device.driver.as_str(), &device.driver_info, &api].join(" ");
    let driver = if driver.trim().is_empty() { String::new() } else { format!("; driver: {}", driver.trim()) };
    let cpu = if cpu.is_empty() { cpu } else { format!(", and {cpu}") };
    format!("{} ({kind}{driver}){cpu}", device.name)
}

fn mesh(m: &MeshInfo) -> String {
    let [vertices, triangles] = [m.vertices, m.triangles].map(thousands);
    let (name, targets, moved, origin) = (&m.name, m.targets, percent(m.moved_mean), &m.origin);
    format!("{name}: {vertices} vertices, {triangles} triangles, {targets} targets, each moves {moved}; {origin}")
}

fn bandwidth(b: &Bandwidth) -> Vec<String> {
    let rate = |v: Option<f64>| v.map_or("not measured".to_owned(), |v| format!("{} GB/s", sig3(v)));
    let line = |what, copy, read| format!("{what}: copy {}, read {}", rate(copy), rate(read));
    vec![line("device", b.device_copy_gb_s, b.device_read_gb_s), line("processor", b.cpu_copy_gb_s, b.cpu_read_gb_s)]
}

fn meshes(report: &Report, runs: &[&RunRecord]) -> String {
    let own = |name: &str| report.meshes.iter().find(|mesh| mesh.name == name).unwrap_or(&report.input);
    let names = partition(runs, |run| run.mesh.clone());
    let words = |mesh: &MeshInfo| {
        format!("“{}” ({} vertices, {} morph targets)", mesh.name, thousands(mesh.vertices), mesh.targets)
    };
    match names.len() {
        0 => words(&report.input),
        n if n > MOST_NAMES => format!("{n} meshes"),
        _ => listed(names.iter().map(|(name, _)| words(own(name)))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::synthetic;

    #[test]
    fn a_stranger_learns_what_was_measured() {
        let (told, _) = about(&synthetic::report(), None);
        let part = "points (vertices) of “head” (43,788 vertices, 72 morph targets), in 330 configurations, on Example GPU \
                    <1> (a software driver, where the processor plays the GPU)";
        assert!(told.contains(part), "{told}");
        assert!(about(&Report::default(), None).0.contains("0 configurations"));
    }

    #[test]
    fn machines_have_names() {
        let info = |kind: &str, cpu: &str, threads| DeviceInfo {
            name: "X1".into(),
            kind: kind.into(),
            driver: "D".into(),
            driver_info: "2.0".into(),
            cpu: cpu.into(),
            threads,
            ..DeviceInfo::default()
        };
        let told =
            [info("discrete", "C", 8), info("integrated", "", 1), info("none", "C", 1)].map(|info| device(&info));
        assert_eq!(
            told,
            [
                "X1 (a discrete GPU; driver: D 2.0), and the processor C (8 threads)",
                "X1 (an integrated GPU; driver: D 2.0)",
                "the processor C (1 thread) alone, without a Vulkan device"
            ]
        );
    }
}
