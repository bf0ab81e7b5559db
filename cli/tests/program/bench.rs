//! `bench`: verification before measurement, replayed clips, and runs without a Vulkan device.

use crate::cli::{HEAD, deltamorph, has, json, without_drivers};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// The report in the page of a folder, after the checks that all pages have to pass: it is that of report.json, and the
/// page loads nothing and links to nothing but the two files beside it.
pub fn in_page(folder: &Path) -> Value {
    let page = std::fs::read_to_string(folder.join("index.html")).unwrap();
    let (before, rest) = page.split_once("<script type=\"application/json\" id=\"report\">").unwrap();
    let (json, after) = rest.split_once("</script>").unwrap();
    let found: Value = serde_json::from_str(json).unwrap();
    assert_eq!(found, serde_json::from_slice::<Value>(&std::fs::read(folder.join("report.json")).unwrap()).unwrap());
    let own = [before, after].concat();
    for outside in ["src=", "@import", "url(", "import(", "fetch(", "XMLHttpRequest", "<link"] {
        assert!(!own.contains(outside), "{outside}");
    }
    assert!(own.contains("content=\"default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'\""));
    let links: Vec<&str> = own.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    assert_eq!(links, ["report.json", "runs.csv"]);
    found
}

#[test]
fn bench_verifies_measures_and_draws() {
    let folder = tempfile::tempdir().unwrap();
    let args = "bench --full --frames 3 --changed 4,all --json - --device llvmpipe --report";
    let out = json(&args.split(' ').chain([folder.path().to_str().unwrap()]).chain(HEAD).collect::<Vec<_>>());
    has(
        &out,
        &[
            ("", "schema version created command device skipped findings"),
            ("/bandwidth", "cpu_read_gb_s cpu_copy_gb_s device_copy_gb_s device_read_gb_s"),
            ("/input", "vertices targets triangles diagonal"),
            ("/runs/0/cpu_ms", "median mean stderr min max n"),
            ("/runs/0", "path mode batch_size changed coefficients active heads shared accumulate pose format passes"),
            ("/runs/0", "bytes_moved bytes_floor gpu_ms cpu_ms draw_ms max_error verified workload max_error_rel"),
            ("/runs/0", "normal_error_deg floor_ms floor_fraction slots batch_max"),
        ],
    );
    let runs = out["runs"].as_array().unwrap();
    assert!(runs.iter().all(|r| r["verified"] == true), "{out}");
    let of = |path: &str, batch: Value| runs.iter().filter(|r| r["path"] == path && r["batch_size"] == batch).count();
    let paths = ["feedback", "compute", "blocks", "cpu"];
    assert!(runs.iter().all(|r| paths.contains(&r["path"].as_str().unwrap())), "baselines are named, or left out");
    assert_eq!(of("feedback", 1.into()), 2);
    // Two formats, two counts of changed targets.
    assert_eq!((of("compute", 16.into()), of("compute", "all".into())), (2 * 2, 2 * 2));
    // Deltas in blocks with float32 and fixed32 poses, others with float32 poses.
    assert_eq!((of("blocks", "all".into()), of("cpu", "all".into())), (2 * 4, 2 * 6));
    for run in runs {
        let number = |field: &str| run[field].as_f64().unwrap();
        let batch = run["batch_size"].as_f64().unwrap_or(number("coefficients"));
        assert_eq!(number("passes"), (number("coefficients") / batch).ceil(), "{run}");
        assert!(number("bytes_moved") >= number("bytes_floor"), "{run}");
        assert!(number("max_error_rel") <= 3e-6, "{run}");
        assert_eq!(run["cpu_ms"]["n"], 3);
        // Dense incremental updates move as many bytes in each frame, so the share follows from the median time.
        if let Some(median) = run["gpu_ms"]["median"].as_f64().filter(|_| run["path"] == "compute") {
            let rates = ["device_read_gb_s", "device_copy_gb_s"].map(|name| out["bandwidth"][name].as_f64());
            let share = number("bytes_floor") / rates.into_iter().flatten().fold(0.0, f64::max) * 1e-6 / median;
            assert!((number("floor_fraction") / share - 1.0).abs() < 1e-9, "{share}: {run}");
        }
    }
    assert_eq!(in_page(folder.path()), out);
}

