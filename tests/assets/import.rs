//! OBJ folders: imported data, and errors for unusable ones.

use crate::prelude::*;
use deltamorph::import::obj::{ObjFile, ObjMesh, import_folder, write_obj};
use glam::Vec3;
use proptest::prelude::*;
use std::path::Path;
use tempfile::TempDir;

/// A tetrahedron with an apex that targets move.
const NEUTRAL: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

fn folder(neutral: &str, targets: &[(&str, &str)]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("neutral.obj"), neutral).unwrap();
    std::fs::create_dir(dir.path().join("targets")).unwrap();
    for (name, text) in targets {
        std::fs::write(dir.path().join("targets").join(name), text).unwrap();
    }
    dir
}

fn import(neutral: &str, targets: &[(&str, &str)]) -> Mesh {
    import_folder(folder(neutral, targets).path()).unwrap()
}

fn refused(neutral: &str, targets: &[(&str, &str)]) -> String {
    import_folder(folder(neutral, targets).path()).unwrap_err().to_string()
}

fn parse(text: &str) -> ObjFile {
    ObjFile::from_bytes(Path::new("x.obj"), text.into()).unwrap()
}

fn parse_error(text: impl Into<Vec<u8>>) -> String {
    ObjFile::from_bytes(Path::new("x.obj"), text.into()).unwrap_err().to_string()
}

#[track_caller]
fn says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "'{part}' is not in: {message}");
    }
}

