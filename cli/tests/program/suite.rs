//! `bench`: every cell of a suite and every configuration of a sweep is present, verified, in the JSON and on its page.

use crate::bench::in_page;
use crate::cli::{json, sample};
use crate::data;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Options small enough for seconds.
const SMALL: &str = "--device llvmpipe --vertices 2000 --targets 12 --frames 5 --time-limit 0.2 --heads 1,3 --quiet";

/// Returns the report of a suite, after the checks common to all suites.
fn suite(name: &str, args: &[&str], folder: &Path) -> Value {
    let out = json(&[&["bench", "--suite", name, "--json", "-", "--report", folder.to_str().unwrap()], args].concat());
    assert_eq!(out["suites"][0]["name"], name);
    let runs = out["runs"].as_array().unwrap();
    assert!(!runs.is_empty());
    assert_eq!(in_page(folder), out);
    for run in runs {
        assert!(run["verified"] == true && run["suite"] == name, "{run}");
        let most = if run["pose"] == "fixed16" { 2e-4 } else { 3e-6 };
        assert!(run["max_error_rel"].as_f64().unwrap() <= most, "{run}");
        let rounds = run["rounds"].as_array().unwrap();
        let n = run["cpu_ms"]["n"].as_u64().unwrap();
        assert!((3..=5).contains(&n) && rounds.len() as u64 <= n && !rounds.is_empty(), "{run}");
        let mesh = out["meshes"].as_array().unwrap().iter().find(|mesh| mesh["name"] == run["mesh"]);
        assert!(mesh.is_some_and(|mesh| run["targets"].as_u64() <= mesh["targets"].as_u64()), "{run}");
        // Poses of the path `cpu` are uploaded to be drawn; those of others are on the device.
        let drawn = run["update_and_draw_ms"].is_object() || (run["path"] == "cpu" && run["draw_ms"].is_number());
        assert_eq!(run["upload_ms"]["median"].is_number(), drawn && run["path"] == "cpu", "{run}");
        // If frames draw, the relevant time is the sum of update and draw.
        if let Some(both) = run["update_and_draw_ms"]["median"].as_f64() {
            let update = run["gpu_ms"]["min"].as_f64().unwrap();
            assert!(both > update && run["draw_ms"].as_f64().unwrap() > 0.0, "{run}");
        }
    }
    let rows = std::fs::read_to_string(folder.join("runs.csv")).unwrap().lines().count();
    assert!(rows > runs.len(), "{rows} lines for {} runs", runs.len());
    out
}

fn names(out: &Value, field: &str) -> BTreeSet<String> {
    out["runs"].as_array().unwrap().iter().map(|run| run[field].as_str().unwrap().to_owned()).collect()
}

#[test]
fn crowd_counts_targets_for_one_head_and_many() {
    let folder = tempfile::tempdir().unwrap();
    let out = suite("crowd", &SMALL.split(' ').collect::<Vec<_>>(), folder.path());
    let runs = out["runs"].as_array().unwrap();
    for path in ["feedback", "compute", "blocks", "cpu"] {
        for (heads, shared) in [(1, false), (3, false), (3, true)] {
            let own = runs.iter().filter(|r| {
                let point = r["cell"].as_str().unwrap().ends_with(" targets");
                point && r["technique"] == path && r["heads"] == heads && r["shared"] == shared
            });
            let targets: Vec<u64> = own.clone().map(|r| r["targets"].as_u64().unwrap()).collect();
            assert_eq!(targets, [2, 4, 6, 8, 10, 12], "{path}, {heads} heads, shared: {shared}");
            for run in own {
                assert_eq!(run["changed"], run["targets"], "all that are kept change: {run}");
                assert_eq!(run["gpu_ms"].is_null(), path == "cpu", "{run}");
            }
        }
    }
    // One animation moves the same bytes for three copies as for one; three animations move three times as many.
    let bytes = |heads: u64, shared: bool| {
        let at = |r: &&Value| r["technique"] == "compute" && r["targets"] == 12 && r["heads"] == heads;
        let run =
            runs.iter().find(|r| at(r) && r["shared"] == shared && r["cell"].as_str().unwrap().ends_with("targets"));
        run.unwrap()["bytes_moved"].as_f64().unwrap()
    };
    assert_eq!((bytes(3, true), bytes(3, false)), (bytes(1, false), 3.0 * bytes(1, false)));

    let split: Vec<&Value> = runs.iter().filter(|r| r["crowds"] == 3).collect();
    assert_eq!(split.len(), 2);
    for run in split {
        let whole = runs.iter().find(|r| r["cell"] == run["cell"] && r["crowds"] == 1).unwrap();
        for field in ["heads", "changed", "coefficients", "dirty_blocks"] {
            assert_eq!(run[field], whole[field], "{field}: not the same work");
        }
    }
}