/// The page as Chromium draws it, if there is one.
fn drawn(folder: &Path) -> Option<String> {
    let options = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=5000", "--dump-dom"];
    let page = format!("file://{}", folder.join("index.html").display());
    let browser = Command::new("chromium").args(options).arg(page).output();
    let Ok(browser) = browser else {
        eprintln!("LEFT OUT: there is no chromium to draw the page");
        return None;
    };
    Some(String::from_utf8(browser.stdout).unwrap())
}

#[test]
fn the_main_comparison_is_brief_and_prints_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report");
    let args = "bench --device llvmpipe --frames 20 --time-limit 0.05 --report";
    let out = deltamorph(&args.split(' ').chain([report.to_str().unwrap()]).chain(HEAD).collect::<Vec<_>>());
    let [said, warnings] = [out.stdout, out.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert!(out.status.success(), "{warnings}");
    for (group, words) in ["1 of 2: 8 of 12 targets changed, 1 head: ", "2 of 2: 12 of 12 targets changed, 1 head: "]
        .into_iter()
        .zip(["configurations in 10 rounds; up to ", " s left"])
    {
        assert!(warnings.lines().any(|line| line.starts_with(group)) && warnings.contains(words), "{warnings}");
    }
    let text = std::fs::read_to_string(report.join("report.json")).unwrap();
    let runs = serde_json::from_str::<Value>(&text).unwrap()["runs"].as_array().unwrap().clone();
    let of = |path: &str, format: &str| -> Vec<String> {
        let own = runs.iter().filter(|r| r["path"] == path && r["format"] == format && r["changed"] == 12);
        own.map(|r| r["batch_size"].to_string()).collect()
    };
    assert_eq!(of("compute", "snorm16"), ["1", "2", "4", "8", "16", "\"all\""]);
    assert_eq!(of("feedback", "float32")[..3], ["1", "2", "4"]);
    assert_eq!((of("blocks", "fast").len(), of("cpu", "small").len()), (1, 1));
    for run in &runs {
        // Configurations ran in turns, and each says how far its rounds agree.
        let rounds: Vec<f64> = run["rounds"].as_array().unwrap().iter().map(|r| r.as_f64().unwrap()).collect();
        assert!(rounds.len() > 1 && run["rounds_ratio"].as_f64() >= Some(1.0) && run["verified"] == true, "{run}");
    }
    let uneven = runs.iter().filter(|run| run["rounds_ratio"].as_f64() > Some(1.5)).count();
    assert_eq!(said.matches("× UNEVEN").count(), uneven, "{said}");
    assert_eq!(said.contains(&format!("The rounds of {uneven} of {}", runs.len())), uneven > 0, "{said}");
    assert_eq!(said.matches("ms/frame").count(), 2, "a table for each group: {said}");
    let Some(page) = drawn(&report) else { return };
    let body = page.rsplit_once("</script>").unwrap().1;
    assert_eq!(body.matches("<tr").count(), 1 + runs.len(), "a row for each run, below the headings: {body}");
    for plot in ["8 of 12 targets changed, 1 head: batches", "12 of 12 targets changed, 1 head: batches"] {
        assert!(body.matches(&format!("<figcaption>{plot}</figcaption>")).count() == 2, "{plot}: {body}");
    }
    assert!(body.contains("1 head: against targets changed") && body.contains("report.json</a>"), "{body}");
}

#[test]
fn without_a_vulkan_device_the_cpu_path_takes_over_and_says_so() {
    let out = without_drivers(&[&["bench", "--frames", "2", "--no-report", "--json", "-"], &HEAD[..]].concat());
    let warnings = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success(), "{warnings}");
    assert!(warnings.contains("continuing with the path 'cpu'"), "{warnings}");
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(report["runs"].as_array().unwrap().iter().all(|r| r["path"] == "cpu" && r["verified"] == true));
    assert!(report["skipped"][0]["reason"].as_str().unwrap().contains("'cpu' needs none"), "{report}");
}