#[test]
fn targets_come_in_the_order_of_their_names_and_hold_what_differs() {
    let up = NEUTRAL.replace("v 0 0 1", "v 0 0 1.5");
    let source = import(NEUTRAL, &[("b.OBJ", &up), ("a.obj", NEUTRAL), ("notes.txt", "x"), (".hidden.obj", "junk")]);
    assert_eq!(source.targets.iter().map(|t| t.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
    assert!(source.targets[0].positions.is_empty());
    assert_eq!(source.targets[1].positions, [(3, Vec3::new(0.0, 0.0, 0.5))]);
    assert_eq!(source.positions.len(), 4);
    assert!(source.normals.is_none() && source.notes.is_empty(), "{:?}", source.notes);
}

#[test]
fn the_order_of_the_file_is_kept_whatever_faces_and_groups_say() {
    // Reversed faces, an unreferenced vertex (2), groups and materials between them, CR LF, a byte order mark, a
    // continued line, colours on one line only, comments in Latin-1.
    let mut text =
        b"\xef\xbb\xbf# caf\xe9 \\\r\nmtllib none.mtl\r\no one\r\nv 5 0 0 1 0 0\r\nv 9 9 9\r\nv 6 \\\r\n 0 0\r\n"
            .to_vec();
    text.extend_from_slice(b"v 7 1 0 # comment\r\nusemtl red\r\nf 4 3 1\r\ng two\r\nv 8 2 0\r\nusemtl blue\r\ns 1\r\n");
    text.extend_from_slice(b"f -1 -2 -3 -5\r\nl 1 2\r\np 1\r\n");
    let file = ObjFile::from_bytes(Path::new("x.obj"), text).unwrap();
    assert_eq!(file.positions.iter().map(|p| p.x).collect::<Vec<_>>(), [5.0, 9.0, 6.0, 7.0, 8.0]);
    assert_eq!(file.faces.sizes, [3, 4]);
    assert_eq!(file.faces.corners.iter().map(|c| c.position).collect::<Vec<_>>(), [3, 2, 0, 4, 3, 2, 0]);
    assert!(file.faces.corners.iter().all(|c| c.texcoord.is_none()));
}

#[test]
fn corners_without_texture_coordinate_have_none() {
    let file = parse("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nf 1/2/1 2//1 3/1\nf 1 2 3\n");
    let texcoords: Vec<_> = file.faces.corners.iter().map(|c| c.texcoord).collect();
    assert_eq!(texcoords, [Some(1), None, Some(0), None, None, None]);
    assert!(file.corner_normals.is_none() && file.any_normals);
}

#[test]
fn an_index_may_look_ahead_and_points_have_no_faces() {
    assert_eq!(parse("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").faces.sizes, [3]);
    let cloud = import("v 0 0 0\nvn 0 0 2\n", &[("a.obj", "v 0 1 0\nvn 0 1 2\n")]);
    assert_eq!(cloud.normals, Some(vec![Vec3::Z]));
    assert_eq!(cloud.targets[0].normals, Some(vec![(0, Vec3::new(0.0, 0.5, 0.0))]));
    assert_eq!(parse("v 2 4 6 2\n").positions, [Vec3::new(1.0, 2.0, 3.0)]);
}

#[test]
fn a_seam_in_the_texture_coordinates_does_not_split_the_shading() {
    let roof = "v -1 0 0\nv 0 0 1\nv 1 0 0\nv 0 1 1\nvt 0 0\nvt 1 0\nvt .5 1\n";
    let whole = import(&format!("{roof}f 1/1 2/2 4/3\nf 2/2 3/1 4/3\n"), &[]);
    let split = import(&format!("{roof}f 1/1 2/2 4/3\nf 2/3 3/1 4/2\n"), &[]);
    let normals = |s: &Mesh| s.kept(Tolerance::ZERO).unwrap().normals;
    assert_eq!(normals(&whole), normals(&split));
    assert!((normals(&split)[1] - Vec3::Z).length() < 1e-6);
}

#[test]
fn hard_edges_are_averaged_by_area_with_a_note() {
    // The face of vertex 4 has three times the area of the other.
    let text =
        |n: &str| format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 3\nvn 0 0 1\nvn {n}\nf 1//1 2//1 3//1\nf 2//2 1//2 4//2\n");
    let source = import(&text("0 1 0"), &[("a.obj", &text("0 1 0.4"))]);
    says(&source.notes.join("\n"), &["vertices with several normals (hard edges), averaged by face area: 2"]);
    let expected = Vec3::new(0.0, 3.0, 1.0).normalize();
    assert!((source.normals.as_ref().unwrap()[0] - expected).length() < 1e-6);
    let deltas = source.targets[0].normals.as_ref().unwrap();
    let scale = 4.0 / 10f32.sqrt(); // the mean is (0, 3, 1) / 4
    assert!((deltas[0].1 - Vec3::new(0.0, 0.0, 0.3) * scale).length() < 1e-6, "{deltas:?}");
    assert_eq!(deltas.iter().map(|d| d.0).collect::<Vec<_>>(), [0, 1, 3]);
}

#[test]
fn normals_on_one_side_only_are_computed_with_a_note() {
    let with = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n";
    let without = "v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3\n";
    let source = import(with, &[("a.obj", without)]);
    says(&source.notes.join("\n"), &["targets without normals at all corners, which are computed: 'a'"]);
    assert!(source.normals.is_some() && source.targets[0].normals.is_none());
    let mesh = source.kept(Tolerance::default()).unwrap();
    let tilted = mesh.normals[0] + mesh.targets[0].normals[0];
    assert!((tilted - Vec3::new(0.0, -1.0, 1.0).normalize()).length() < 1e-6, "{tilted}");

    let source = import(without, &[("a.obj", with)]);
    says(
        &source.notes.join("\n"),
        &["targets with normals where neutral.obj has none, which are computed for all: 'a'"],
    );
    assert!(source.normals.is_none() && source.targets[0].normals.is_none());

    let partly = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3\n";
    says(&import(partly, &[]).notes.join("\n"), &["some corners only"]);
}

#[test]
fn no_targets_is_a_note_and_no_neutral_mesh_an_error() {
    let source = import(NEUTRAL, &[]);
    assert!(source.targets.is_empty());
    says(&source.notes.join("\n"), &["without targets"]);

    let dir = folder(NEUTRAL, &[]);
    std::fs::remove_dir(dir.path().join("targets")).unwrap();
    says(&import_folder(dir.path()).unwrap().notes.join("\n"), &["'targets'", "without targets"]);
    std::fs::remove_file(dir.path().join("neutral.obj")).unwrap();
    says(
        &import_folder(dir.path()).unwrap_err().to_string(),
        &["no file neutral.obj in this folder; its .obj files: none"],
    );
    says(&import_folder(&dir.path().join("gone")).unwrap_err().to_string(), &["gone", "cannot read the folder"]);
}

#[test]
fn a_target_that_does_not_fit_is_named_with_what_was_expected() {
    let longer = format!("{NEUTRAL}v 1 1 1\n");
    let expected = ["targets", "x.obj: 5 vertices, but", "neutral.obj has 4", "same order"];
    says(&refused(NEUTRAL, &[("x.obj", &longer), ("z.obj", "junk")]), &expected);
    // Beside one that fits, it is left out.
    let pointer = "version https://git-lfs.github.com/spec/v1\n";
    let others = [("a.obj", NEUTRAL), ("b.obj", ""), ("n.obj", "v 0 0 nan\n"), ("p.obj", pointer), ("x.obj", &longer)];
    let source = import(NEUTRAL, &others);
    assert!(source.targets.len() == 1 && source.notes.len() == 4, "{:?}", source.notes);
    for (note, (name, _)) in source.notes.iter().zip(&others[1..]) {
        says(note, &[name, "; left out"]);
    }
    says(&source.notes[3], &expected);

    // Elsewhere these are one file.
    if cfg!(target_os = "linux") {
        says(&refused(NEUTRAL, &[("x.obj", NEUTRAL), ("x.OBJ", NEUTRAL)]), &["second file of the target 'x'"]);
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_is_refused_and_a_folder_passed_over() {
    let pipe = |path: &Path| assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    let dir = folder(NEUTRAL, &[("a.obj", NEUTRAL)]);
    let targets = dir.path().join("targets");
    std::fs::create_dir(targets.join("folder.obj")).unwrap();
    std::os::unix::fs::symlink(targets.join("a.obj"), targets.join("link.obj")).unwrap();
    assert_eq!(import_folder(dir.path()).unwrap().targets.len(), 2);

    pipe(&targets.join("b.obj"));
    let expected = ["b.obj: a pipe, socket or device", "give the path of a regular file; left out"];
    let notes = || import_folder(dir.path()).unwrap().notes.join("\n");
    says(&notes(), &expected);
    std::fs::rename(targets.join("b.obj"), dir.path().join("pipe")).unwrap();
    std::os::unix::fs::symlink(dir.path().join("pipe"), targets.join("b.obj")).unwrap();
    says(&notes(), &expected);

    std::fs::remove_file(dir.path().join("neutral.obj")).unwrap();
    pipe(&dir.path().join("neutral.obj"));
    says(&import_folder(dir.path()).unwrap_err().to_string(), &["neutral.obj: a pipe, socket or device"]);
}

#[test]
fn a_polygon_of_many_corners_takes_no_longer_than_many_polygons() {
    let corners = 100_000;
    let polygon = |height: f32| {
        let mut text: String = (0..corners)
            .map(|i| {
                let (sin, cos) = (i as f32 / corners as f32 * std::f32::consts::TAU).sin_cos();
                format!("v {cos} {sin} {}\n", height * cos)
            })
            .collect();
        text.push('f');
        (1..=corners).for_each(|i| text.push_str(&format!(" {i}")));
        text
    };
    let start = std::time::Instant::now();
    let mesh = import(&polygon(0.0), &[("a.obj", &polygon(1.0))]).kept(Tolerance::default()).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    assert!(mesh.normals.iter().all(|n| (*n - Vec3::Z).length() < 1e-5));
    assert!(mesh.targets[0].vertices.len() == corners && mesh.targets[0].normals[7].x < -0.5);
    // About 0.1 s; recomputing the polygon at each of its corners takes most of a minute.
    assert!(seconds < 2.0, "{seconds} s");

    // Corners that repeat and cross: to cut that in its plane takes many minutes.
    let mut wild = "v 0 0 0\nv 1 0 0\nv 3 3 0\nv 0 1 0\nv 3 1 0\nf".to_owned();
    (0..corners).for_each(|i| wild += &format!(" {}", 1 + i * i % 5));
    let source = import(&wild, &[]);
    says(&source.notes.join("\n"), &["faces of more than 512 corners, cut as fans from the first one: 1"]);
    let start = std::time::Instant::now();
    assert_eq!(source.faces.triangles(&source.positions).len(), corners - 2);
    assert!(start.elapsed().as_secs_f64() < 2.0, "{:?}", start.elapsed());

    // Stars that cross themselves, each of which takes long to cut: the first few are.
    let angle = |i: usize| (i * 51 % 512) as f32 / 512.0 * std::f32::consts::TAU;
    let corner = |i: usize| Vec3::new(angle(i).cos(), angle(i).sin(), 0.0) * if i % 2 == 1 { 1.3 } else { 1.0 };
    let star = "f".to_owned() + &(1..=512).map(|i| format!(" {i}")).collect::<String>() + "\n";
    let source = import(&(spelled(&(0..512).map(corner).collect::<Vec<_>>(), 0) + &star.repeat(200)), &[]);
    says(&source.notes.join("\n"), &["many large faces: the last concave ones may be cut as fans"]);
    let start = std::time::Instant::now();
    let triangles = source.faces.triangles(&source.positions);
    assert!(triangles.len() == 200 * 510 && triangles[199 * 510..].iter().all(|triangle| triangle[0] == 0));
    // About 0.6 s; all of them take 30.
    assert!(start.elapsed().as_secs_f64() < 6.0, "{:?}", start.elapsed());
}

/// Files in one folder: their names, the neutral mesh, and the targets or the error.
#[test]
fn the_neutral_mesh_may_lie_beside_its_targets() {
    let up = NEUTRAL.replace("v 0 0 1", "v 0 0 1.5");
    let cases: [(&[&str], &str, &[&str]); 9] = [
        (&["Neutral", "browInnerUp", "jawOpen"], "Neutral", &["browInnerUp", "jawOpen"]),
        (&["_neutral", "jawOpen"], "_neutral", &["jawOpen"]),
        (&["generic_neutral_mesh", "identity000", "jawOpen_L"], "generic_neutral_mesh", &["identity000", "jawOpen_L"]),
        (&["NEUTRAL", "neutral_smile", "a"], "NEUTRAL", &["a", "neutral_smile"]),
        (&["neutral", "Neutral"], "neutral", &["Neutral"]),
        (&["neutral", "targets/a", "ignored"], "neutral", &["a"]),
        (&["My Neutral", "targets/a", "targets/Neutral"], "My Neutral", &["Neutral", "a"]),
        (
            &["jawOpen", "smile"],
            "",
            &["no file neutral.obj in this folder; its .obj files: 'jawOpen', 'smile'; name the"],
        ),
        (&["neutral_l", "neutral_r", "a", "b"], "", &["'neutral_l', 'neutral_r', 'a', 'b'; name the neutral mesh"]),
    ];
    for (files, neutral, expected) in cases {
        if files == ["neutral", "Neutral"] && !cfg!(target_os = "linux") {
            continue; // These are one file there.
        }
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("targets")).unwrap();
        for name in files {
            std::fs::write(dir.path().join(format!("{name}.obj")), if *name == neutral { NEUTRAL } else { &up })
                .unwrap();
        }
        // Not there, unless it has files.
        let _ = std::fs::remove_dir(dir.path().join("targets"));
        let source = match import_folder(dir.path()) {
            Ok(source) => source,
            Err(error) => {
                assert_eq!(neutral, "", "{error}");
                says(&error.to_string(), expected);
                continue;
            }
        };
        let names: Vec<&str> = source.targets.iter().map(|target| target.name.as_str()).collect();
        assert_eq!((names.as_slice(), source.positions[3]), (expected, Vec3::Z), "{files:?}");
        let note = format!("the neutral mesh is {neutral}.obj");
        assert_eq!(source.notes.contains(&note), neutral != "neutral", "{:?}", source.notes);
    }
}

#[cfg(unix)]
#[test]
fn names_of_files_in_other_encodings_stay_apart() {
    use std::os::unix::ffi::OsStrExt;
    let dir = folder(NEUTRAL, &[("a.obj", NEUTRAL)]);
    for name in [&b"\x82\xa0.obj"[..], b"\x82\xa2.obj"] {
        std::fs::write(dir.path().join("targets").join(std::ffi::OsStr::from_bytes(name)), NEUTRAL).unwrap();
    }
    let source = import_folder(dir.path()).unwrap();
    let names: Vec<&str> = source.targets.iter().map(|target| target.name.as_str()).collect();
    assert_eq!(names, ["\\x82\\xa0", "\\x82\\xa2", "a"]);
}

/// Coordinates of maps have more digits than single precision: shape and deltas stay, as does the place.
#[test]
fn the_shape_of_a_mesh_far_off_is_kept() {
    for (place, weight) in
        [([500_123.0, 5_400_321.0, 120.0], 1.0), ([-6_378_137.25, 3.0, 7e8], 1.0), ([1e5, 0.0, 0.0], 4.0)]
    {
        let shape = [[0.0, 0.0, 0.0], [0.2, 0.0, 0.01], [0.0, 0.2, 0.02], [0.1, 0.3, 0.0]];
        let text = |by: f64| -> String {
            let line = |p: &[f64; 3]| {
                let [x, y, z] = std::array::from_fn(|i| (place[i] + p[i] + by) * weight);
                format!("v {x:.6} {y:.6} {z:.6} {weight}\n")
            };
            shape.iter().map(line).chain(["f 1 2 4 3\n".to_owned()]).collect()
        };
        let mesh = import(&text(0.0), &[("a.obj", &text(0.03))]).kept(Tolerance::ZERO).unwrap();
        // Of the shape, by single precision of what the middle is off, which is single precision as well.
        let allowed = 1e-7 + 2e-14 * place[2];
        for (i, p) in shape.iter().enumerate() {
            let found = mesh.origin.as_dvec3() + mesh.positions[i].as_dvec3();
            let delta = mesh.targets[0].positions[i].as_dvec3();
            for axis in 0..3 {
                let off = [found[axis] - place[axis] - p[axis], delta[axis] - 0.03];
                assert!(off.iter().all(|off| off.abs() < allowed), "{place:?} {i}: {off:?}");
            }
        }
    }
    assert_eq!(import("v 50 0 0\nv 50.5 0 0\n", &[]).origin, Vec3::ZERO, "near enough");
}

#[test]
fn bad_lines_are_named() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";
    let face = |f: &str| parse_error(format!("{triangle}\n{f}\n"));
    says(&face("f 1 2 0"), &["x.obj: line 6", "vertex index 0", "counted from 1"]);
    says(&face("f 1 2 4"), &["line 6", "vertex index 4, but there are 3 'v' lines"]);
    says(&face("f 1 2 -4"), &["line 6", "there are 3 'v' lines before it"]);
    says(&face("f 1 2 x"), &["line 6", "'x' is not a corner"]);
    says(&face("f 1 2 /1"), &["line 6", "names no vertex"]);
    says(&face("f 1 2 1/1//"), &["line 6", "more than three"]);
    says(&face("f 1 2 -9223372036854775808"), &["line 6"]);
    says(&face("f 1 2 99999999999999999999"), &["line 6"]);
    says(&parse_error("v 0 0\n"), &["line 1", "a vertex with 2 of 3 numbers"]);
    says(
        &parse_error("v 0 0 0 0\n"),
        &["line 1", "the vertex '0 0 0 0' is not one of finite", "divided by the fourth"],
    );
    says(&parse_error("# ok\r\nv 0 nan 0\r\n"), &["line 2", "the vertex '0 nan 0' is not one of finite"]);
    says(&parse_error("v 0 1.#QNAN 0\n"), &["line 1", "the vertex '0 1.#QNAN 0'"]);
    says(&parse_error("v 0 1e39 0\n"), &["line 1", "'0 1e39 0' is not one of finite"]);
    says(&parse_error("v 0,5 0 0\n"), &["line 1", "'0,5' is not a number", "with a point"]);
    says(&parse_error("v 0 zero 0\n"), &["line 1", "'zero' is not a number"]);
    says(&parse_error("v 0 0 0\nvn 0 1\n"), &["line 2", "a normal with 2 of 3 numbers"]);
    says(&parse_error("v 0 0 0\nvt\n"), &["line 2", "texture coordinate with 0 of 1 numbers"]);
    says(&parse_error(*b"v 0 0 0\nv 1 \xff 0\n"), &["line 2", "UTF-8"]);
    // The first line of a continued statement, and the line count after it.
    says(&parse_error("v 0 \\\n 0 \\\n 0\nv 0\n"), &["line 4"]);
}

#[test]
fn lines_may_end_in_any_way() {
    let text = format!("# made by hand\n{NEUTRAL}v 4 \\\n5 6\nf 1 2 5\n");
    let expected = parse(&text);
    for end in ["\r\n", "\r"] {
        let file = parse(&text.replace('\n', end));
        assert_eq!(file.positions, expected.positions);
        assert_eq!(file.faces, expected.faces);
        says(&parse_error(format!("{text}v 0 0\n").replace('\n', end)), &["x.obj: line 13", "2 of 3 numbers"]);
    }
    assert_eq!(parse(text.trim_end()).faces, expected.faces);
}

#[test]
fn what_is_no_obj_is_refused_as_such() {
    says(&parse_error(""), &["x.obj: an empty file, where an OBJ file is expected"]);
    says(&parse_error("hello\nworld\n"), &["no 'v' line", "Wavefront OBJ"]);
    says(&parse_error(*b"glTF\x02\0\0\0v 1 2 3"), &["a glTF file, where an OBJ file is expected"]);
    says(&parse_error("v 0 1\0 2\n"), &["line 1", "is not a number"]);
    // At the end and in comments zeros are no harm.
    assert_eq!(parse(&format!("# a\0b\n{NEUTRAL}f 1 2 3\0\0")).faces, parse(&format!("{NEUTRAL}f 1 2 3")).faces);
    says(&ObjFile::read(Path::new("/nowhere/x.obj")).unwrap_err().to_string(), &["/nowhere/x.obj: cannot read"]);
}

#[test]
fn what_is_written_reads_back_bit_for_bit() {
    let text = "v 0.1 1e-30 -3e8\nv 0.333333343 2 -0\nv 100 -0.5 123456.78\nv 4 5 6\nvt .1 .7\nvt .3 .9\nvt 1 1\n\
                f 1/1 2/2 3/3 4/1\nf 1/3 3/2 2/1\nf 1 2 4\n";
    let mesh = import(text, &[]).kept(Tolerance::ZERO).unwrap();
    let mut out = Vec::new();
    write_obj(&mut out, (&mesh).into()).unwrap();
    let again = ObjFile::from_bytes(Path::new("x.obj"), out.clone()).unwrap();
    assert_eq!(again.positions, mesh.positions);
    assert_eq!(again.texcoords, mesh.texcoords);
    assert_eq!(again.normals, mesh.normals);
    assert_eq!(again.faces, mesh.faces);
    let text = String::from_utf8(out).unwrap();
    says(&text, &["v 0.1 ", "v 100 -0.5 123456.78\n", "f 1/1/1 2/2/2 3/3/3 4/1/4\n", "f 1//1 2//2 4//4\n"]);

    let mut out = Vec::new();
    write_obj(&mut out, ObjMesh { normals: &[], ..(&mesh).into() }).unwrap();
    assert!(ObjFile::from_bytes(Path::new("x.obj"), out).unwrap().normals.is_empty());
}

#[test]
fn noise_is_dropped_and_does_not_come_back_in_the_normals() {
    let mut source = import(NEUTRAL, &[("a.obj", &NEUTRAL.replace("v 0 0 1", "v 0.2 0.1 1.5"))]);
    source.targets[0].positions.insert(0, (1, Vec3::splat(1e-8)));
    let mesh = source.kept(Tolerance { position: 1e-6, normal: 1e9 }).unwrap();
    assert_eq!(mesh.targets[0].vertices, [3]);
    let mesh = source.kept(Tolerance::default()).unwrap();
    let target = &mesh.targets[0];
    // Vertex 1 stays only for its normal, so its position delta is exactly zero.
    assert_eq!(target.vertices, [0, 1, 2, 3]);
    assert_eq!(target.positions[1], Vec3::ZERO);
    let exact = import(NEUTRAL, &[("a.obj", &NEUTRAL.replace("v 0 0 1", "v 0.2 0.1 1.5"))]);
    assert_eq!(exact.kept(Tolerance::default()).unwrap().targets, mesh.targets);
}

#[test]
fn bad_parts_cost_no_more_than_themselves() {
    // Texture coordinates and normals that are 0, not there, or no numbers; what is kept, and what is said.
    let three = |rest: &str| format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5\nvt nan 0\nvn 0 0 2\nvn {rest}\n");
    let good = three("1 0 0\nf 1//1 2//1 3//1");
    for (rest, texcoords, normals, note) in [
        ("1 0 0\nf 1/1/1 2/1/1 3/1/1", [Some(0); 3], Some(vec![0; 3]), ""),
        ("1 0 0\nf 1/0/1 2/9/1 3/2/1", [None; 3], Some(vec![0; 3]), "or are no numbers, left out: 3"),
        ("1 0 0\nf 1/1/0 2/1/5 3/1/1", [Some(0); 3], None, "or are no numbers, left out: 2"),
        ("1 0 0\nf 1//-3 2//-2 3//-2", [None; 3], None, "or are no numbers, left out: 1"),
        ("1.#QNAN -1.#IND nan(ind)\nf 1//1 2//2 3//1", [None; 3], Some(vec![0, 1, 0]), ""),
        ("1 0 0\nf 1 2\nf\nf 1/1/1 2/1/1 3/1/1 # 1\nf 3", [Some(0); 3], Some(vec![0; 3]), "three corners, left out: 3"),
    ] {
        let file = parse(&three(rest));
        assert_eq!(file.faces.sizes, [3], "{rest}");
        assert!(file.faces.corners.iter().map(|corner| corner.texcoord).eq(texcoords), "{rest}: {:?}", file.faces);
        assert_eq!(file.corner_normals, normals, "{rest}");
        assert_eq!(file.notes.is_empty(), note.is_empty(), "{rest}");
        says(&file.notes.join("\n"), &[note]);
        assert_eq!((file.texcoords[0].to_array(), file.texcoords[1].to_array()), ([0.5, 0.0], [0.0; 2]));
        // A normal that is lost is computed, in targets as well.
        for source in [import(&three(rest), &[("a.obj", &good)]), import(&good, &[("a.obj", &three(rest))])] {
            let mesh = source.kept(Tolerance::ZERO).unwrap();
            assert!(mesh.normals.iter().all(|normal| *normal == Vec3::Z), "{rest}: {:?}", mesh.normals);
            assert!(mesh.targets[0].normals.is_empty(), "{rest}: {:?}", mesh.targets);
        }
    }
}

#[test]
fn names_are_one_in_any_unicode_form() {
    let mesh = import(NEUTRAL, &[("la\u{308}cheln.obj", NEUTRAL)]).kept(Tolerance::default()).unwrap();
    let clip = |name: &str| WeightClip { names: vec![name.into()], fps: 30.0, values: vec![0.5], ..Default::default() };
    for name in ["l\u{e4}cheln", "la\u{308}cheln"] {
        assert_eq!(mesh.target_index(name), Some(0));
        assert_eq!(clip(name).bind(&["la\u{308}cheln"]).unwrap().frame(0).unwrap(), [0.5]);
        assert_eq!(clip(&name.to_uppercase()).bind(&["l\u{e4}cheln"]).unwrap().frame(0).unwrap(), [0.5]);
    }
    let both = [("la\u{308}.obj", NEUTRAL), ("l\u{e4}.obj", NEUTRAL)];
    says(&refused(NEUTRAL, &both), &["second file of the target 'l\u{e4}'"]);
}

/// A bumpy grid of 7 × 7 vertices, and its quads.
fn grid() -> Vec<Vec3> {
    (0..49).map(|i| Vec3::new((i % 7) as f32, (i / 7) as f32, (i * 7 % 5) as f32 * 0.1)).collect()
}

fn quads() -> Vec<Vec<u32>> {
    (0..42).filter(|v| v % 7 < 6).map(|v| vec![v, v + 1, v + 8, v + 7]).collect()
}

/// Vertices in one of four spellings, some with further lines that hold nothing.
fn spelled(places: &[Vec3], spelling: usize) -> String {
    let line = |p: &Vec3| match spelling {
        0 => format!("v {} {} {}\n", p.x, p.y, p.z),
        1 => format!("v\t{:e} +{}   {:e} 1.0\r\n", p.x, p.y, p.z),
        2 => format!("v {} \\\n{} {} 0.5 0.5 1\nl 1 2\n", p.x, p.y, p.z),
        _ => format!("  v {} {} {} # {}\ng\nvn 1.#IND 0 0\n", p.x, p.y, p.z, p.x),
    };
    places.iter().map(line).collect()
}

fn with_faces(vertices: String, faces: &[Vec<u32>]) -> String {
    let line = |face: &Vec<u32>| face.iter().fold("f".to_owned(), |line, v| format!("{line} {}", v + 1)) + "\n";
    vertices + &faces.iter().map(line).collect::<String>()
}

#[test]
fn targets_that_move_all_far_are_remarked_on() {
    type Place = fn(Vec3) -> Vec3;
    let places: [(&str, Place); 8] = [
        ("baby.obj", |p| p * Vec3::new(0.6, 0.4 + 0.1 * p.y, 0.5)),
        ("beside.obj", |p| p + Vec3::X * 7.0),
        ("child.obj", |p| p * 0.6),
        ("cm.obj", |p| p * 100.0),
        ("km.obj", |p| p * 0.001),
        ("giant.obj", |p| p * Vec3::new(1.0, 1.5, 1.0)),
        ("smile.obj", |p| p + Vec3::new(0.02, 0.01, 0.1) * p.x),
        ("turned.obj", |p| Vec3::new(p.x, -p.z, p.y)),
    ];
    let text = |place: Place| with_faces(spelled(&grid().into_iter().map(place).collect::<Vec<_>>(), 0), &quads());
    let files = places.map(|(name, place)| (name, text(place)));
    let source = import(&text(|p| p), &files.each_ref().map(|(name, text)| (*name, text.as_str())));
    says(&source.notes.join("\n"), &["targets that have the whole mesh elsewhere", ": 'beside', 'cm', 'km', "]);
}

proptest! {
    /// Files that differ only in faces (order, first corner, side, cut, or none), in parts without content, and in how
    /// numbers are written.
    #[test]
    fn faces_of_targets_empty_parts_and_spelling_change_no_pose(
        order in Just(quads()).prop_shuffle(),
        turn in 0usize..4,
        cut in 0usize..4,
        spelling in 0usize..4,
        seed in 0u32..100,
    ) {
        let lift = |(i, p): (usize, Vec3)| p + Vec3::Z * ((i as u32 ^ seed) % 9) as f32 * 0.1;
        let moved: Vec<Vec3> = grid().into_iter().enumerate().map(lift).collect();
        let cut_faces = order.into_iter().flat_map(|mut face| {
            face.rotate_left(turn);
            match cut {
                0 => vec![face],
                1 => vec![face[..3].to_vec(), vec![face[0], face[2], face[3]]],
                2 => vec![face.into_iter().rev().collect(), vec![0, 1]],
                _ => vec![],
            }
        });
        let neutral = with_faces(spelled(&grid(), 0), &quads());
        let expected = import(&neutral, &[("a.obj", &with_faces(spelled(&moved, 0), &quads()))]);
        let other = with_faces(spelled(&moved, spelling), &cut_faces.collect::<Vec<_>>());
        let found = import(&with_faces(spelled(&grid(), spelling), &quads()), &[("a.obj", &other)]);
        prop_assert_eq!(&found.positions, &expected.positions);
        prop_assert_eq!(&found.faces, &expected.faces);
        prop_assert_eq!(&found.targets[0].positions, &expected.targets[0].positions);
        let noted = found.notes.iter().any(|note| note.starts_with("targets whose faces are not those of neutral.obj"));
        prop_assert!(noted || cut == 0 && turn == 0, "{:?}", found.notes);
        // Vertices in another order are refused.
        let mut shuffled: Vec<u32> = (0..49).collect();
        shuffled.sort_by_key(|v| (v * 31 + seed) * 37 % 101);
        let places: Vec<Vec3> = shuffled.iter().map(|v| moved[*v as usize]).collect();
        let message = refused(&neutral, &[("a.obj", &spelled(&places, 0))]);
        says(&message, &["a.obj: its vertices are in another order", "same order"]);
    }
}
