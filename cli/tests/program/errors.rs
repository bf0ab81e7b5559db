//! What `apply`, `play`, `info` and `pack` state of errors, recomputed in float64 from the files.

use crate::cli::{Folder, json, ok};
use serde_json::Value;
use std::path::Path;

const VERTICES: usize = 40;
const TARGETS: usize = 24;
/// Share of the diagonal that is left to rounding of float32 coordinates.
const FLOAT: f64 = 1e-6;

/// The base position of a vertex, or where a target has it: each moves two thirds of the vertices.
fn position(vertex: usize, target: Option<usize>) -> [f32; 3] {
    let base = [(vertex % 8) as f32, (vertex / 8) as f32, 0.0];
    let Some(target) = target.filter(|target| !(vertex + target).is_multiple_of(3)) else { return base };
    let angle = (5 * target + 3 * vertex) as f32;
    let by = [angle.sin(), angle.cos(), (2.0 * angle).sin()].map(|part| 0.07 * part);
    std::array::from_fn(|i| base[i] + by[i])
}

/// Writes the mesh and a clip of three frames as a folder; returns its path and the frames.
fn written(folder: &Path) -> (String, Vec<Vec<f64>>) {
    let dir = folder.join("mesh");
    for part in ["targets", "weights"] {
        std::fs::create_dir_all(dir.join(part)).unwrap();
    }
    let write = |name: &str, target| {
        let line = |vertex| {
            let [x, y, z] = position(vertex, target);
            format!("v {x} {y} {z}\n")
        };
        let face = |i: usize| format!("f {} {} {} {}\n", i + 1, i + 2, i + 10, i + 9);
        let text: String = (0..VERTICES).map(line).chain((0..31).filter(|i| i % 8 < 7).map(face)).collect();
        std::fs::write(dir.join(name), text).unwrap();
    };
    write("neutral.obj", None);
    (0..TARGETS).for_each(|t| write(&format!("targets/t{t:02}.obj"), Some(t)));
    let frame = |f: usize| (0..TARGETS).map(|t| f64::from(((7 * t + 11 * f) % 97) as f32 / 97.0)).collect();
    let frames: Vec<Vec<f64>> = [vec![1.0; TARGETS]].into_iter().chain((1..3).map(frame)).collect();
    let names: Vec<String> = (0..TARGETS).map(|t| format!("t{t:02}")).collect();
    let row = |weights: &Vec<f64>| weights.iter().map(|w| (*w as f32).to_string()).collect::<Vec<_>>().join(",");
    let rows: Vec<String> = frames.iter().map(row).collect();
    std::fs::write(dir.join("weights/clip.csv"), format!("{}\n{}\n", names.join(","), rows.join("\n"))).unwrap();
    (dir.to_str().unwrap().to_owned(), frames)
}

/// Σ weight · delta of a vertex.
fn moved(vertex: usize, weights: &[f64]) -> [f64; 3] {
    let base = position(vertex, None);
    std::array::from_fn(|axis| {
        let delta = |t| f64::from(position(vertex, Some(t))[axis]) - f64::from(base[axis]);
        weights.iter().enumerate().map(|(t, weight)| weight * delta(t)).sum()
    })
}

fn length(of: [f64; 3]) -> f64 {
    of.iter().map(|part| part * part).sum::<f64>().sqrt()
}

fn largest(of: impl Fn(usize) -> f64) -> f64 {
    (0..VERTICES).map(of).fold(0.0, f64::max)
}

/// The largest distance of a vertex of an OBJ file from where it should be.
fn off(obj: &str, weights: &[f64]) -> f64 {
    let text = std::fs::read_to_string(obj).unwrap();
    let rows = text.lines().filter_map(|line| line.strip_prefix("v "));
    let rows: Vec<Vec<f64>> = rows.map(|row| row.split_whitespace().map(|x| x.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), VERTICES);
    largest(|v| {
        let (base, by) = (position(v, None), moved(v, weights));
        length(std::array::from_fn(|axis| rows[v][axis] - f64::from(base[axis]) - by[axis]))
    })
}

