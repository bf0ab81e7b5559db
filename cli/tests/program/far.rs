//! Meshes far from the origin: poses are written at the mesh's position, to the last place of its coordinates.

use crate::cli::{Folder, json, ok};

#[test]
fn poses_come_out_in_the_coordinates_of_the_input() {
    let folder = Folder::new();
    let quad = [[50.0, 0.0, 0.0], [50.3, 0.0, 0.0], [50.3, 0.3, 0.0], [50.0, 0.3, 0.0f32]];
    let moved = quad.map(|[x, y, z]| [x + 0.004, y - 0.006, z + 0.002]);
    let text = |vertices: &[[f32; 3]]| -> String {
        vertices.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).chain(["f 1 2 3 4\n".into()]).collect()
    };
    std::fs::create_dir_all(folder.at("far/targets")).unwrap();
    folder.file("far/neutral.obj", text(&quad));
    folder.file("far/targets/moved.obj", text(&moved));
    let (far, out, packed) = (folder.at("far"), folder.at("out.obj"), folder.at("far.dmorph"));
    let origin = json(&["info", &far, "--json", "-"])["input"]["pose_origin"].clone();
    assert!((origin[0].as_f64().unwrap() - 50.15).abs() < 1e-2, "{origin}");
    ok(&["pack", &far, "-o", &packed, "--position-error", "1e-7"]);
    // One unit in the last place of a coordinate, and as much again for packing errors.
    let ulp = f64::from(f32::EPSILON) * 32.0;
    for (input, more, allowed) in
        [(&far, &["--format", "float32", "--tolerance", "0"][..], ulp), (&packed, &[][..], 2.0 * ulp)]
    {
        ok(&[&["apply", input, "--path", "cpu", "-o", &out, "--set", "moved=0.5"], more].concat());
        let text = std::fs::read_to_string(&out).unwrap();
        let written = text.lines().filter_map(|line| line.strip_prefix("v ")).flat_map(str::split_whitespace);
        let written: Vec<f64> = written.map(|x| x.parse().unwrap()).collect();
        assert_eq!(written.len(), 12);
        for (found, (a, b)) in written.iter().zip(quad.as_flattened().iter().zip(moved.as_flattened())) {
            let expected = (f64::from(*a) + f64::from(*b)) / 2.0;
            assert!((found - expected).abs() <= allowed, "{input}: {found} for {expected}");
        }
    }
}

#[test]
fn a_shape_that_single_precision_cannot_place_is_kept() {
    let folder = Folder::new();
    let text = |by: f64| {
        let line = |[x, y]: [f64; 2]| format!("v {} {} {}\n", 500_123.0 + x, 5_400_321.0 + y, 120.0 + by * (x + y));
        [[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.005, 0.2]].map(line).concat() + "f 1 2 3 4\n"
    };
    std::fs::create_dir_all(folder.at("far/targets")).unwrap();
    folder.file("far/neutral.obj", text(0.0));
    folder.file("far/targets/moved.obj", text(0.1));
    let (far, out, packed) = (folder.at("far"), folder.at("out.obj"), folder.at("far.dmorph"));
    let run = crate::cli::deltamorph(&["pack", &far, "-o", &packed, "--position-error", "1e-7"]);
    let noted = String::from_utf8(run.stderr).unwrap();
    assert!(noted.contains("positions in the file are relative to [500123"), "{noted}");
    let expected = text(0.05);
    let numbers = |text: &str| -> Vec<f64> { text.split_whitespace().filter_map(|word| word.parse().ok()).collect() };
    for (input, middle) in [(&far, [0.0; 3]), (&packed, [500_123.0, 5_400_321.0, 0.0])] {
        ok(&["apply", input, "--path", "cpu", "-o", &out, "--set", "moved=0.5"]);
        let written = std::fs::read_to_string(&out).unwrap();
        let (found, expected) = (numbers(&written), numbers(&expected));
        // The middle is a number of single precision: it may be half a metre from that of the mesh, but the same for
        // all.
        let off: Vec<f64> = (0..12).map(|i| found[i] + middle[i % 3] - expected[i]).collect();
        let same = (3..12).all(|i| (off[i] - off[i % 3]).abs() < 1e-6);
        assert!(same && (input == &packed || off.iter().all(|off| off.abs() < 1e-6)), "{off:?}");
    }
}