#[test]
fn techniques_compete_in_every_cell() {
    let folder = tempfile::tempdir().unwrap();
    let out = suite("techniques", &SMALL.split(' ').collect::<Vec<_>>(), folder.path());
    let cells = out["suites"][0]["cells"].as_array().unwrap();
    let found: Vec<&str> = cells.iter().map(|c| c["name"].as_str().unwrap()).collect();
    let mut expected = vec![];
    for mesh in ["dense", "8% sparse"] {
        for change in ["all 12 changed", "8 of 12 changed", "4 non-zero of 12"] {
            expected.extend(["1 head", "3 heads"].map(|heads| format!("{mesh}, {change}, {heads}")));
        }
    }
    assert_eq!(found, expected);
    let techniques = names(&out, "technique");
    for name in ["feedback", "feedback rebuild at batch 1", "compute", "compute rebuild", "blocks", "cpu"] {
        assert!(techniques.contains(name), "{name}: {techniques:?}");
    }
    let runs = out["runs"].as_array().unwrap();
    for cell in cells {
        let own: Vec<&Value> = runs.iter().filter(|r| r["cell"] == cell["name"]).collect();
        assert!(own.len() >= 6, "{}: {} runs", cell["name"], own.len());
        assert!(own.iter().all(|run| run["alone"] == false && run["heads"] == cell["heads"]), "{own:?}");
        assert!(cell["fastest"] == cell["blocks"] || cell["fastest"] == cell["best_other"], "{cell}");
    }
}

#[test]
fn updates_pay_for_animated_weights_and_rebuilds_for_constant_ones_too() {
    let folder = tempfile::tempdir().unwrap();
    let sizes = "--device llvmpipe --vertices 300 --targets 6 --frames 3 --time-limit 0.01 --quiet";
    let paths = ["--paths", "blocks,compute", "--formats", "fast,float32"];
    let out = suite("constant", &[&sizes.split(' ').collect::<Vec<_>>(), &paths[..]].concat(), folder.path());
    let cells = out["suites"][0]["cells"].as_array().unwrap();
    let counts = [(0, 0), (6, 0), (0, 4), (2, 4), (0, 6)];
    assert_eq!(cells.len(), 2 * counts.len());
    for (cell, (held, animated)) in cells.iter().zip([counts, counts].concat()) {
        assert_eq!(cell["change"], format!("{held} constant, {animated} animated"));
        let bytes = |technique: &str| {
            let own = |r: &&Value| r["cell"] == cell["name"] && r["technique"] == technique;
            let run = out["runs"].as_array().unwrap().iter().find(own).unwrap();
            assert!(run["changed"] == animated && run["active"] == held + animated, "{run}");
            run["bytes_moved"].as_f64().unwrap()
        };
        let [compute, rebuild] = ["compute", "compute rebuild"].map(bytes);
        let blocks = ["blocks", "blocks fixed32"].map(bytes);
        assert!([compute, rebuild].iter().chain(&blocks).all(|bytes| (*bytes > 0.0) == (animated > 0)), "{cell}");
        assert_eq!(rebuild > compute, held > 0 && animated > 0, "{cell}: {rebuild} {compute}");
    }
}

