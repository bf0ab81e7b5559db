//! The command line: printed output, written files and exit codes.

use crate::cli::{HEAD, clip, deltamorph, json, ok, sample};
use serde_json::Value;
use std::path::Path;

#[test]
fn devices_lists_both_drivers_and_why_a_path_is_missing() {
    let devices = json(&["devices", "--json", "-"]);
    let find = |name: &str| {
        let all = devices["devices"].as_array().expect("a list");
        all.iter().find(|d| d["name"].as_str().unwrap().contains(name)).unwrap_or_else(|| panic!("no {name}")).clone()
    };
    let path = |device: &Value, name: &str| {
        device["paths"].as_array().unwrap().iter().find(|p| p["path"] == name).unwrap().clone()
    };
    let lavapipe = find("llvmpipe");
    assert_eq!(path(&lavapipe, "feedback")["available"], true);
    let feedback = path(&find("SwiftShader"), "feedback");
    assert_eq!(feedback["available"], false);
    assert!(feedback["reason"].as_str().unwrap().contains("VK_EXT_transform_feedback"), "{feedback}");
    assert_eq!(path(&find("SwiftShader"), "compute")["available"], true);
}

/// Each command that updates poses accepts baselines by name; by default, `bench` omits them.
#[test]
fn commands_agree_on_every_path() {
    let (folder, dir) = sample();
    let (clip, path) = (&clip(&dir), |name: &str| folder.at(name));
    let positions = |file: &str| -> Vec<f64> {
        let text = std::fs::read_to_string(file).unwrap();
        let vertices = text.lines().filter_map(|line| line.strip_prefix("v "));
        vertices.flat_map(str::split_whitespace).map(|word| word.parse().unwrap()).collect()
    };
    let farthest =
        |a: &str, b: &str| positions(a).iter().zip(positions(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let set = ["--set", "eyeBlinkLeft=0.7,eyeSquintLeft=-0.4,eyeWideLeft=1.5"];
    let reference = path("reference.obj");
    ok(&[&["apply", &dir, "-o", &reference, "--path", "cpu", "--format", "float32"], &set[..]].concat());
    // Scatter is packed, and its weights are on a grid.
    for (name, format, tolerance) in
        [("compute", "float32", 1e-5), ("scatter", "small", 5e-3), ("direct", "float32", 1e-5)]
    {
        let (out, here) = (path("out.obj"), ["--path", name, "--device", "llvmpipe", "--json", "-"]);
        let applied = json(&[&["apply", &dir, "-o", &out], &set[..], &here].concat());
        assert_eq!((applied["path"].as_str(), applied["format"].as_str()), (Some(name), Some(format)));
        assert!(applied["rounding_error_rel"].as_f64().unwrap() < 1e-6, "{applied}");
        let far = farthest(&out, &reference);
        assert!(far <= tolerance, "{name}: {far}");
    }
    let baselines = ["vertex-store", "scatter", "direct", "direct-attributes", "texture"];
    let bench = ["bench", "--paths", &baselines.join(","), "--changed", "2", "--frames", "2", "--no-report"];
    let out = json(&[&bench[..], &["--device", "llvmpipe", "--json", "-"], &HEAD].concat());
    let runs = out["runs"].as_array().unwrap();
    assert!(runs.iter().all(|run| run["verified"] == true && run["draw_ms"].as_f64().is_some()), "{out}");
    assert!(baselines.iter().all(|name| runs.iter().any(|run| run["path"] == *name)), "{out}");
    // Steps from one frame to another reach the pose of the second.
    let at_once = path("at_once.obj");
    for more in [&[][..], &["--from-frame", "0", "--batch-size", "1"], &["--from-frame", "23", "--batch-size", "1"]] {
        let out = if more.is_empty() { &at_once } else { &path("stepped.obj") };
        ok(&[&["apply", &dir, "-o", out, "--weights", clip, "--frame", "20", "--path", "compute"], more].concat());
        assert!(farthest(out, &at_once) < 1e-4 && farthest(out, &reference) > 0.1, "{more:?}");
    }
    let rows = json(&["devices", "--json", "-"])["devices"][0]["paths"].as_array().unwrap().len();
    assert_eq!(rows, 9, "a line for each path");
}

#[test]
fn heads_that_do_not_fit_leave_the_rest_standing() {
    let heads = ["bench", "--vertices", "2000", "--targets", "3", "--frames", "2", "--changed", "all"];
    let more = ["--paths", "compute", "--batch-sizes", "2", "--heads", "1,1000000", "--no-report", "--json", "-"];
    let out = json(&[&heads[..], &more, &["--poses", "float32"]].concat());
    assert_eq!(out["runs"].as_array().unwrap().len(), 2, "{out}");
    assert!(out["skipped"].as_array().unwrap().iter().any(|s| s["what"].as_str().unwrap().contains("1000000 heads")));
}

#[test]
fn a_packed_file_is_an_input_everywhere() {
    let (folder, dir) = sample();
    let path = |name: &str| folder.at(name);
    let file = path("head.dmorph");
    let packed = json(&["pack", &dir, "-o", &file, "--json", "-"]);
    assert_eq!((packed["schema"].as_u64(), packed["format"].as_str()), (Some(1), Some("small")), "{packed}");
    assert_eq!((packed["vertices"].as_u64(), packed["targets"].as_u64()), (Some(1200), Some(12)));
    assert_eq!(packed["file_bytes"].as_u64(), Some(Path::new(&file).metadata().unwrap().len()));
    let error = packed["position_error_rel"].as_f64().unwrap();
    assert!(error > 0.0 && error <= 1e-5, "{packed}");
    let poses = packed["pose_formats"].as_array().unwrap();
    assert_eq!(poses.iter().map(|p| &p["vertex_bytes"]).collect::<Vec<_>>(), [24, 24, 12, 12]);

    // `info` shows the error measured against the files.
    let info = json(&["info", &file, "--json", "-"]);
    let small = info["formats"].as_array().unwrap().iter().find(|f| f["name"] == "small").unwrap();
    assert_eq!(small["position_error_rel"], packed["position_error_rel"]);
    assert_eq!(small["delta_bytes"], packed["delta_bytes"]);
    assert_eq!(info["input"]["vertices"], 1200);
    assert_eq!(info["pose_deltas"], "small");
    for (info, packed) in info["pose_formats"].as_array().unwrap().iter().zip(poses) {
        assert_eq!(info["grid"], packed["grid"]);
        // The file holds the largest error of a target, and not those of each vertex.
        assert!(info["packing_error_rel"].as_f64() >= packed["packing_error_rel"].as_f64(), "{info} {packed}");
    }
    // The largest weight is an option of poses, independent of the packed file.
    let soak = ["soak", &file, "--frames", "9", "--path", "cpu", "--pose", "fixed16", "--weight-max", "2"];
    ok(&soak);

    // The same pose as from the folder in the same format, and the same faces.
    let weights = ["--weights", &clip(&dir), "--frame", "20", "--json", "-"];
    let (a, b) = (path("a.obj"), path("b.obj"));
    let from_file = json(&[&["apply", &file, "-o", &a], &weights[..]].concat());
    assert_eq!(from_file["format"], "small", "the format of the file is the default");
    json(&[&["apply", &dir, "-o", &b, "--format", "small"], &weights[..]].concat());
    assert_eq!(std::fs::read_to_string(&a).unwrap(), std::fs::read_to_string(&b).unwrap());
    assert!(std::fs::read_to_string(&a).unwrap().contains("\nf "));
    // Another format packs the decoded deltas.
    let other = ["apply", &file, "-o", &a, "--path", "compute", "--device", "llvmpipe", "--format", "float32"];
    assert_eq!(json(&[&other[..], &weights[..]].concat())["format"], "float32");

    let bench = ["bench", &file, "--paths", "cpu,blocks", "--changed", "4", "--frames", "2", "--no-report"];
    let out = deltamorph(&[&bench[..], &["--json", "-"]].concat());
    assert!(String::from_utf8_lossy(&out.stderr).contains("not against the original files"));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let runs = report["runs"].as_array().unwrap();
    assert!(!runs.is_empty() && runs.iter().all(|r| r["verified"] == true), "{report}");

    // A packed file can be packed again, in another format.
    let again = path("again.dmorph");
    let text = ok(&["pack", &file, "-o", &again, "--format", "fast", "--block-size", "128"]);
    assert!(text.contains("again.dmorph: 1,200 vertices") && text.contains("4 in steps of 2^-"), "{text}");
}