#[test]
fn errors_are_those_of_the_files_and_the_weights_asked_for() {
    let folder = Folder::new();
    let (dir, frames) = written(folder.0.path());
    let [obj, packed] = ["out.obj", "out.dmorph"].map(|name| folder.at(name));
    let info = json(&["info", &dir, "--json", "-"]);
    let pack = json(&["pack", &dir, "-o", &packed, "--json", "-"]);
    assert_eq!((&pack["pose_formats"], &info["pose_deltas"]), (&info["pose_formats"], &"small".into()));
    let diagonal = info["input"]["diagonal"].as_f64().unwrap();
    let number = |of: &Value, field: &str| of[field].as_f64().unwrap_or_else(|| panic!("{field} of {of}"));
    for stated in info["pose_formats"].as_array().unwrap() {
        let pose = stated["name"].as_str().unwrap();
        let how = ["--path", "cpu", "--format", "small", "--pose", pose, "--json", "-"];
        let clip = format!("{dir}/weights/clip.csv");
        let played = json(&[&["play", &dir, "--every", "1"], &how[..]].concat());
        let grid = &stated["grid"];
        let step = if grid.is_null() { 0.0 } else { 0.5f64.powi(grid["weight_bits"].as_u64().unwrap() as i32) };
        for (frame, weights) in frames.iter().enumerate() {
            let number_of = frame.to_string();
            let at = ["--weights", &clip, "--frame", &number_of, "-o", &obj];
            let applied = json(&[&["apply", &dir], &at[..], &how].concat());
            let true_error = off(&obj, weights) / diagonal;
            let whole = number(&applied, "max_error_rel");
            assert!((whole - true_error).abs() < FLOAT, "{pose} {frame}: {true_error}, not {applied}");
            let packing = number(&applied, "packing_error_rel");
            let parts = packing + number(&applied, "weights_error_rel") + number(&applied, "rounding_error_rel");
            assert!(whole <= parts + FLOAT && whole <= number(stated, "max_error_rel") + FLOAT, "{applied} {stated}");
            // All frames of the clip are measured, if there are few.
            let measured = number(stated, "measured_error_rel");
            assert!(frame > 0 && pose == "float32" || whole <= measured + FLOAT, "{applied} {stated}");
            // Weights that are rounded, with the deltas of the files in place of the packed ones.
            let rounded = |w: &f64| if step > 0.0 { (w / step).round() * step - w } else { 0.0 };
            let lost: Vec<f64> = weights.iter().map(rounded).collect();
            let of_weights = largest(|v| length(moved(v, &lost))) / diagonal;
            let found = number(&applied, "weights_error_rel");
            assert!((found - of_weights).abs() < packing + FLOAT, "{of_weights} {applied}");
            let stays = frame == 0 || pose != "float32";
            let of_play = number(&played["frames"][frame], "max_error") / diagonal;
            assert!((of_play - true_error).abs() < if stays { FLOAT } else { 1e-5 }, "{pose} {frame}: {of_play}");
        }
        let worst =
            frames.iter().enumerate().map(|(f, _)| number(&played["frames"][f], "max_error")).fold(0.0, f64::max);
        assert!((number(&played["summary"], "max_error") - worst).abs() < 1e-12, "{}", played["summary"]);
        // Half a step of each weight, whatever the signs.
        let delta = |v, t| length(moved(v, &(0..TARGETS).map(|u| f64::from(u8::from(u == t))).collect::<Vec<_>>()));
        let bound = largest(|v| (0..TARGETS).map(|t| delta(v, t)).sum()) * step / 2.0 / diagonal;
        let of_weights = number(stated, "weights_error_rel");
        assert!((of_weights - bound).abs() <= 1e-3 * bound, "{bound} {stated}");
        assert!(grid.is_null() || grid["targets_most"] == 16, "targets of a vertex, not of a block: {grid}");
    }
    for (of, source) in [(&dir, "the source"), (&packed, "the packed file")] {
        let said = ok(&["apply", of, "--path", "cpu", "--set", "t00=0.5", "-o", &obj]);
        assert!(said.contains(&format!("maximum error against {source}: ")) && said.contains(": packing "), "{said}");
    }
}

#[test]
fn a_pose_format_that_loses_much_says_which_loses_less() {
    let folder = Folder::new();
    let many = ["--vertices", "300", "--targets", "400", "--sparsity", "1"];
    let info = json(&[&["info", "--json", "-"], &many[..]].concat());
    let targets = info["targets"].as_array().unwrap().iter();
    let set: Vec<String> = targets.map(|target| format!("{}=0.9", target["name"].as_str().unwrap())).collect();
    let (set, out) = (set.join(","), folder.at("out.obj"));
    for (pose, far) in [("fixed16", true), ("fixed32", false)] {
        let how = ["apply", "--path", "cpu", "--format", "small", "--pose", pose, "--set", &set, "-o", &out];
        let run = crate::cli::deltamorph(&[&how[..], &many].concat());
        let said = String::from_utf8(run.stderr).unwrap();
        assert!(run.status.success() && said.contains("of the diagonal: try --pose") == far, "{pose}: {said}");
    }
}

#[test]
fn a_clip_that_cannot_be_read_is_left_out_with_a_warning() {
    let folder = Folder::new();
    let (dir, _) = written(folder.0.path());
    folder.file("mesh/weights/bad.csv", "t00,t01\n0.5,yes\n");
    let packed = &*folder.at("out.dmorph");
    for args in [&["info", &dir, "--json", "-"][..], &["pack", &dir, "-o", packed, "--json", "-"]] {
        let out = crate::cli::deltamorph(args);
        let said = String::from_utf8(out.stderr).unwrap();
        assert!(out.status.success() && (args[0] == "pack" || said.contains("bad.csv")), "{args:?}: {said}");
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        assert!(args[0] == "pack" || report["clips"].as_array().unwrap().len() == 1, "{report}");
    }
}
