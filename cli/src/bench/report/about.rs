//! Describes the measurement to a reader who has never seen the project.

use super::figures::partition;
use crate::bench::record::{Bandwidth, DeviceInfo, Report, RunRecord, SuiteRecord};
use crate::input::MeshInfo;
use crate::table::{count, listed, percent, sig3, thousands};
use deltamorph::BatchSize;
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
    let facts = vec![
        ("What changes", changes(&runs)),
        ("What was tried", varied(&runs)),
        ("How often", vec![frames(&runs)]),
        ("What was verified", vec![verified(&runs)]),
        ("Meshes", own.iter().map(mesh).collect()),
        ("Memory bandwidth", bandwidth(&report.bandwidth)),
    ];
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

fn changes(runs: &[&RunRecord]) -> Vec<String> {
    let random: Vec<f64> = runs.iter().filter(|run| run.workload == "random").map(|run| run.changed).collect();
    let clips = partition(runs, |run| run.workload.clone()).into_iter().map(|(name, _)| name);
    let clips: Vec<String> = clips.filter(|name| name != "random").map(|name| format!("“{name}”")).collect();
    let random = (!random.is_empty()).then(|| match span(random.iter().copied()).as_str() {
        "1" => "the weight of 1 target, drawn at random in every frame".to_owned(),
        range => format!("the weights of {range} targets, drawn at random in every frame"),
    });
    let clip = (!clips.is_empty()).then(|| match clips.len() {
        n if n > MOST_NAMES => format!("what {n} captured clips change"),
        1 => format!("what the clip {} changes", clips[0]),
        _ => format!("what the clips {} change", listed(clips)),
    });
    random.into_iter().chain(clip).collect()
}

fn frames(runs: &[&RunRecord]) -> String {
    let timed: Vec<f64> = runs.iter().filter_map(|run| Some(run.time()?.n as f64)).collect();
    let several = |run: &&&RunRecord| run.interleaved() && run.rounds.len() > 1;
    let rounds: Vec<f64> = runs.iter().filter(several).map(|run| run.rounds.len() as f64).collect();
    match (timed.is_empty(), rounds.is_empty()) {
        (true, _) => "nothing was timed".into(),
        (_, true) => format!("each configuration for {} frames, one configuration after the other", span(timed)),
        _ => {
            let rounds = span(rounds);
            format!("each configuration for {} frames, in {rounds} rounds that took turns with the others", span(timed))
        }
    }
}

/// The parameters that differ among runs, with all their values.
fn varied(runs: &[&RunRecord]) -> Vec<String> {
    type Name = fn(&RunRecord) -> String;
    let names: [(&str, Name); 6] = [
        ("method (update path)", |run| run.path.clone()),
        ("variant", |run| if run.technique == run.path { String::new() } else { run.technique.clone() }),
        ("last pose kept, or rebuilt (mode)", |run| run.mode.clone()),
        ("how movements are stored (delta format)", |run| run.format.clone()),
        ("how results are stored (pose format)", |run| run.pose.clone()),
        ("whether faces share one animation", |run| if run.shared { "shared" } else { "each its own" }.into()),
    ];
    let mut told = vec![];
    for (what, name) in names {
        let values: Vec<String> =
            partition(runs, name).into_iter().map(|(value, _)| value).filter(|value| !value.is_empty()).collect();
        match values.len() {
            0 | 1 => {}
            n if n > MOST_NAMES => told.push(format!("{what}: {n} of them")),
            _ => told.push(format!("{what}: {}", values.join(", "))),
        }
    }
    let batches = runs.iter().map(|run| match run.batch_size {
        BatchSize::Targets(n) => f64::from(n),
        BatchSize::All => f64::INFINITY,
    });
    for (what, range) in [
        ("targets at a time (batch size)", span(batches)),
        ("faces", span(runs.iter().map(|run| f64::from(run.heads)))),
        ("pose buffers per face", span(runs.iter().map(|run| f64::from(run.slots)))),
    ] {
        if range.contains(' ') {
            told.push(format!("{what}: {range}"));
        }
    }
    if told.is_empty() {
        told.push("one way to do it".into());
    }
    told
}

fn verified(runs: &[&RunRecord]) -> String {
    let found = match (runs.iter().filter(|run| !run.verified).count(), runs.len()) {
        (0, _) => "all agree, within what the method promises".into(),
        (1, all) => format!("1 of {all} is wrong; it is marked, and has no time"),
        (n, all) => format!("{n} of {all} are wrong; they are marked, and have no time"),
    };
    format!("each result, before it was timed and after, against a full evaluation in float64: {found}")
}

/// "4", "1, 4 and 8", "1 to 14 and all": few values one by one, many as a range; infinity is all.
fn span(values: impl IntoIterator<Item = f64>) -> String {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let all = values.pop_if(|last| last.is_infinite()).map(|_| "all".to_owned());
    match (values.first(), values.last()) {
        (Some(first), Some(last)) if values.len() > 4 => {
            listed([format!("{} to {}", count(*first), count(*last))].into_iter().chain(all))
        }
        _ => listed(values.into_iter().map(count).chain(all)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::synthetic;

    #[test]
    fn a_stranger_learns_what_was_measured() {
        let text = |report: &Report, suite| {
            let (sentence, facts) = about(report, suite);
            facts
                .into_iter()
                .fold(sentence, |text, (heading, facts)| format!("{text}\n{heading}: {}", facts.join("; ")))
        };
        let told = text(&synthetic::report(), None);
        for part in [
            "points (vertices) of “head” (43,788 vertices, 72 morph targets), in 330 configurations, on Example GPU \
             <1> (a software driver, where the processor plays the GPU)",
            "changes: the weights of 4, 16, 36 and 72 targets, drawn at random in every frame; what the clip \
             “speech_30fps” changes",
            "tried: method (update path): feedback, compute, cpu; how movements are stored (delta format): float32, \
             snorm16; targets at a time (batch size): 1 to 16 and all",
            "often: each configuration for 7 frames",
            "2 of 330 are wrong",
        ] {
            assert!(told.contains(part), "{part}: {told}");
        }
        let suite = synthetic::suite();
        let told = text(&suite, suite.suites.first());
        assert!(told.contains("in 2 and 3 rounds that took turns") && told.contains("1 of 5 is wrong"), "{told}");
        let none = text(&Report::default(), None);
        assert!(none.contains("0 configurations") && none.contains("nothing was timed"), "{none}");
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

    #[test]
    fn few_values_are_told_and_many_are_a_range() {
        let spans = [&[3.0][..], &[8.0, 1.0, 8.0], &[1.0, 2.0, 3.0, 4.0, 5.0], &[1.0, f64::INFINITY], &[]]
            .map(|values| span(values.iter().copied()));
        assert_eq!(spans, ["3", "1 and 8", "1 to 5", "1 and all", ""]);
    }
}
