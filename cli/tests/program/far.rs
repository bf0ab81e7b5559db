//! Meshes far from the origin: poses are as exact as at the origin, and written at the mesh's position.

use crate::cli::{deltamorph, json, ok};
use serde_json::Value;
use std::path::Path;

const TARGETS: usize = 40;

/// Returns a position in the files: a quad of diagonal 0.42, at `far` along x, moved by a target, if any.
fn position(far: f32, vertex: usize, target: Option<usize>) -> [f32; 3] {
    let [x, y] = [[0.0, 0.0], [0.3, 0.0], [0.3, 0.3], [0.0, 0.3]][vertex];
    let by = target.map_or([0.0; 3], |t| {
        let angle = (7 * t + 3 * vertex) as f32;
        [angle.sin(), angle.cos(), (2.0 * angle).sin()].map(|part| 0.006 * part)
    });
    [far + x + by[0], y + by[1], by[2]]
}

/// Writes the quad and its targets as a folder.
fn quad(folder: &Path, far: f32) -> String {
    let write = |path: &Path, target| {
        let line = |vertex| {
            let [x, y, z] = position(far, vertex, target);
            format!("v {x} {y} {z}\n")
        };
        let vertices: String = (0..4).map(line).collect();
        std::fs::write(path, vertices + "f 1 2 3 4\n").unwrap();
    };
    let folder = folder.join(format!("far {far}"));
    std::fs::create_dir_all(folder.join("targets")).unwrap();
    write(&folder.join("neutral.obj"), None);
    (0..TARGETS).for_each(|t| write(&folder.join(format!("targets/t{t:02}.obj")), Some(t)));
    folder.to_str().unwrap().to_owned()
}

/// Returns a command's JSON output.
fn run(args: &[&str]) -> Value {
    let out = deltamorph(&[args, &["--json", "-"]].concat());
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success(), "{args:?}: {said}");
    serde_json::from_slice(&out.stdout).unwrap()
}

#[test]
fn poses_come_out_in_the_coordinates_of_the_input() {
    let folder = tempfile::tempdir().unwrap();
    let far = 50.0;
    let quad = quad(folder.path(), far);
    let [out, packed] = ["out.obj", "quad.dmorph"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
    let origin = json(&["info", &quad, "--json", "-"])["input"]["pose_origin"].clone();
    assert!((origin[0].as_f64().unwrap() - 50.15).abs() < 1e-5 && origin[1] == 0.0, "{origin}");
    ok(&["pack", &quad, "-o", &packed, "--position-error", "1e-7"]);
    let settings: Vec<String> = (0..TARGETS).map(|t| format!("t{t:02}={}", 0.01 * t as f32)).collect();
    // One unit in the last place of a coordinate, and as much again for packing errors.
    let ulp = f64::from(f32::EPSILON) * 32.0;
    for (input, more, allowed) in
        [(&quad, &["--format", "float32", "--tolerance", "0"][..], ulp), (&packed, &[][..], 2.0 * ulp)]
    {
        ok(&[&["apply", input, "--path", "cpu", "-o", &out, "--set", &settings.join(",")], more].concat());
        let text = std::fs::read_to_string(&out).unwrap();
        let rows = text.lines().filter_map(|line| line.strip_prefix("v "));
        let rows: Vec<Vec<f64>> =
            rows.map(|row| row.split_whitespace().map(|x| x.parse().unwrap()).collect()).collect();
        assert_eq!(rows.len(), 4);
        for (vertex, row) in rows.iter().enumerate() {
            let base = position(far, vertex, None);
            for axis in 0..3 {
                let delta = |t| f64::from(position(far, vertex, Some(t))[axis] - base[axis]);
                let expected: f64 = (0..TARGETS).map(|t| f64::from(0.01 * t as f32) * delta(t)).sum();
                let moved = row[axis] - f64::from(base[axis]);
                assert!((moved - expected).abs() <= allowed, "{input} vertex {vertex}: {moved} for {expected}");
            }
        }
    }
    // A packed mesh is recentred, too.
    let soak = run(&["soak", &packed, "--path", "cpu", "--frames", "100"]);
    assert_eq!(soak["accumulate"], "float", "{soak}");
    assert!(soak["max_error_rel"].as_f64().unwrap() < 1e-6, "{soak}");
}