#[test]
fn faces_of_four_rigs_are_one_scene() {
    let folder = tempfile::tempdir().unwrap();
    let sizes =
        "--device llvmpipe --vertices 800 --targets 20 --frames 3 --time-limit 0.01 --heads 5 --draws 1,3 --quiet";
    let report = || suite("faces", &sizes.split(' ').collect::<Vec<_>>(), folder.path());
    let out = report();
    let cells = out["suites"][0]["cells"].as_array().unwrap();
    let named: Vec<_> =
        cells.iter().map(|cell| cell["name"].as_str().unwrap().rsplit_once("8 heads").unwrap().1).collect();
    assert_eq!(named, ["", ", 3 draws"]);
    for cell in cells {
        assert_eq!((&cell["mesh"], &cell["heads"]), (&"4 rigs".into(), &8.into()), "as many of each rig");
    }
    assert_eq!(
        names(&out, "technique"),
        ["blocks fixed16 animated", "blocks fixed16 fast", "blocks fixed16 small", "compute rebuild", "direct"]
            .map(String::from)
            .into()
    );
    // All run the same frames, and every rebuild reads what is active of each face.
    let runs = out["runs"].as_array().unwrap();
    assert!(runs.iter().all(|run| run["active"] == runs[0]["active"] && run["targets"] == 68), "{out}");
    // Each draw of this path evaluates. Other tests run beside this one: one of three reports has to show it.
    let draw_ms = |out: &Value, draws: u64| {
        let mut runs = out["runs"].as_array().unwrap().iter();
        let run = runs.find(|run| run["technique"] == "direct" && run["draws"] == draws).unwrap();
        assert!(run["update_and_draw_ms"]["median"].as_f64() > run["draw_ms"].as_f64(), "{run}");
        run["draw_ms"].as_f64()
    };
    let three_take_longer = |out: &Value| draw_ms(out, 3) > draw_ms(out, 1);
    assert!(three_take_longer(&out) || (0..2).any(|_| three_take_longer(&report())));
}

#[test]
fn clips_come_from_the_input_or_from_the_data_sets() {
    let folder = tempfile::tempdir().unwrap();
    let dir = sample(folder.path());
    let brief =
        ["--device", "llvmpipe", "--frames", "4", "--time-limit", "0.2", "--paths", "compute,blocks,cpu", "--quiet"];
    let out = suite("clips", &[&[dir.as_str(), "--heads", "1,2"], &brief[..]].concat(), &folder.path().join("report"));
    let cells = out["suites"][0]["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 2);
    let techniques = ["blocks", "blocks fixed16", "compute", "compute rebuild", "cpu", "cpu fixed16"];
    assert_eq!(names(&out, "technique"), techniques.map(String::from).into());
    for run in out["runs"].as_array().unwrap() {
        let narrow = run["technique"].as_str().unwrap().ends_with(" fixed16");
        assert_eq!(run["pose"], if narrow { "fixed16" } else { "float32" }, "{run}");
        assert_eq!(run["accumulate"], if narrow { "exact" } else { "float" }, "{run}");
    }
    assert!(cells.iter().all(|cell| !cell["best_other"].as_str().unwrap().starts_with("blocks")), "{cells:?}");
    // All run the same frames.
    let changed = |heads: u64| {
        let own = out["runs"].as_array().unwrap().iter().filter(move |r| r["heads"] == heads);
        own.map(|r| r["changed"].as_f64().unwrap().to_bits()).collect::<BTreeSet<_>>().len()
    };
    assert_eq!((changed(1), changed(2)), (1, 1));

    let Some(set) = data::set("facecap_head_glb") else { return };
    let out = suite("clips", &[&[set.to_str().unwrap()], &brief[..]].concat(), &folder.path().join("real"));
    assert_eq!(out["suites"][0]["cells"][0]["name"], "facecap_head_glb, facecap_30fps, 1 head");
}
