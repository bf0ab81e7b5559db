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

/// The cells of a suite, in the order measured.
fn cells(out: &Value) -> Vec<&str> {
    let mut cells: Vec<&str> =
        out["runs"].as_array().unwrap().iter().map(|run| run["cell"].as_str().unwrap()).collect();
    cells.dedup();
    cells
}

#[test]
fn crowd_counts_targets_and_heads() {
    let folder = tempfile::tempdir().unwrap();
    let small: Vec<&str> = SMALL.split(' ').collect();
    let out = suite("crowd", &small, folder.path());
    let runs = out["runs"].as_array().unwrap();
    for path in ["feedback", "compute", "blocks", "cpu"] {
        for heads in [1, 3] {
            let sparse = |run: &Value| run["mesh"].as_str().unwrap().contains("% sparse, ");
            let own = runs.iter().filter(|r| r["technique"] == path && r["heads"] == heads && sparse(r));
            let targets: Vec<u64> = own.clone().map(|r| r["targets"].as_u64().unwrap()).collect();
            assert_eq!(targets, [2, 4, 6, 8, 10, 12], "{path}, {heads} heads");
            for run in own {
                assert_eq!(run["changed"], run["targets"], "all that are kept change: {run}");
                assert_eq!(run["gpu_ms"].is_null(), path == "cpu", "{run}");
            }
        }
    }
    // Crowds of a smaller face, planned by the processor and animated on the device.
    for heads in [1, 3] {
        let own = |r: &&Value| r["cell"].as_str().unwrap().contains("12 targets, 4 of 12") && r["heads"] == heads;
        let own: BTreeSet<&str> = runs.iter().filter(own).map(|run| run["technique"].as_str().unwrap()).collect();
        for name in ["blocks fixed16", "blocks fixed16 animated", "compute rebuild"] {
            assert!(own.contains(name), "{name}, {heads} heads: {own:?}");
        }
    }

    // One animation moves the same bytes for three copies as for one.
    let one = [&small[..], &["--paths", "blocks", "--formats", "fast", "--shared"]].concat();
    let shared = suite("crowd", &one, folder.path());
    let bytes = |heads: u64| {
        let at = |r: &&Value| r["technique"] == "blocks" && r["targets"] == 12 && r["heads"] == heads;
        shared["runs"].as_array().unwrap().iter().find(at).unwrap()["bytes_moved"].as_f64()
    };
    assert_eq!(bytes(3), bytes(1));
}

#[test]
fn techniques_compete_in_every_cell_with_weights_that_are_constant_or_none() {
    let folder = tempfile::tempdir().unwrap();
    let sizes = "--device llvmpipe --vertices 300 --targets 6 --frames 3 --time-limit 0.01 --heads 1,2 --quiet";
    let more = "--constant 0,2,9 --formats fast,float32 --poses float32,fixed16";
    let out = suite("techniques", &sizes.split(' ').chain(more.split(' ')).collect::<Vec<_>>(), folder.path());
    let runs = out["runs"].as_array().unwrap();
    let mut expected = BTreeSet::new();
    for mesh in ["dense", "8% sparse"] {
        let changes = [("all 6 changed", None), ("4 non-zero of 6", Some(0)), ("4 of 6 changed, 2 constant", Some(2))];
        for ((change, constant), heads) in changes.into_iter().flat_map(|c| ["1 head", "2 heads"].map(|h| (c, h))) {
            let cell = format!("{mesh}, {change}, {heads}");
            let own = |technique: &str| runs.iter().find(|r| r["cell"] == cell && r["technique"] == technique);
            let bytes = |technique: &str| {
                let run = own(technique).unwrap_or_else(|| panic!("{cell}: {technique}"));
                assert!(run["alone"] == false, "{run}");
                let active = constant.is_none_or(|constant| run["changed"] == 4 && run["active"] == constant + 4);
                assert!(active, "{run}");
                run["bytes_moved"].as_f64().unwrap()
            };
            let [compute, rebuild, ..] =
                ["compute", "compute rebuild", "blocks", "feedback", "feedback rebuild", "cpu"].map(bytes);
            assert!(
                constant.is_none_or(|constant| (rebuild > compute) == (constant > 0)),
                "{cell}: {rebuild} {compute}"
            );
            // The second head has other targets: on the device it plays a clip of its own.
            assert!(own("blocks fixed16 animated").is_some(), "{cell}");
            expected.insert(cell);
        }
    }
    let found: BTreeSet<String> = cells(&out).into_iter().map(str::to_owned).collect();
    assert!(found.is_superset(&expected), "{found:?}");
}

#[test]
fn faces_of_four_rigs_are_one_scene() {
    let folder = tempfile::tempdir().unwrap();
    let sizes =
        "--device llvmpipe --vertices 800 --targets 20 --frames 3 --time-limit 0.01 --heads 5 --draws 1,3 --quiet";
    let out = suite("faces", &sizes.split(' ').collect::<Vec<_>>(), folder.path());
    let scene = "4 rigs, a clip of 72 columns, 8 heads";
    assert_eq!(cells(&out), ["", ", 3 draws"].map(|draws| format!("{scene}{draws}")), "as many of each rig");
    let techniques = names(&out, "technique");
    for name in ["blocks fixed16", "blocks fixed16 animated", "compute rebuild", "direct"] {
        assert!(techniques.contains(name), "{name}: {techniques:?}");
    }
    // All run the same frames, and every rebuild reads what is active of each face.
    let runs = out["runs"].as_array().unwrap();
    assert!(runs.iter().all(|run| run["active"] == runs[0]["active"] && run["targets"] == 68), "{out}");
}

#[test]
fn clips_come_from_the_input() {
    let (folder, dir) = sample();
    let brief =
        ["--device", "llvmpipe", "--frames", "4", "--time-limit", "0.2", "--paths", "compute,blocks,cpu", "--quiet"];
    let out =
        suite("clips", &[&[dir.as_str(), "--heads", "1,2"], &brief[..]].concat(), &folder.0.path().join("report"));
    assert_eq!(cells(&out).len(), 2);
    let techniques = names(&out, "technique");
    for name in ["blocks", "blocks fixed16", "blocks fixed16 animated", "compute", "compute rebuild", "cpu fixed16"] {
        assert!(techniques.contains(name), "{name}: {techniques:?}");
    }
    for run in out["runs"].as_array().unwrap() {
        let narrow = run["technique"].as_str().unwrap().contains(" fixed16");
        assert_eq!(run["pose"], if narrow { "fixed16" } else { "float32" }, "{run}");
        assert_eq!(run["accumulate"], if narrow { "exact" } else { "float" }, "{run}");
    }
    // All run the same frames.
    let changed = |heads: u64| {
        let own = out["runs"].as_array().unwrap().iter().filter(move |r| r["heads"] == heads);
        own.map(|r| r["changed"].as_f64().unwrap().to_bits()).collect::<BTreeSet<_>>().len()
    };
    assert_eq!((changed(1), changed(2)), (1, 1));

    let Some(set) = data::set("facecap_head_glb") else { return };
    let out = suite("clips", &[&[set.to_str().unwrap()], &brief[..]].concat(), &folder.0.path().join("real"));
    assert_eq!(cells(&out)[0], "facecap_head_glb, facecap_30fps, 1 head");
}
