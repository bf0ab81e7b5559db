//! A made-up report with the shape of a real one, for tests.

use super::record::{Bandwidth, DeviceInfo, Report, RunRecord, Skipped, SuiteRecord};
use super::stats::Stats;
use crate::input::MeshInfo;
use deltamorph::BatchSize::{self, All, Targets};

const TARGETS: f64 = 72.0;

/// A run in which each coefficient and each pass take the given number of ms.
fn run(
    path: &'static str,
    format: &'static str,
    batch: BatchSize,
    changed: f64,
    [coefficient, pass]: [f64; 2],
) -> RunRecord {
    let coefficients = (2.0 * changed).min(TARGETS);
    let passes = match batch {
        Targets(n) => (coefficients / f64::from(n)).ceil(),
        All => 1.0,
    };
    let ms = 0.15 + coefficients * coefficient + passes * pass;
    let stats = |ms: f64| Stats::of(&[0.97, 1.0, 1.01, 0.99, 1.06, 0.98, 1.02].map(|s| ms * s));
    RunRecord {
        cell: format!("{changed} of 72 targets changed, 1 head"),
        technique: path.into(),
        mesh: "head".into(),
        targets: 72,
        path,
        mode: "incremental",
        batch_size: batch,
        batch_max: (path == "feedback").then_some(if format == "float32" { 7 } else { 14 }),
        workload: "random".into(),
        changed,
        coefficients,
        active: TARGETS,
        heads: 1,
        accumulate: "float",
        pose: "float32",
        format,
        slots: 2,
        passes,
        gpu_ms: stats(ms).filter(|_| path != "cpu"),
        cpu_ms: stats(ms + 0.4),
        draw_ms: (path != "cpu").then_some(0.8),
        floor_ms: Some(0.1),
        floor_fraction: Some(0.1 / ms),
        bytes_moved: 1024.0,
        max_error_rel: Some(1.2e-7),
        verified: true,
        ..RunRecord::default()
    }
}

/// Three paths, two formats, several numbers of changed targets, a clip; two runs are wrong.
pub fn report() -> Report {
    let mut runs = vec![];
    for changed in [TARGETS, 4.0, 16.0, 36.0] {
        for (path, format, batches, costs) in [
            ("feedback", "float32", 1..=15, [0.068, 0.65]),
            ("feedback", "snorm16", 1..=16, [0.042, 0.64]),
            ("compute", "float32", 1..=17, [0.055, 0.42]),
            ("compute", "snorm16", 1..=17, [0.031, 0.41]),
            ("cpu", "float32", 17..=17, [0.12, 1.0]),
        ] {
            let batches = batches.map(|n| if n == 17 { All } else { Targets(n) });
            runs.extend(batches.map(|batch| run(path, format, batch, changed, costs)));
        }
    }
    let clip: Vec<RunRecord> = runs.iter().filter(|r| r.changed == 16.0).cloned().collect();
    let cell = || "clip speech_30fps, 1 head".to_owned();
    runs.extend(clip.into_iter().map(|r| RunRecord {
        cell: cell(),
        workload: "speech_30fps".into(),
        changed: 2.71,
        ..r
    }));
    for wrong in [7, 20] {
        let run = &mut runs[wrong];
        run.verified = false;
        (run.gpu_ms, run.cpu_ms) = (None, None);
        run.problem = Some("vertex 17: 0.02 from the reference, the bound is 1e-6".into());
        run.max_error_rel = Some(1e-3);
    }
    Report {
        schema: 1,
        created: 1_769_860_800,
        command: "deltamorph bench --paths feedback,compute,cpu --formats float32,snorm16 --changed 4,16,36,all".into(),
        device: DeviceInfo { name: "Example GPU <1>".into(), kind: "cpu".into(), ..DeviceInfo::default() },
        input: MeshInfo { name: "head".into(), vertices: 43_788, targets: 72, ..MeshInfo::default() },
        bandwidth: Bandwidth { cpu_read_gb_s: Some(14.1), device_copy_gb_s: Some(11.4), ..Bandwidth::default() },
        runs,
        skipped: vec![Skipped { what: "feedback, batch all".into(), reason: "16 attributes hold 14 targets".into() }],
        ..Report::default()
    }
}

/// A run of `technique` in a suite, with these times in its rounds.
pub fn technique(technique: &'static str, rounds: &[f64]) -> RunRecord {
    let times = Stats::of(rounds);
    RunRecord {
        suite: "techniques",
        cell: "dense <1>, 1 head".into(),
        rounds: rounds.to_vec(),
        update_and_draw_ms: times.filter(|_| technique != "cpu"),
        cpu_ms: times,
        ..run(technique, "fast", All, TARGETS, [0.01, 0.1])
    }
}

/// The report of a suite with one cell and a wrong run.
pub fn suite() -> Report {
    let mut wrong = technique("feedback", &[0.1]);
    wrong.verified = false;
    wrong.problem = Some("off by a mile".into());
    let runs = vec![
        technique("blocks", &[1.0, 10.0, 1.0]),
        technique("compute", &[2.0, 20.0, 3.0]),
        technique("direct", &[40.0, 500.0]),
        technique("cpu", &[0.1, 0.1, 0.1]),
        wrong,
    ];
    let suites = vec![SuiteRecord { name: "techniques", title: "Every technique" }];
    Report { runs, suites, ..report() }
}
