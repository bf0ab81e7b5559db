//! The commands that run many frames: `play` and `soak`.

use crate::cli::{HEAD, has, json, sample, without_drivers};
use serde_json::Value;

#[test]
fn play_keeps_its_contract_on_every_path() {
    let (_folder, dir) = sample();
    let mut moved = vec![];
    for how in [
        &["--path", "cpu"][..],
        &["--path", "cpu", "--format", "float32"],
        &["--path", "cpu", "--format", "small", "--pose", "fixed16"],
        &["--device", "llvmpipe", "--pose", "fixed32", "--slots", "3", "--format", "small"],
        &["--device", "SwiftShader", "--pose", "fixed16", "--error-budget", "1e-4d"],
        &["--device", "llvmpipe", "--path", "compute", "--batch-size", "4"],
    ] {
        let out = json(&[&["play", &dir, "--every", "5", "--json", "-"], how].concat());
        has(
            &out,
            &[
                ("", "schema device input frames summary"),
                ("/summary", "frames changed_mean bytes_moved_mean gpu_ms_median max_error max_error_rel"),
                ("/summary", "path format accumulate pose slots error_budget bound gpu_ms_mean cpu_us_median"),
                ("/summary", "dense_bytes_mean bytes_share normal_error_deg packing_error_rel weights_error_rel"),
                ("/summary", "rounding_error_rel"),
                (
                    "/frames/0",
                    "frame changed active dirty_blocks rebuilt_blocks passes bytes_moved gpu_ms cpu_us max_error",
                ),
            ],
        );
        let frames = out["frames"].as_array().unwrap();
        assert_eq!((&out["schema"], frames.len()), (&1.into(), 24));
        let checked: Vec<usize> = (0..24).filter(|f| frames[*f]["max_error"].is_number()).collect();
        assert_eq!(checked, [0, 5, 10, 15, 20, 23], "every fifth, and the last");
        for (i, frame) in frames.iter().enumerate() {
            assert_eq!(
                (frame["frame"].as_u64(), frame["gpu_ms"].is_number()),
                (Some(i as u64), how[0] != "--path" || how[1] == "compute")
            );
            // The first frame writes the neutral face, too.
            let idle = i > 0 && frame["changed"] == 0 && out["summary"]["error_budget"] == 0.0;
            assert!(!idle || frame["bytes_moved"] == 0, "{frame}");
        }
        let summary = &out["summary"];
        let sum: u64 = frames.iter().map(|f| f["bytes_moved"].as_u64().unwrap()).sum();
        assert!((summary["bytes_moved_mean"].as_f64().unwrap() - sum as f64 / 24.0).abs() < 1.0);
        let changed = |f: &Value| f["changed"].as_u64().unwrap();
        let dense: u64 = frames.iter().filter(|f| changed(f) > 0).map(|f| (changed(f) + 2) * 24 * 1200).sum();
        assert!((summary["dense_bytes_mean"].as_f64().unwrap() - dense as f64 / 24.0).abs() < 1.0);
        let [error, bound] = ["rounding_error_rel", "bound_rel"].map(|field| summary[field].as_f64().unwrap());
        let is_patient = summary["error_budget"] != 0.0;
        // No bound is kept on the drift of dense float32 poses.
        let is_bounded = summary["format"] != "float32";
        assert!((is_patient || error <= if is_bounded { bound } else { 3e-6 }) && bound < 2e-4, "{summary}");
        moved.push(summary["bytes_share"].as_f64().unwrap());
    }
    assert!(moved[0] < 0.5 * moved[1], "blocks move less than whole poses: {moved:?}");
    assert!(moved[2] < 0.85 * moved[0], "poses of half the size move less: {moved:?}");
}

