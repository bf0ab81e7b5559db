//! Meshes far from the origin: poses are written at the mesh's position, to the last place of its coordinates.

use crate::cli::{Folder, ok};

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