#[test]
fn a_device_plays_and_plans_a_clip() {
    let (_folder, dir) = sample();
    let play =
        |more: &[&str]| json(&[&["play", &dir, "--device", "llvmpipe", "--every", "5", "--json", "-"], more].concat());
    let (out, set) = (play(&["--animated"]), play(&["--pose", "fixed32"]));
    for (frame, set) in out["frames"].as_array().unwrap().iter().zip(set["frames"].as_array().unwrap()) {
        assert_eq!((&frame["changed"], &frame["active"]), (&set["changed"], &set["active"]));
        assert_eq!(frame["max_error"].is_number(), set["max_error"].is_number());
        assert!(frame["gpu_ms"].is_number() && frame["cpu_us"].is_number(), "{frame}");
        assert!(frame["dirty_blocks"].is_null() && frame["bytes_moved"].is_null(), "what the device planned: {frame}");
    }
    let (summary, set) = (&out["summary"], &set["summary"]);
    assert_eq!((&summary["animated"], &set["animated"]), (&true.into(), &false.into()));
    assert_eq!((&summary["path"], &summary["accumulate"]), (&"blocks".into(), &"exact".into()));
    // The requested frames are shown, up to rounding of the clock.
    let request = |summary: &Value| summary["max_error_rel"].as_f64().unwrap();
    assert!(request(summary) < request(set) + 2e-6, "{summary} {set}");
}

#[test]
fn soak_keeps_its_contract_and_its_promises() {
    let soak = |how: &[&str]| {
        let out = json(&[&["soak", "--frames", "300", "--every", "100", "--json", "-"], &HEAD[..], how].concat());
        let fields =
            "schema frames accumulate bit_exact max_error max_error_rel bound path format device slots checks seconds";
        has(&out, &[("", fields)]);
        assert_eq!((&out["schema"], &out["frames"], &out["checks"]), (&1.into(), &300.into(), &3.into()));
        out
    };
    let float = soak(&["--path", "cpu"]);
    assert!(float["bit_exact"].is_null() && float["sums_hash"].is_null());
    let (error, bound) = (float["max_error"].as_f64().unwrap(), float["bound"].as_f64().unwrap());
    assert!(0.0 < error && error <= bound, "{float}");
    // Integers depend on neither driver nor history.
    for (pose, format, devices) in [
        ("fixed32", "small", &["--path cpu --slots 1", "--device llvmpipe", "--device SwiftShader --slots 3"][..]),
        ("fixed16", "fast", &["--path cpu --slots 1", "--device llvmpipe --error-budget 1e-3d"]),
    ] {
        let hash = |device: &&str| {
            let how: Vec<&str> = device.split(' ').chain(["--pose", pose, "--format", format]).collect();
            let exact = soak(&how);
            assert_eq!((&exact["bit_exact"], &exact["accumulate"]), (&true.into(), &"exact".into()), "{exact}");
            assert!(exact["bound"].as_f64() > Some(0.0) && exact["pose"] == pose, "{exact}");
            exact["sums_hash"].as_str().unwrap().to_owned()
        };
        let hashes: Vec<String> = devices.iter().map(hash).collect();
        assert!(hashes.iter().all(|h| *h == hashes[0] && h.len() == 16), "{pose} {format}: {hashes:?}");
    }
}

/// The integers of a long soak: a change of them is a change of every pose.
#[test]
fn exact_poses_stay_what_they_are() {
    let long = ["soak", "--vertices", "4000", "--targets", "16", "--frames", "20000", "--path", "cpu", "--json", "-"];
    assert_eq!(json(&[&long[..], &["--pose", "fixed32"]].concat())["sums_hash"], "c9670dfcaf3f6496");
}

#[test]
fn a_path_that_is_named_fails_where_there_is_no_device() {
    let (_folder, dir) = sample();
    for args in [&["--path", "blocks"][..], &["--path", "feedback", "--format", "float32"], &["--animated"]] {
        let out = without_drivers(&[&["play", &dir, "--quiet"], args].concat());
        let errors = String::from_utf8(out.stderr).unwrap();
        assert_eq!(out.status.code(), Some(1), "{args:?}: {errors}");
        assert!(errors.contains("needs a Vulkan device, and there is none; install a driver"), "{args:?}: {errors}");
    }
}
